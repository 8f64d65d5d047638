"""How long the disk takes: every durable write is timed."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

BOUNDS_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
SLOW_S = 0.05  # a write beyond this delays shots so much that somebody should know


@dataclass(frozen=True, slots=True)
class WriteLatency:
    """``counts[i]`` writes took up to ``BOUNDS_S[i]``, the last of them longer; ``slow`` took over ``SLOW_S``."""

    counts: tuple[int, ...] = (0,) * (len(BOUNDS_S) + 1)
    total_s: float = 0.0
    longest_s: float = 0.0
    slow: int = 0

    @property
    def writes(self) -> int:
        return sum(self.counts)

    @property
    def warning(self) -> str:
        """What a person should know, "" when the disk is quick enough."""
        if not self.slow:
            return ""
        return (
            f"the ledger's disk is slow: {self.slow} of {self.writes} writes took over {SLOW_S * 1e3:.0f} ms, "
            f"the longest {self.longest_s * 1e3:.0f} ms; each delays a shot; use a faster or less worn disk"
        )

    def with_write(self, duration_s: float) -> WriteLatency:
        place = bisect_left(BOUNDS_S, duration_s)
        counts = tuple(count + (index == place) for index, count in enumerate(self.counts))
        slow = self.slow + (duration_s > SLOW_S)
        return WriteLatency(counts, self.total_s + duration_s, max(self.longest_s, duration_s), slow)
