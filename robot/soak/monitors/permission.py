"""Who may act, and when: modes, latches, resets, boots, and what a dead process leaves behind."""

from __future__ import annotations

import math

from drivers.relay.values import Channel
from robot.safety import Mode
from robot.safety.timing import CLOSE_DEADLINE_S
from robot.soak.monitors.base import ACTING, LATCHED, Court, Monitor
from robot.soak.monitors.motion import drives
from robot.soak.monitors.openings import LATE_S, NOT_WELDED
from robot.soak.values import Line

ON_ITS_WAY_S = 0.1   # T_ESTOP_SW: a frame that was sent before the stop may still be answered
INPUT_S = 0.3        # from the button to the robot's word: the inputs' poll, their round trip, and a spare
SILENT_S = 1.0       # where the inputs do not answer, until their silence stops the machine
RESUME_M = 0.2
_LATCH_EXITS = {
    Mode.SAFE_STOP: (Mode.DISARMED, Mode.ESTOP, Mode.SAFE_STOP),
    Mode.ESTOP: (Mode.DISARMED, Mode.ESTOP),
}


def acts(line: Line) -> bool:
    """Whether a command sets something in motion or lets liquid go: what default deny denies."""
    if line.what == "relay pulse":
        return bool(line.detail["channel"] in (Channel.VALVE.value, Channel.PUMP.value))
    if line.what == "relay switch":
        return bool(line.detail["on"] and line.detail["channel"] in (Channel.VALVE.value, Channel.PUMP.value))
    return line.what == "arm goal" or drives(line)


class Permission(Monitor):
    """Every command to move or to spray is held against the mode that the robot had told before.

    P6: none later than 100 ms after a stop is latched, until a new start; and a pressed e-stop is latched within 300 ms
    of the true button (1 s where the inputs fail), the worst is kept in ``worst_estop_s``.

    P7: none after an acknowledgement or a reset, before a start.

    P14: after the stop no more leaves the nozzle than flows until the valve must be shut.

    P16: a latched mode is left for DISARMED only (or a worse latch), a latched e-stop only with the button released
    (300 ms after its press the robot must know of it, where the inputs are sound).

    P17: from PAUSED back to AUTO only where a person asked for it, or the base has not moved more than 0.2 m.

    P18: none from boot until the machine has been armed and started. Lamp, beacon and main contactor do not act.
    """

    names = ("P6", "P7", "P14", "P16", "P17", "P18")

    def __init__(self, court: Court) -> None:
        super().__init__(court)
        self.worst_estop_s = 0.0
        self._started = False
        self._acknowledged = False
        self._pressed_s: float | None = None  # and not latched yet
        self._button_s: float | None = None   # and not released yet
        self._stopped_ml = 0.0
        self._paused_xy_m = (0.0, 0.0)

    def begin(self) -> None:
        self._started = self._acknowledged = False
        if self._pressed_s is not None:  # pressed before the boot: what is there to be told is told from here on
            self._pressed_s = None

    def line(self, line: Line) -> None:
        court = self.court
        if line.what == "world estop":
            self._pressed_s = self._button_s = line.t_s if line.detail["pressed"] else None
        if court.mode in ACTING or not acts(line):
            return
        if not self._started:
            court.report("P18", f"'{line.what}' before the machine was armed and started")
        elif court.left_s is not None and line.t_s - court.left_s <= ON_ITS_WAY_S and line.what != "relay switch":
            return
        elif court.mode in LATCHED:
            court.report("P6", f"'{line.what}' {line.t_s - (court.latched_s or 0.0):.3f} s after the stop")
        elif self._acknowledged:
            court.report("P7", f"'{line.what}' after a reset, before a start")
        else:
            court.report("P18", f"'{line.what}' in mode {court.mode}")

    def mode(self, before: Mode, after: Mode) -> None:
        court = self.court
        if after in ACTING:
            self._started, self._acknowledged = True, False
        if before in LATCHED and after is Mode.DISARMED:
            self._acknowledged = True
        if after in LATCHED and before not in LATCHED:
            self._stopped_ml = court.truth.dispensed_ml
        if before in LATCHED and after not in _LATCH_EXITS[before]:
            court.report("P16", f"{before} was left for {after}")
        if before is Mode.ESTOP and after is Mode.DISARMED and self._button_s is not None:
            held_s = court.t_s - self._button_s
            if held_s > INPUT_S and court.truth.sound("inputs", 5.0):
                court.report("P16", f"the e-stop was reset with its button pressed for {held_s:.2f} s")
        if after in LATCHED:
            self._latched_estop()
        self._pause(before, after)

    def end(self) -> None:
        court, truth = self.court, self.court.truth
        if self._pressed_s is not None and self._started and court.mode not in LATCHED and court.killed_s is None:
            waited_s = court.t_s - self._pressed_s
            if waited_s > SILENT_S and truth.sound("inputs", 60.0):
                court.report("P6", f"the e-stop was pressed {waited_s:.2f} s ago and nothing was stopped")
        if court.latched_s is None or not truth.sound("valve") or not truth.sound("relay", but=NOT_WELDED):
            return
        longest_s = CLOSE_DEADLINE_S if truth.sound("relay") else court.rules.max_pulse_s + LATE_S
        most_ml = court.rules.full_flow_ml_s * (longest_s + court.rules.valve_close_s)
        flowed_ml = truth.dispensed_ml - self._stopped_ml
        if flowed_ml > most_ml:
            court.report("P14", f"{flowed_ml:.2f} ml left the nozzle after the stop (at most {most_ml:.2f} ml)")

    def _latched_estop(self) -> None:
        court = self.court
        if self._pressed_s is None or court.killed_s is not None:
            return
        took_s, self._pressed_s = court.t_s - self._pressed_s, None
        sound = court.truth.sound("inputs", 2.0)
        if sound:
            self.worst_estop_s = max(self.worst_estop_s, took_s)
        if took_s > (INPUT_S if sound else math.inf):
            court.report("P6", f"the e-stop was latched {took_s:.3f} s after it was pressed (at most {INPUT_S:.3f} s)")

    def _pause(self, before: Mode, after: Mode) -> None:
        here = self.court.truth.base_xy_m
        if after is Mode.PAUSED:
            self._paused_xy_m = here
        elif before is Mode.PAUSED and after is Mode.AUTO:
            moved_m = math.dist(here, self._paused_xy_m)
            if moved_m > RESUME_M and not self.court.resume_asked:
                self.court.report("P17", f"resumed by itself {moved_m:.2f} m from where it was paused")
            self.court.resume_asked = False


