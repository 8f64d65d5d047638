"""What the computer under the program does wrong: its clock jumps, it gets too hot, its configuration is edited."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from robot.actuation import Actuation
from robot.runtime.upkeep import Poll

CLOCK_PERIOD_S, HEAT_PERIOD_S, FILE_PERIOD_S = 0.5, 2.0, 0.5
CLOCK_STEP_S = 2.0               # less is the slewing of a time service
WARM_C, HOT_C, COOLER_C = 75.0, 85.0, 5.0
THERMAL_ZONES = Path("/sys/class/thermal")
PROCESSOR_ZONES = ("cpu", "soc", "pkg", "acpitz")  # others (batteries, radios, fixed dummies) have limits of their own

Tell = Callable[[str], None]


class ClockSteps:
    """Holds the wall clock against the monotonic one."""

    def __init__(self, wall_s: float, monotonic_s: float) -> None:
        self._apart_s = wall_s - monotonic_s

    def look(self, wall_s: float, monotonic_s: float) -> float:
        """By how much the wall clock has jumped since the last look, seconds; 0 when it has not."""
        step_s = wall_s - monotonic_s - self._apart_s
        self._apart_s += step_s
        return step_s if abs(step_s) >= CLOCK_STEP_S else 0.0


@dataclass(slots=True)
class Heat:
    """Whether the computer is ``warm`` (told) or ``hot`` (paused); each ends ``COOLER_C`` below where it began."""

    warm: bool = False
    hot: bool = False

    def look(self, hottest_c: float) -> None:
        self.warm = hottest_c >= WARM_C - (COOLER_C if self.warm else 0.0)
        self.hot = hottest_c >= HOT_C - (COOLER_C if self.hot else 0.0)


def hottest_c(root: Path) -> float | None:
    """The hottest processor zone of the kernel under ``root``, degrees Celsius; None when there is none."""
    found = []
    for zone in root.glob("thermal_zone*"):
        try:
            kind = (zone / "type").read_text().strip().lower()
            if any(word in kind for word in PROCESSOR_ZONES):
                found.append(int((zone / "temp").read_text()) / 1000.0)
        except (OSError, ValueError):
            continue  # a zone that is switched off does not answer
    return max(found, default=None)


class HostWatch:
    """Tells what it sees and reports F41, F46 and F48.

    ``wall_s`` reads the wall clock, ``zones`` is the kernel's folder of thermal zones. The computer of a simulated
    machine is not the machine's: then only the configuration is watched.
    """

    def __init__(
        self, config_path: Path, simulated: bool, actuation: Actuation, tell: Tell,
        wall_s: Callable[[], float] = time.time, zones: Path = THERMAL_ZONES,
    ) -> None:  # fmt: skip
        self._path, self._simulated, self._actuation, self._tell = config_path, simulated, actuation, tell
        self._wall_s, self._zones = wall_s, zones
        self._steps: ClockSteps | None = None
        self._heat = Heat()
        self._content = _content(config_path)

    @property
    def polls(self) -> tuple[Poll, ...]:
        edited = Poll("configuration file", "runtime", self.look_at_file, FILE_PERIOD_S, 10.0)
        if self._simulated:
            return (edited,)
        return (
            edited,
            Poll("wall clock", "runtime", self.look_at_clock, CLOCK_PERIOD_S, 10.0),
            Poll("temperature", "runtime", self.look_at_heat, HEAT_PERIOD_S, 10.0),
        )

    async def look_at_clock(self) -> None:
        wall_s, now_s = self._wall_s(), asyncio.get_running_loop().time()
        if self._steps is None:
            self._steps = ClockSteps(wall_s, now_s)
        step_s = self._steps.look(wall_s, now_s)
        if step_s:
            await self._report(
                "F41", f"the computer's clock jumped by {step_s:+.1f} s: the rows' times of day jump with it, their "
                "order and every duration do not",
            )  # fmt: skip
        else:
            self._actuation.clear("F41")

    async def look_at_heat(self) -> None:
        found_c = hottest_c(self._zones)
        if found_c is None:
            return
        was_warm, was_hot = self._heat.warm, self._heat.hot
        self._heat.look(found_c)
        if self._heat.hot and not was_hot:
            await self._report("F48", f"the computer is at {found_c:.0f} C (pauses from {HOT_C:.0f} on): let it cool")
        elif self._heat.warm and not was_warm:
            self._tell(f"the computer is at {found_c:.0f} C (pauses from {HOT_C:.0f} on): give it air and shade")
        if was_hot and not self._heat.hot:
            self._actuation.clear("F48")

    async def look_at_file(self) -> None:
        content = _content(self._path)
        if content == self._content:
            return
        self._content = content
        await self._report("F46", f"{self._path} was changed: what was read at the start counts until the next start")

    async def _report(self, fault_id: str, text: str) -> None:
        self._tell(f"{text} [{fault_id}]")
        await self._actuation.report(fault_id, text)


def _content(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None
