"""Hands the receiver's fixes to the localiser, and tells when they are not to be trusted."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime

from drivers.gps.interface import Gps
from drivers.gps.values import Fix
from robot import navigation
from robot.actuation import Actuation
from robot.mission import Localiser, MissionSettings

NO_FIX_S = 2.0     # without a fix that is good enough
REFUSED_FIXES = 2  # in a row: one in a thousand is refused by chance
EARLIEST = datetime(2025, 1, 1, tzinfo=UTC)
LATEST = datetime(2045, 1, 1, tzinfo=UTC)  # a receiver whose weeks have rolled over is 19.6 years off


class GpsPoll:
    """Reports F42 (date) and F61 (jump), and tells of F60 (no position). ``tell`` is for a person."""

    def __init__(
        self, gps: Gps, localiser: Localiser, settings: MissionSettings, actuation: Actuation,
        tell: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._gps, self._localiser, self._settings = gps, localiser, settings
        self._actuation, self._tell = actuation, tell
        self._good_s: float | None = None
        self._told_missing = False

    async def step(self) -> None:
        """The next fix; ``DeviceError`` when there is none."""
        fix = await self._gps.next_fix()
        self._localiser.on_fix(fix)
        await self._judge_date(fix)
        if self._settings.datum is not None and self._localiser.started:
            self._judge_quality(fix)
            await self._judge_place(fix)

    async def _judge_date(self, fix: Fix) -> None:
        if fix.utc is not None and not EARLIEST <= fix.utc < LATEST:
            await self._report("F42", f"gps: the receiver's date is {fix.utc:%Y-%m-%d}, which cannot be: its position "
                               "is used, its time is not; update its firmware")  # fmt: skip
        else:
            self._actuation.clear("F42")

    def _judge_quality(self, fix: Fix) -> None:
        if self._good_s is None or navigation.usable(fix, self._settings.fix_rules):
            self._good_s = fix.stamp_s
            if self._told_missing:
                self._told_missing = False
                self._tell("gps: positions are good enough again")
        elif fix.stamp_s - self._good_s >= NO_FIX_S and not self._told_missing:
            self._told_missing = True
            self._tell(f"gps: no position that is good enough for {fix.stamp_s - self._good_s:.1f} s (quality "
                       f"{fix.quality.name}): the pose goes on by wheels and landmarks [F60]")  # fmt: skip

    async def _judge_place(self, fix: Fix) -> None:
        if self._localiser.filter.rejected >= REFUSED_FIXES:
            await self._report("F61", "gps: positions that the wheels contradict are not believed; the pose goes on by "
                               "wheels and landmarks")  # fmt: skip
        elif navigation.usable(fix, self._settings.fix_rules):
            self._actuation.clear("F61")

    async def _report(self, fault_id: str, text: str) -> None:
        if all(fault.id != fault_id for fault in self._actuation.state.faults):
            self._tell(f"{text} [{fault_id}]")
            await self._actuation.report(fault_id, text)
