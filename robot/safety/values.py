"""What safety is told, what it is asked, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Mode(StrEnum):
    """Who may move what. The only authority over motion and spray."""

    DISARMED = "disarmed"
    READY = "ready"          # armed, nothing moves
    AUTO = "auto"            # the mission acts
    MANUAL = "manual"        # an operator acts, hold-to-run
    PAUSED = "paused"
    SAFE_STOP = "safe_stop"  # latched: needs an acknowledgement
    ESTOP = "estop"          # latched: needs the button released, a reset, and arming


@dataclass(frozen=True, slots=True)
class Inputs:
    """The newest readings of the machine; every ``*_s`` is the loop time at which they were taken.

    ``tank_left_ml`` is the ledger's balance; ``moved_since_frame_m`` how far the base rolled since the frame in which
    the target was last seen; ``arm_settled`` that every joint has been within tolerance of its goal long enough.
    """

    sensors_s: float
    estop_pressed: bool
    bumper_pressed: bool
    tilt_rad: float
    pressure_bar: float
    odometry_s: float
    base_speed_m_s: float
    moved_since_frame_m: float
    base_commanded: bool
    arm_s: float
    arm_settled: bool
    arm_stowed: bool
    arm_healthy: bool
    relay_s: float
    valve_coil: bool
    tank_left_ml: float


@dataclass(frozen=True, slots=True)
class MotionRequest:
    """Base: forward speed and yaw rate (both 0 is always allowed). Arm: ``speed_m_s`` and ``yaw_rate_rad_s`` stay 0."""

    part: str  # "base" or "arm"
    speed_m_s: float = 0.0
    yaw_rate_rad_s: float = 0.0


@dataclass(frozen=True, slots=True)
class SprayRequest:
    """One valve opening. ``full_ml`` is the most that the board's whole pulse can give; ``pulse_s`` its timer."""

    target_id: int
    dose_ml: float
    full_ml: float
    open_s: float
    pulse_s: float


@dataclass(frozen=True, slots=True)
class Decision:
    """Allowed when there is no reason against it."""

    reasons: tuple[str, ...]

    @property
    def allowed(self) -> bool:
        return not self.reasons


@dataclass(frozen=True, slots=True)
class Booking:
    """Liquid that left, or may leave, the nozzle. While ``pending`` the millilitres are the upper bound."""

    number: int
    stamp_s: float
    target_id: int
    ml: float
    pending: bool


@dataclass(frozen=True, slots=True)
class SafetyState:
    """What safety remembers. ``causes`` says why a latched mode is latched, oldest first.

    ``bookings`` hold this run's liquid; ``task_ml`` and ``target_ml`` what earlier runs of the task gave.
    """

    mode: Mode = Mode.DISARMED
    causes: tuple[str, ...] = ()
    bookings: tuple[Booking, ...] = ()
    task_ml: float = 0.0
    target_ml: tuple[tuple[int, float], ...] = ()
