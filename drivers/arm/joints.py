"""How joints are made of servos: ids, models, directions, zeros, and the way between angles and ticks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from drivers.arm.control_tables import EXTENDED_TICKS, MODELS, TICK_RAD, TICKS_PER_TURN, Model, OperatingMode

ZERO_TICK = TICKS_PER_TURN // 2
TORQUE_POLICIES = ("hold", "off")


@dataclass(frozen=True, slots=True)
class ServoSettings:
    """One servo. ``reversed``: its ticks fall when the joint's angle rises; ``zero_tick`` is where the angle is 0."""

    servo_id: int
    model: str
    reversed: bool = False
    zero_tick: int = ZERO_TICK

    @property
    def table(self) -> Model:
        return MODELS[self.model]

    @property
    def direction(self) -> int:
        return -1 if self.reversed else 1

    def tick_of(self, angle_rad: float) -> int:
        return self.zero_tick + self.direction * round(angle_rad / TICK_RAD)

    def angle_of(self, tick: int) -> float:
        return self.direction * (tick - self.zero_tick) * TICK_RAD


@dataclass(frozen=True, slots=True)
class JointSettings:
    """A joint and the one or two servos that turn it together; the first is the one its angle is read from."""

    name: str
    servos: tuple[ServoSettings, ...]
    low_rad: float
    high_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamixelSettings:
    """An arm of X-series servos. Raises ``ValueError`` for what cannot be.

    ``watchdog_s``: the servos stop when the host has been silent for so long (0.2 to 0.5 s). ``torque_on_close``: what
    becomes of the torque when the driver is closed. ``writes_return_delay``: a return delay other than 0 is set to 0 in
    the servo's EEPROM when its torque is off. ``minimum_firmware``: None takes any.
    """

    joints: tuple[JointSettings, ...]
    max_velocity_rad_s: float
    max_acceleration_rad_s2: float
    operating_mode: OperatingMode = OperatingMode.EXTENDED_POSITION
    watchdog_s: float = 0.3
    torque_on_close: Literal["hold", "off"] = "hold"
    cycle_s: float = 0.010
    fast_sync_read: bool = False
    writes_return_delay: bool = True
    minimum_firmware: int | None = None
    homing_offset_ticks: int = 0

    def __post_init__(self) -> None:
        ids = self.servo_ids
        if not self.joints or any(not 1 <= len(joint.servos) <= 2 for joint in self.joints):
            raise ValueError("arm: expected joints of one or two servos; correct the servos of the configuration")
        if len(set(ids)) != len(ids):
            twice = sorted({servo_id for servo_id in ids if ids.count(servo_id) > 1})
            raise ValueError(f"arm: servo id {twice[0]} stands at two places; give each servo its own id")
        if not 0.2 <= self.watchdog_s <= 0.5:
            raise ValueError(f"arm: expected a watchdog of 0.2 to 0.5 s, found {self.watchdog_s:g} s")
        if self.torque_on_close not in TORQUE_POLICIES:
            raise ValueError(f"arm: expected torque on close to be hold or off, found {self.torque_on_close!r}")
        for joint in self.joints:
            if not joint.low_rad < joint.high_rad:
                raise ValueError(f"arm: {joint.name}: expected a lower limit below the upper one")
            for servo in joint.servos:
                self._check(joint, servo)

    def _check(self, joint: JointSettings, servo: ServoSettings) -> None:
        if servo.model not in MODELS:
            known = ", ".join(MODELS)
            raise ValueError(f"arm: servo {servo.servo_id}: unknown model {servo.model!r}; known are {known}")
        low, high = sorted((servo.tick_of(joint.low_rad), servo.tick_of(joint.high_rad)))
        least, most = self.tick_range
        if low < least - 1 or high > most + 1:  # half a turn from the middle is one tick too far
            raise ValueError(
                f"arm: {joint.name}: its limits are ticks {low} to {high} of servo {servo.servo_id}, beyond what "
                f"its operating mode can do ({least} to {most}); correct zero or limits, or use extended position mode"
            )

    @property
    def joint_names(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.joints)

    @property
    def servos(self) -> tuple[ServoSettings, ...]:
        return tuple(servo for joint in self.joints for servo in joint.servos)

    @property
    def servo_ids(self) -> tuple[int, ...]:
        return tuple(servo.servo_id for servo in self.servos)

    @property
    def joint_of(self) -> Mapping[int, int]:
        """Index of the joint that a servo turns, by the servo's id."""
        return {servo.servo_id: k for k, joint in enumerate(self.joints) for servo in joint.servos}

    @property
    def tick_range(self) -> tuple[int, int]:
        if self.operating_mode is OperatingMode.POSITION:
            return 0, TICKS_PER_TURN - 1
        return -EXTENDED_TICKS, EXTENDED_TICKS

    def ticks_of(self, angles_rad: Sequence[float]) -> dict[int, int]:
        """Goal of every servo for the joints' angles, by id."""
        least, most = self.tick_range
        return {
            servo.servo_id: min(max(servo.tick_of(angle), least), most)
            for joint, angle in zip(self.joints, angles_rad, strict=True)
            for servo in joint.servos
        }
