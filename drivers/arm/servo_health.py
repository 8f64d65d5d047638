"""What the driver knows of each servo, and what it tells of them and of itself."""

from __future__ import annotations

from dataclasses import dataclass, field

from drivers.arm.control_tables import REALTIME_TICK_S, REALTIME_TICKS

MISSES = 3  # in a row, until a servo counts as dead
TICK_TOLERANCE_S = 1.0


@dataclass(slots=True)
class ServoHealth:
    """One servo as of late. ``misses`` are requests in a row that it did not answer."""

    servo_id: int
    joint: str
    model: str
    firmware: int = 0
    alive: bool = True
    rebooted: bool = False
    torque_on: bool = False
    hardware_error: int = 0
    temperature_c: float | None = None
    voltage_v: float | None = None
    return_delay_s: float = 0.0
    misses: int = 0
    all_misses: int = 0
    watchdog_trips: int = 0
    tick: int | None = None
    tick_at_s: float = 0.0

    def answered(self) -> None:
        self.misses = 0

    def missed(self) -> None:
        """One more; the third in a row and it counts as dead."""
        self.misses += 1
        self.all_misses += 1
        if self.misses >= MISSES:
            self.alive = False

    def note_tick(self, tick: int, at_s: float) -> None:
        """The servo's own clock; where it has jumped the servo has begun anew."""
        if self.tick is not None:
            passed = round((at_s - self.tick_at_s) / REALTIME_TICK_S)
            off = (tick - self.tick - passed + REALTIME_TICKS // 2) % REALTIME_TICKS - REALTIME_TICKS // 2
            if abs(off) * REALTIME_TICK_S > TICK_TOLERANCE_S:
                self.rebooted = True
        self.tick, self.tick_at_s = tick, at_s


@dataclass(frozen=True, slots=True)
class ServoDiagnostics:
    """One servo, for the one who looks after the arm."""

    servo_id: int
    joint: str
    model: str
    firmware: int
    alive: bool
    rebooted: bool
    torque_on: bool
    hardware_error: int
    temperature_c: float | None
    voltage_v: float | None
    return_delay_s: float
    missed: int
    watchdog_trips: int


@dataclass(frozen=True, slots=True)
class ArmDiagnostics:
    """The arm's bus since it was opened. Cycle times are from goal to goal of the trajectories followed.

    ``notes`` are findings that do not stop the arm from working.
    """

    servos: tuple[ServoDiagnostics, ...]
    cycles: int
    cycle_mean_s: float
    cycle_worst_s: float
    late_cycles: int
    garbled: int
    silences: int
    notes: tuple[str, ...]


@dataclass(slots=True)
class Cadence:
    """How evenly the goals go out. A cycle over one and a half times its due is late."""

    due_s: float
    cycles: int = 0
    late: int = 0
    worst_s: float = 0.0
    _sum_s: float = 0.0
    _last_s: float | None = field(default=None)

    def begin(self) -> None:
        self._last_s = None

    def note(self, now_s: float) -> float:
        """A goal goes out; the time since the one before, 0 for the first of a trajectory."""
        gap_s = 0.0 if self._last_s is None else now_s - self._last_s
        if self._last_s is not None:
            self.cycles += 1
            self._sum_s += gap_s
            self.worst_s = max(self.worst_s, gap_s)
            self.late += gap_s > 1.5 * self.due_s
        self._last_s = now_s
        return gap_s

    @property
    def mean_s(self) -> float:
        return self._sum_s / self.cycles if self.cycles else 0.0


def told(health: ServoHealth) -> ServoDiagnostics:
    return ServoDiagnostics(
        servo_id=health.servo_id,
        joint=health.joint,
        model=health.model,
        firmware=health.firmware,
        alive=health.alive,
        rebooted=health.rebooted,
        torque_on=health.torque_on,
        hardware_error=health.hardware_error,
        temperature_c=health.temperature_c,
        voltage_v=health.voltage_v,
        return_delay_s=health.return_delay_s,
        missed=health.all_misses,
        watchdog_trips=health.watchdog_trips,
    )
