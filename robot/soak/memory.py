"""How much memory the process holds, and whether it grows."""

from __future__ import annotations

import os
from dataclasses import dataclass, field

WARM_H = 1.0        # caches fill and libraries settle: not counted as growth
LEAST_SAMPLES = 3
MIB = 1024.0 * 1024.0


def resident_mib() -> float:
    """Resident set size of this process (/proc/self/statm, Linux)."""
    with open("/proc/self/statm", encoding="ascii") as stream:
        pages = int(stream.read().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / MIB


@dataclass(slots=True, eq=False)
class MemoryCurve:
    """(simulated hours, MiB), one sample at each whole ``every_h``."""

    every_h: float = 0.25
    samples: list[tuple[float, float]] = field(default_factory=list)

    def look(self, hours: float) -> None:
        if not self.samples or hours - self.samples[-1][0] >= self.every_h:
            self.samples.append((hours, resident_mib()))

    @property
    def slope_mib_h(self) -> float | None:
        """Least squares over what came after the first hour; None where that is too short to say."""
        late = [sample for sample in self.samples if sample[0] >= WARM_H]
        if len(late) < LEAST_SAMPLES or late[-1][0] - late[0][0] < WARM_H:
            return None
        mean_h = sum(h for h, _ in late) / len(late)
        mean_mib = sum(mib for _, mib in late) / len(late)
        spread = sum((h - mean_h) ** 2 for h, _ in late)
        return sum((h - mean_h) * (mib - mean_mib) for h, mib in late) / spread

    def curve(self, points: int = 9) -> tuple[tuple[float, float], ...]:
        """Evenly chosen samples, first and last among them."""
        if len(self.samples) <= points:
            return tuple(self.samples)
        step = (len(self.samples) - 1) / (points - 1)
        return tuple(self.samples[round(k * step)] for k in range(points))
