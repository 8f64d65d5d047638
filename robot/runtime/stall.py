"""When an event loop counts as stalled. Pure: what it is told, it judges."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from robot.safety.timing import LOOP_STALL_S


class Look(StrEnum):
    """What one look at the loop's beat finds."""

    ALIVE = "alive"
    STALLED = "stalled"              # for the first time since the last beat: act
    STALLED_STILL = "stalled still"  # acted upon already


@dataclass(frozen=True, slots=True)
class StallRules:
    """Seconds. The loop owes a beat every ``beat_s``; the watch looks every ``look_s``.

    A watch that comes ``late_s`` after its time was itself kept from running (the process suspended, the processor
    taken): the loop then gets ``stall_s`` anew to show that it lives. Nothing excuses a beat older than ``longest_s``.
    """

    stall_s: float = LOOP_STALL_S
    beat_s: float = 0.05
    look_s: float = 0.05
    late_s: float = 0.1
    longest_s: float = 1.0


class StallJudge:
    """Remembers the looks of one watch. Times are of one monotonic clock."""

    def __init__(self, rules: StallRules, now_s: float) -> None:
        self._rules = rules
        self._looked_s = self._excused_s = now_s
        self._acted_on_s: float | None = None  # the beat after which the stall came that was acted upon

    def look(self, now_s: float, beat_s: float) -> Look:
        """``beat_s``: when the loop beat last."""
        rules, looked_s = self._rules, self._looked_s
        self._looked_s = now_s
        if now_s - looked_s > rules.look_s + rules.late_s:
            self._excused_s = now_s
        waited_s = now_s - max(beat_s, self._excused_s)
        if waited_s <= rules.stall_s and now_s - beat_s <= rules.longest_s:
            return Look.ALIVE
        if self._acted_on_s == beat_s:
            return Look.STALLED_STILL
        self._acted_on_s = beat_s
        return Look.STALLED
