"""Where each input is read, and what the words that are read mean."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Literal

from drivers import modbus_pdu as pdu
from drivers.inputs.values import InputState
from drivers.modbus_probe import Probe

Kind = Literal["contact", "u16", "i16", "u32", "u32_low_first", "f32", "f32_low_first", "counter"]

QUANTITIES = tuple(field.name for field in fields(InputState) if field.name != "stamp_s")
CONTACTS = ("estop_pressed", "bumper_pressed")
WIRE_BREAK_UA, SHORT_CIRCUIT_UA = 3600.0, 21000.0  # NAMUR NE 43
ZERO_UA, FULL_UA = 4000.0, 20000.0

_BIT_AREAS = (pdu.READ_COILS, pdu.READ_DISCRETE_INPUTS)
_WORD_AREAS = (pdu.READ_HOLDING, pdu.READ_INPUT_REGISTERS)
_WORDS: dict[Kind, int] = {
    "contact": 1, "u16": 1, "i16": 1, "u32": 2, "u32_low_first": 2, "f32": 2, "f32_low_first": 2, "counter": 2,
}  # fmt: skip

GAP_WORDS, GAP_BITS, MOST_WORDS = 8, 64, 64


@dataclass(frozen=True, slots=True)
class Point:
    """One quantity of ``InputState``: ``raw * scale + offset`` in the quantity's unit. ``ValueError`` if impossible.

    ``function`` is 01 to 04. A "contact" is normally closed: 1 is released, 0 (open, or a broken wire) is pressed. A
    "counter" is a u32, high word first, that wraps. ``low`` and ``high`` bound what is plausible, in the quantity's
    unit; ``live_low`` and ``live_high`` what a sound sensor gives, in raw. Below ``floor`` it reads ``floor``.
    """

    quantity: str
    unit_id: int
    function: int
    address: int
    kind: Kind
    scale: float = 1.0
    offset: float = 0.0
    low: float = -math.inf
    high: float = math.inf
    live_low: float = -math.inf
    live_high: float = math.inf
    floor: float = -math.inf

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise ValueError(f"point: unknown quantity {self.quantity!r}; known are {', '.join(QUANTITIES)}")
        if self.kind not in _WORDS:
            raise ValueError(f"{self.quantity}: unknown kind {self.kind!r}; known are {', '.join(_WORDS)}")
        if (self.kind == "contact") != (self.quantity in CONTACTS):
            expected = "a contact" if self.quantity in CONTACTS else "no contact"
            raise ValueError(f"{self.quantity}: expected {expected}, found kind {self.kind!r}; correct it")
        areas = _BIT_AREAS if self.kind == "contact" else _WORD_AREAS
        if self.function not in areas:
            raise ValueError(f"{self.quantity}: expected function {areas[0]} or {areas[1]}, found {self.function}")
        if not 1 <= self.unit_id <= 255 or not 0 <= self.address <= 0x10000 - self.words:
            raise ValueError(f"{self.quantity}: no such place as unit {self.unit_id}, address {self.address}")
        if not (math.isfinite(self.scale) and self.scale != 0.0 and math.isfinite(self.offset)):
            raise ValueError(f"{self.quantity}: expected a scale other than 0 and an offset, both finite; correct them")

    @property
    def words(self) -> int:
        """How many words, or bits, it takes."""
        return _WORDS[self.kind]

    @property
    def place(self) -> str:
        return f"unit {self.unit_id}, function {self.function:02d}, address {self.address:#06x}"

    def raw(self, words: Sequence[int]) -> float:
        """The number in the words."""
        if self.words == 1:
            word = words[0]
            return word - 0x10000 if self.kind == "i16" and word & 0x8000 else word
        high, low = words if not self.kind.endswith("low_first") else (words[1], words[0])
        both = high << 16 | low
        return float(struct.unpack(">f", struct.pack(">I", both))[0]) if self.kind.startswith("f32") else both


@dataclass(frozen=True, slots=True)
class Module:
    """A unit that points are read from, and what proves that it is the one."""

    unit_id: int
    title: str
    probes: tuple[Probe, ...]


@dataclass(frozen=True, slots=True)
class Block:
    """Bits or words that are read with one frame."""

    unit_id: int
    function: int
    address: int
    count: int


def blocks(points: Iterable[Point]) -> tuple[Block, ...]:
    """As few frames as the addresses allow: a gap costs less than a frame of its own."""
    found: list[Block] = []
    for point in sorted(points, key=lambda point: (point.unit_id, point.function, point.address)):
        last = found[-1] if found else None
        if last is not None and (last.unit_id, last.function) == (point.unit_id, point.function):
            end = point.address + point.words
            gap = point.address - (last.address + last.count)
            near = gap <= (GAP_BITS if point.kind == "contact" else GAP_WORDS)
            if near and end - last.address <= MOST_WORDS:
                found[-1] = Block(last.unit_id, last.function, last.address, max(last.count, end - last.address))
                continue
        found.append(Block(point.unit_id, point.function, point.address, point.words))
    return tuple(found)


def current_loop(quantity: str, unit_id: int, address: int, full: float) -> Point:
    """A sensor of 4 to 20 mA for 0 to ``full``, on a module whose input registers hold microamperes."""
    scale = full / (FULL_UA - ZERO_UA)
    return Point(
        quantity, unit_id, pdu.READ_INPUT_REGISTERS, address, "u16",
        scale=scale, offset=-ZERO_UA * scale, low=-0.03 * full, high=1.07 * full,
        live_low=WIRE_BREAK_UA, live_high=SHORT_CIRCUIT_UA, floor=0.0,
    )  # fmt: skip
