"""How every bench tells a figure: a line with a name, what was measured, and the goal."""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable

Say = Callable[[str, str, str], None]


def say(name: str, figures: str, goal: str = "") -> None:
    sys.stdout.write(f"{name:<46}{figures}{'   goal ' + goal if goal else ''}\n")
    sys.stdout.flush()


def measure(name: str, repeats: int, step: Callable[[], object], goal: str = "") -> None:
    """Thread CPU time of each repeat, milliseconds, after one unmeasured call."""
    step()
    times_ms = []
    for _ in range(repeats):
        began_s = time.thread_time()
        step()
        times_ms.append(1e3 * (time.thread_time() - began_s))
    say(name, f"median {statistics.median(times_ms):8.2f} ms   worst {max(times_ms):8.2f} ms   n {repeats}", goal)
