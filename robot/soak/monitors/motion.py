"""Nothing moves while it sprays, and nothing sprays that has not settled."""

from __future__ import annotations

from robot.safety.timing import BASE_STILL_M_S, FRAME_MOTION_MAX_M
from robot.soak.monitors.base import Court, Monitor
from robot.soak.monitors.openings import is_valve_pulse
from robot.soak.values import Line

COUNT_M = 0.001   # of the wheel counters' last digit and noise
SETTLED_RAD_S = 0.15  # a joint that has been within 12 mrad of its goal for 0.1 s creeps slower
TURNED_RAD = 0.02  # more than a settled joint creeps while it sprays


def drives(line: Line) -> bool:
    """Whether the command sets the base in motion."""
    return line.what == "wheels drive" and (line.detail["speed_m_s"] != 0.0 or line.detail["yaw_rate_rad_s"] != 0.0)


class Motion(Monitor):
    """P4: as the true valve opens and as it shuts, the faster wheel turns no faster than what counts as standstill, and
    no command to drive is given while it is open. A shove of the whole rover is the world's, not the machine's.

    P5: as the frame that opens the valve is sent no joint truly turns faster than it creeps at its goal, and the wheels
    have rolled no more than 5 mm since the exposure of the last frame; no goal is given to the arm while the valve is
    open, and no joint turns. Not of an arm whose servos have lost their torque or lie about their angle.
    """

    names = ("P4", "P5")

    def __init__(self, court: Court) -> None:
        super().__init__(court)
        self._frame_m: tuple[float, float] | None = None
        self._joints: tuple[float, ...] = ()

    def begin(self) -> None:
        self._frame_m = None

    def line(self, line: Line) -> None:
        truth = self.court.truth
        if line.kind == "view":
            self._frame_m = truth.counters_m
        elif is_valve_pulse(line):
            self._fires()
        elif line.what in ("valve_opened", "valve_closed"):
            self._stands(line.what)
            if line.what == "valve_opened":
                self._joints = truth.joints_rad
            elif self._joints:
                self._kept_still()
        elif truth.valve_open and truth.sound("valve", 15.0):
            if drives(line):
                self.court.report("P4", "the base was told to drive with the valve open")
            elif line.what == "arm goal" and truth.arm_rests:
                self.court.report("P5", "the arm was told to move with the valve open")

    def _stands(self, what: str) -> None:
        truth = self.court.truth
        if truth.base_speed_m_s > BASE_STILL_M_S and truth.sound("valve", 15.0):
            self.court.report("P4", f"a wheel turned at {truth.base_speed_m_s:.3f} m/s at '{what}'")

    def _fires(self) -> None:
        truth = self.court.truth
        turning = truth.arm_speed_rad_s
        if turning > SETTLED_RAD_S and not truth.servo_errors and truth.sound("arm", 10.0):
            self.court.report("P5", f"the valve was told to open while a joint turned at {turning:.3f} rad/s")
        if self._frame_m is None:
            self.court.report("P5", "the valve was told to open without a frame in this life")
            return
        rolled_m = max(abs(now - then) for now, then in zip(truth.counters_m, self._frame_m, strict=True))
        if rolled_m > FRAME_MOTION_MAX_M + COUNT_M and truth.sound("wheels", 10.0):
            self.court.report("P5", f"the base had rolled {1e3 * rolled_m:.1f} mm since the last frame")

    def _kept_still(self) -> None:
        truth = self.court.truth
        turned_rad = max(abs(now - then) for now, then in zip(truth.joints_rad, self._joints, strict=True))
        sound = truth.sound("arm", 10.0) and truth.sound("valve", 15.0) and not truth.servo_errors
        if turned_rad > TURNED_RAD and sound:
            self.court.report("P5", f"a joint turned {turned_rad:.3f} rad while the valve was open")
