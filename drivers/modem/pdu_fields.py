"""The fields that the PDUs of a text share: addresses, time stamps, validity (3GPP 23.040, section 9)."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

from drivers.modem import gsm7

MAX_PDU_OCTETS = 255
MAX_DIGITS = 20
_DIGITS = "0123456789*#abc"
_FILLER = 0xF
_INTERNATIONAL, _UNKNOWN = 0x91, 0x81
_ALPHANUMERIC_TYPE = 5
_INTERNATIONAL_TYPE = 1
_FIRST_GSM_YEAR = 90  # two digits from here on are of the last century


class Octets:
    """Reads a PDU from its beginning. Every method raises ``ValueError`` that names the field in which it ends."""

    def __init__(self, text: str) -> None:
        if len(text) > 2 * MAX_PDU_OCTETS:
            raise ValueError(f"expected at most {MAX_PDU_OCTETS} octets, found {len(text) // 2}")
        try:
            self._data = bytes.fromhex(text)
        except ValueError:
            raise ValueError("expected pairs of hexadecimal digits, found something else") from None
        self._at = 0

    def take(self, count: int, field: str) -> bytes:
        data = self._data[self._at : self._at + count]
        if len(data) < count:
            raise ValueError(f"the PDU ends within its {field}: {count} octets expected, {len(data)} found")
        self._at += count
        return data

    def one(self, field: str) -> int:
        return self.take(1, field)[0]

    @property
    def left(self) -> int:
        return len(self._data) - self._at


def semi_octets(digits: str) -> bytes:
    """Digits with their nibbles swapped, filled up to whole octets."""
    nibbles = [_DIGITS.index(digit) for digit in digits]
    if len(nibbles) % 2:
        nibbles.append(_FILLER)
    return bytes(low | high << 4 for low, high in zip(nibbles[::2], nibbles[1::2], strict=True))


def digits_of(data: bytes) -> str:
    """Digits up to the filler. Raises ``ValueError`` for a filler between digits."""
    nibbles = [nibble for octet in data for nibble in (octet & 0xF, octet >> 4)]
    if nibbles and nibbles[-1] == _FILLER:
        nibbles.pop()
    if _FILLER in nibbles:
        raise ValueError("expected a number of digits, found a filler between them")
    return "".join(_DIGITS[nibble] for nibble in nibbles)


def encode_address(number: str) -> bytes:
    """Length in digits, type, digits; ``number`` is ``+`` and digits, or digits as they are dialled in the country.

    A number of other characters becomes an alphanumeric address, as service centres use for named senders.
    """
    digits = number.removeprefix("+")
    if digits and all(digit in _DIGITS for digit in digits):
        if len(digits) > MAX_DIGITS:
            raise ValueError(f"expected a number of at most {MAX_DIGITS} digits, found {len(digits)}")
        kind = _INTERNATIONAL if number.startswith("+") else _UNKNOWN
        return bytes([len(digits), kind]) + semi_octets(digits)
    packed = gsm7.pack(gsm7.septets_of(number))
    if not 0 < len(packed) <= MAX_DIGITS // 2:
        raise ValueError(f"expected a number, or a name of at most 11 characters, found {number!r}")
    return bytes([(7 * len(gsm7.septets_of(number)) + 3) // 4, 0x80 | _ALPHANUMERIC_TYPE << 4]) + packed


def take_address(octets: Octets, field: str) -> str:
    """A number, with ``+`` when it is an international one, or the name of a sender."""
    length = octets.one(field)
    kind = octets.one(field)
    if length > MAX_DIGITS:
        raise ValueError(f"expected a {field} of at most {MAX_DIGITS} digits, found {length}")
    data = octets.take((length + 1) // 2, field)
    if (kind >> 4) & 7 == _ALPHANUMERIC_TYPE:
        return gsm7.text_of(gsm7.unpack(data, 4 * length // 7))
    if length % 2 and data[-1] >> 4 != _FILLER:
        data = data[:-1] + bytes([data[-1] | 0xF0])
    digits = digits_of(data)
    return f"+{digits}" if (kind >> 4) & 7 == _INTERNATIONAL_TYPE else digits


def encode_smsc(number: str | None) -> bytes:
    """The service centre's address, length in octets; None leaves the choice to the SIM."""
    if number is None:
        return b"\0"
    digits = number.removeprefix("+")
    if not 0 < len(digits) <= MAX_DIGITS or not all(digit in _DIGITS for digit in digits):
        raise ValueError(f"expected the number of a service centre, found {number!r}")
    body = bytes([_INTERNATIONAL if number.startswith("+") else _UNKNOWN]) + semi_octets(digits)
    return bytes([len(body)]) + body


def take_smsc(octets: Octets) -> str | None:
    length = octets.one("service centre's length")
    if length == 0:
        return None
    kind = octets.one("service centre")
    digits = digits_of(octets.take(length - 1, "service centre"))
    return f"+{digits}" if (kind >> 4) & 7 == _INTERNATIONAL_TYPE else digits


def encode_stamp(moment: datetime) -> bytes:
    """A service centre's stamp: local time and its zone in quarters of an hour."""
    offset = moment.utcoffset()
    if offset is None:
        raise ValueError("expected a time with its zone, found one without")
    quarters = round(offset.total_seconds() / 900.0)
    stamp = semi_octets(f"{moment:%y%m%d%H%M%S}{abs(quarters):02d}")
    return stamp[:6] + bytes([stamp[6] | (0x08 if quarters < 0 else 0)])


def stamp_of(data: bytes) -> datetime | None:
    """UTC of seven octets; None when they are no date. Two digits of a year stand for 1990 to 2089."""
    try:
        year, month, day, hour, minute, second = (_two_digits(octet) for octet in data[:6])
        quarters = _two_digits(data[6] & ~0x08)
        zone = timezone((-1 if data[6] & 0x08 else 1) * timedelta(minutes=15 * quarters))
        century = 1900 if year >= _FIRST_GSM_YEAR else 2000
        return datetime(century + year, month, day, hour, minute, second, tzinfo=zone).astimezone(UTC)
    except (ValueError, OverflowError):
        return None


def _two_digits(octet: int) -> int:
    tens, units = octet & 0xF, octet >> 4
    if tens > 9 or units > 9:
        raise ValueError("expected two decimal digits")
    return 10 * tens + units


# (highest code, code of the range's start, seconds before the range, seconds a step): 3GPP 23.040, 9.2.3.12.1
_VALIDITY = (
    (143, -1, 0.0, 300.0),
    (167, 143, 43_200.0, 1800.0),
    (196, 166, 0.0, 86_400.0),
    (255, 192, 0.0, 604_800.0),
)


def validity_of(code: int) -> float:
    """Seconds for which a service centre keeps the text, from the octet of a relative validity."""
    for highest, start, before_s, step_s in _VALIDITY:
        if code <= highest:
            return before_s + (code - start) * step_s
    raise ValueError(f"expected a validity of one octet, found {code}")


def encode_validity(seconds: float) -> int:
    """The octet of the shortest relative validity that is not shorter than ``seconds``."""
    for code in range(256):
        if validity_of(code) >= seconds:
            return code
    raise ValueError(f"expected a validity of at most {validity_of(255):g} s, found {seconds:g}")
