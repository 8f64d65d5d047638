"""From the words of one poll to the quantities: wires, plausibility, and counters that go on over their end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from drivers.errors import DeviceFault
from drivers.inputs.points import Block, Point

COUNTS = 1 << 32


class Totaliser:
    """A counter of 32 bits as one that never ends: it goes on over wraps and over a module that began anew."""

    def __init__(self) -> None:
        self._last = 0
        self._total = 0

    def total(self, count: int) -> int:
        passed = (count - self._last) % COUNTS
        self._total += passed if passed < COUNTS // 2 else count  # a jump back is a module that lost its power
        self._last = count
        return self._total


class Readings:
    """Keeps the counters from poll to poll."""

    def __init__(self, points: Sequence[Point]) -> None:
        self._points = tuple(points)
        self._totals = {point.quantity: Totaliser() for point in points if point.kind == "counter"}

    def quantities(self, polled: Mapping[Block, Sequence[int]]) -> dict[str, float | bool]:
        """By the names of ``InputState``. ``DeviceFault`` names the point that cannot be believed."""
        told: dict[str, float | bool] = {}
        for point in self._points:
            raw = point.raw(_words(point, polled))
            told[point.quantity] = raw == 0 if point.kind == "contact" else self._value(point, raw)
        return told

    def _value(self, point: Point, raw: float) -> float:
        if not point.live_low <= raw <= point.live_high:
            wire = "a broken wire or a sensor without power" if raw < point.live_low else "a short circuit"
            raise DeviceFault(
                "inputs", f"{point.quantity} ({point.place}) to give {point.live_low:g} to {point.live_high:g}",
                f"{raw:g}, {wire}", "check the sensor and its cable",
            )  # fmt: skip
        if point.kind == "counter":
            raw = self._totals[point.quantity].total(int(raw))
        value = raw * point.scale + point.offset
        if not point.low <= value <= point.high:
            raise DeviceFault(
                "inputs", f"{point.quantity} ({point.place}) from {point.low:g} to {point.high:g}", f"{value:g}",
                "check the sensor, and the scale and address of the point in the configuration",
            )  # fmt: skip
        return max(value, point.floor)


def _words(point: Point, polled: Mapping[Block, Sequence[int]]) -> Sequence[int]:
    for block, words in polled.items():
        first = point.address - block.address
        same = (block.unit_id, block.function) == (point.unit_id, point.function)
        if same and 0 <= first <= block.count - point.words:
            return words[first : first + point.words]
    raise KeyError(f"{point.quantity} was not polled")
