"""The GSM 7-bit alphabet: its default and extension tables, and its packing into octets (3GPP 23.038)."""

from __future__ import annotations

from collections.abc import Sequence

ESCAPE = 0x1B
_DEFAULT = (
    "@£$¥èéùìòÇ\nØø\rÅåΔ_ΦΓΛΩΠΨΣΘΞ\x1bÆæßÉ !\"#¤%&'()*+,-./0123456789:;<=>?"
    "¡ABCDEFGHIJKLMNOPQRSTUVWXYZÄÖÑÜ§¿abcdefghijklmnopqrstuvwxyzäöñüà"
)
_EXTENSION = {
    0x0A: "\f", 0x14: "^", 0x28: "{", 0x29: "}", 0x2F: "\\", 0x3C: "[", 0x3D: "~", 0x3E: "]", 0x40: "|", 0x65: "€",
}  # fmt: skip
_SEPTETS = {
    **{character: (code,) for code, character in enumerate(_DEFAULT) if code != ESCAPE},
    **{character: (ESCAPE, code) for code, character in _EXTENSION.items()},
}


def width(character: str) -> int:
    """How many septets a character takes: 1, 2 for one of the extension table, 0 when the alphabet has it not."""
    return len(_SEPTETS.get(character, ()))


def septets_of(text: str) -> list[int]:
    """Raises ``ValueError`` for a character that the alphabet has not."""
    septets: list[int] = []
    for character in text:
        if character not in _SEPTETS:
            raise ValueError(f"the GSM alphabet has no {character!r}")
        septets += _SEPTETS[character]
    return septets


def text_of(septets: Sequence[int]) -> str:
    """An escape before a code that the extension table has not shows the default table's character, as phones do."""
    text: list[str] = []
    escaped = False
    for septet in septets:
        if septet == ESCAPE:
            if escaped:
                text.append(" ")
            escaped = not escaped
            continue
        text.append(_EXTENSION.get(septet, _DEFAULT[septet]) if escaped else _DEFAULT[septet])
        escaped = False
    return "".join(text) + (" " if escaped else "")


def pack(septets: Sequence[int], fill_bits: int = 0) -> bytes:
    """Septets in octets, lowest bit first, after ``fill_bits`` zero bits."""
    bits = 0
    for place, septet in enumerate(septets):
        bits |= septet << (7 * place)
    return (bits << fill_bits).to_bytes((7 * len(septets) + fill_bits + 7) // 8, "little")


def unpack(data: bytes, count: int, fill_bits: int = 0) -> list[int]:
    """``count`` septets from octets. Raises ``ValueError`` when the octets hold fewer."""
    if 7 * count + fill_bits > 8 * len(data):
        raise ValueError(f"expected {count} septets, found {len(data)} octets; the PDU is cut short")
    bits = int.from_bytes(data, "little") >> fill_bits
    return [(bits >> (7 * place)) & 0x7F for place in range(count)]
