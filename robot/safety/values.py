"""What safety is told, what it is asked, and what it answers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

Cell = tuple[int, int]
"""A square metre of the row frame: its corner's x and y in whole metres."""


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
    the target was last seen; ``arm_settled`` that every joint has been within tolerance of its goal long enough;
    ``battery_v`` an average over some readings; ``moved_since_pause_m`` how far the base rolled since the last pause;
    ``fence_margin_m`` the distance to the geofence from inside, less the pose's uncertainty, infinite without one;
    ``arm_errors`` the servos' error bytes, one a joint.
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
    pump_coil: bool = False
    battery_v: float = math.inf
    moved_since_pause_m: float = 0.0
    fence_margin_m: float = math.inf
    arm_torque_on: bool = True
    arm_errors: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class MotionRequest:
    """Base: forward speed and yaw rate (both 0 is always allowed). Arm: ``speed_m_s`` and ``yaw_rate_rad_s`` stay 0."""

    part: str  # "base" or "arm"
    speed_m_s: float = 0.0
    yaw_rate_rad_s: float = 0.0


@dataclass(frozen=True, slots=True)
class SprayRequest:
    """One valve opening. ``full_ml`` is the most that the board's whole pulse can give; ``pulse_s`` its timer; ``cell``
    the square metre in which the target stands, None for a shot at nothing."""

    target_id: int
    dose_ml: float
    full_ml: float
    open_s: float
    pulse_s: float
    cell: Cell | None = None


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
    cell: Cell | None = None


@dataclass(frozen=True, slots=True)
class ActiveFault:
    """A fault of the catalogue that lasts, or that nobody has acknowledged yet."""

    id: str
    text: str
    since_s: float


@dataclass(frozen=True, slots=True)
class Lease:
    """Who may move the machine by hand, and when they last gave a sign of life."""

    holder: str
    since_s: float
    beat_s: float


@dataclass(frozen=True, slots=True)
class Given:
    """Liquid of earlier runs that counts for the caps: of the task, of this day, by target and by square metre.

    ``recent`` holds what counts for the rolling minute: (loop time at which it was given, ml).
    """

    task_ml: float = 0.0
    day_ml: float = 0.0
    target_ml: tuple[tuple[int, float], ...] = ()
    cell_ml: tuple[tuple[Cell, float], ...] = ()
    recent: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class SafetyState:
    """What safety remembers. ``causes`` says why a latched or paused mode is so, oldest first.

    ``bookings`` hold this run's liquid, ``given`` what counts from before; ``self_resume`` that a pause may end without
    an operator; ``rolling_since_s`` since when the base rolls though nobody asks it to.
    """

    mode: Mode = Mode.DISARMED
    causes: tuple[str, ...] = ()
    bookings: tuple[Booking, ...] = ()
    given: Given = Given()
    faults: tuple[ActiveFault, ...] = ()
    lease: Lease | None = None
    self_resume: bool = False
    rolling_since_s: float | None = None