class Leases(Monitor):
    """P20: with its process dead nobody holds the machine: the board ends the pulse of the valve and the lease of the
    pump, the drive's time-out halts the base, each by itself and in its time.
    """

    names = ("P20",)

    def __init__(self, court: Court) -> None:
        super().__init__(court)
        self._valve_on = self._pump_on = self._rolls = False

    def begin(self) -> None:
        self._valve_on = self._pump_on = self._rolls = False

    def killed(self) -> None:
        truth = self.court.truth
        self._valve_on, self._pump_on = truth.coil(Channel.VALVE), truth.coil(Channel.PUMP)
        self._rolls = not truth.base_rests

    def line(self, line: Line) -> None:
        court, rules = self.court, self.court.rules
        if court.killed_s is None:
            return
        since_s = line.t_s - court.killed_s
        if line.what == "coil_off" and line.detail["channel"] == Channel.VALVE.value:
            self._valve_on = self._judge(self._valve_on, "valve's coil", since_s, rules.max_pulse_s + LATE_S, "relay")
        elif line.what == "coil_off" and line.detail["channel"] == Channel.PUMP.value:
            self._pump_on = self._judge(self._pump_on, "pump", since_s, rules.pump_lease_s + LATE_S, "relay")
        elif line.what == "base_stopped":
            most_s = rules.drive_timeout_s + rules.drive_braking_s
            self._rolls = self._judge(self._rolls, "base", since_s, most_s, "wheels")

    def end(self) -> None:
        for held, part, device in (
            (self._valve_on, "valve's coil", "relay"), (self._pump_on, "pump", "relay"), (self._rolls, "base", "wheels")
        ):  # fmt: skip
            if held and self.court.killed_s is not None and self.court.truth.sound(device, but=NOT_WELDED):
                self.court.report("P20", f"the {part} never stopped after the process was killed")

    def _judge(self, held: bool, part: str, since_s: float, most_s: float, device: str) -> bool:
        """Whether it is still held: never, now that it has stopped."""
        if held and since_s > most_s and self.court.truth.sound(device, but=NOT_WELDED):
            self.court.report("P20", f"the {part} stopped {since_s:.2f} s after the kill (at most {most_s:.2f} s)")
        return False
