"""What a PDU carries: the text in its alphabet, and the header of a part of a text (3GPP 23.040, 9.2.3.24)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from drivers.modem import gsm7
from drivers.modem.pdu_fields import Octets

MAX_OCTETS = 140
_PART_NARROW, _PART_WIDE = 0x00, 0x08  # information elements: 8-bit and 16-bit reference


class Alphabet(Enum):
    """How a text is written. DATA is not a text; each of its octets stands as one character."""

    GSM7 = "gsm7"
    DATA = "data"
    UCS2 = "ucs2"


_CODING = {Alphabet.GSM7: 0x00, Alphabet.DATA: 0x04, Alphabet.UCS2: 0x08}


@dataclass(frozen=True, slots=True)
class Part:
    """The place of a PDU in a concatenated text. ``wide``: the reference has 16 bits."""

    reference: int
    total: int
    number: int
    wide: bool = False

    def __post_init__(self) -> None:
        if not (0 <= self.reference < (65536 if self.wide else 256) and 1 <= self.number <= self.total <= 255):
            raise ValueError(f"expected a part of 1 to {self.total}, found {self}")


def coding_octet(alphabet: Alphabet, message_class: int | None = None) -> int:
    return _CODING[alphabet] | (0 if message_class is None else 0x10 | message_class)


def alphabet_of(coding: int) -> Alphabet:
    """Of a data coding scheme (3GPP 23.038, section 4). Raises ``ValueError`` for a compressed text."""
    group = coding >> 4
    if group <= 0x7:
        if coding & 0x20:
            raise ValueError("expected a text, found a compressed one, which is not supported")
        return {1: Alphabet.DATA, 2: Alphabet.UCS2}.get((coding >> 2) & 3, Alphabet.GSM7)
    if group == 0xE:
        return Alphabet.UCS2
    if group == 0xF and coding & 0x04:
        return Alphabet.DATA
    return Alphabet.GSM7


def message_class_of(coding: int) -> int | None:
    """0 to 3; class 0 is shown at once and not stored. None when the text has no class."""
    group = coding >> 4
    return coding & 3 if group == 0xF or (group <= 0x7 and coding & 0x10) else None


def encode_user_data(text: str, alphabet: Alphabet, part: Part | None) -> bytes:
    """Length octet, header, text. Raises ``ValueError`` when it does not fit or cannot be written so."""
    header = _header(part)
    if alphabet is Alphabet.GSM7:
        septets = gsm7.septets_of(text)
        header_septets = (8 * len(header) + 6) // 7
        payload = gsm7.pack(septets, 7 * header_septets - 8 * len(header))
        length = header_septets + len(septets)
    else:
        payload = _octets_of(text, alphabet)
        length = len(header) + len(payload)
    if len(header) + len(payload) > MAX_OCTETS:
        raise ValueError(f"expected a text of at most {MAX_OCTETS} octets, found {len(header) + len(payload)}")
    return bytes([length]) + header + payload


def take_user_data(octets: Octets, coding: int, has_header: bool) -> tuple[str, Alphabet, Part | None]:
    """Raises ``ValueError`` for a length that does not fit, a header that does not hold, or octets that are left over.

    Halves of a surrogate pair that a sender has torn apart stay as they are; ``joined_text`` mends them.
    """
    alphabet = alphabet_of(coding)
    length = octets.one("text's length")
    is_septets = alphabet is Alphabet.GSM7
    size = (7 * length + 7) // 8 if is_septets else length
    if size > MAX_OCTETS:
        raise ValueError(f"expected a text of at most {MAX_OCTETS} octets, found {size}")
    data = octets.take(size, "text")
    header = data[: data[0] + 1] if has_header and data else b""
    if has_header and (not data or len(header) != data[0] + 1):
        raise ValueError("expected a header within the text, found one that is longer")
    part = _part_of(header[1:])
    if is_septets:
        header_septets = (8 * len(header) + 6) // 7
        fill_bits = 7 * header_septets - 8 * len(header)
        septets = gsm7.unpack(data[len(header) :], max(0, length - header_septets), fill_bits)
        return gsm7.text_of(septets), alphabet, part
    body = data[len(header) :]
    if alphabet is Alphabet.DATA:
        return body.decode("latin-1"), alphabet, part
    if len(body) % 2:
        raise ValueError("expected characters of two octets, found an odd number of octets")
    return body.decode("utf-16-be", "surrogatepass"), alphabet, part


def joined_text(texts: list[str]) -> str:
    """Parts as one text; surrogates that met their other half become one character, others the replacement mark."""
    return "".join(texts).encode("utf-16-be", "surrogatepass").decode("utf-16-be", "replace")


def _octets_of(text: str, alphabet: Alphabet) -> bytes:
    try:
        return text.encode("latin-1" if alphabet is Alphabet.DATA else "utf-16-be")
    except UnicodeEncodeError as error:
        raise ValueError(f"{alphabet.value} has no {text[error.start]!r}") from None


def _header(part: Part | None) -> bytes:
    if part is None:
        return b""
    if part.wide:
        return bytes([6, _PART_WIDE, 4, part.reference >> 8, part.reference & 0xFF, part.total, part.number])
    return bytes([5, _PART_NARROW, 3, part.reference, part.total, part.number])


def _part_of(elements: bytes) -> Part | None:
    """The part that the header's elements tell of; an element that makes no sense is passed over, as phones do."""
    part: Part | None = None
    at = 0
    while at < len(elements):
        if at + 2 > len(elements) or at + 2 + elements[at + 1] > len(elements):
            raise ValueError("expected whole elements in the text's header, found one that is cut short")
        kind, value = elements[at], elements[at + 2 : at + 2 + elements[at + 1]]
        at += 2 + len(value)
        wide = kind == _PART_WIDE
        if (kind == _PART_NARROW and len(value) == 3) or (wide and len(value) == 4):
            total, number = value[-2:]
            if 1 <= number <= total:
                part = Part(int.from_bytes(value[:-2], "big"), total, number, wide)
    return part
