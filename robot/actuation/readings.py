"""The newest readings of the machine, as safety wants them."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from drivers.arm.values import ArmState
from drivers.inputs.values import InputState
from drivers.relay.values import Channel, RelayState
from drivers.wheels.values import Odometry
from robot import safety
from robot.actuation.values import HandSettings

STOWED_TOLERANCE_RAD = 0.04
BATTERY_READINGS = 10


@dataclass(slots=True, eq=False)
class Readings:
    """What was read last, and what was commanded: filled by the polls and by every command."""

    settings: HandSettings
    sensors: InputState | None = None
    odometry: Odometry | None = None
    arm: ArmState | None = None
    relay: RelayState | None = None
    frame_mark: Odometry | None = None
    goal_rad: tuple[float, ...] | None = None
    arm_settled: bool = False
    base_commanded: bool = False
    tank_left_ml: float = 0.0
    pause_mark: Odometry | None = None
    fence_margin_m: float = math.inf
    battery_v: deque[float] = field(default_factory=lambda: deque(maxlen=BATTERY_READINGS))

    @property
    def joints_rad(self) -> tuple[float, ...] | None:
        return self.arm.position_rad if self.arm else None

    @property
    def arm_stowed(self) -> bool:
        joints = self.joints_rad
        return joints is not None and all(
            abs(a - b) <= STOWED_TOLERANCE_RAD for a, b in zip(joints, self.settings.stow_rad, strict=True)
        )

    @property
    def moved_since_frame_m(self) -> float:
        """How far a wheel rolled since the newest frame; infinite when nobody knows."""
        return self._rolled_since(self.frame_mark)

    def _rolled_since(self, mark: Odometry | None) -> float:
        now = self.odometry
        if now is None or mark is None:
            return math.inf
        return max(abs(now.left_m - mark.left_m), abs(now.right_m - mark.right_m))

    @property
    def off_goal_rad(self) -> float:
        """The largest distance of a joint from its goal; 0 without a goal."""
        joints = self.joints_rad
        if joints is None or self.goal_rad is None:
            return 0.0
        return max(abs(a - b) for a, b in zip(joints, self.goal_rad, strict=True))

    def take_sensors(self, reading: InputState) -> None:
        self.sensors = reading
        self.battery_v.append(reading.battery_v)

    def take_arm(self, state: ArmState) -> None:
        """A joint that leaves its goal unsettles the arm."""
        self.arm = state
        if self.off_goal_rad > self.settings.settle_tolerance_rad:
            self.arm_settled = False

    def inputs(self) -> safety.Inputs | None:
        """None until every device has reported."""
        if not (self.sensors and self.odometry and self.arm and self.relay):
            return None
        return safety.Inputs(
            sensors_s=self.sensors.stamp_s,
            estop_pressed=self.sensors.estop_pressed,
            bumper_pressed=self.sensors.bumper_pressed,
            tilt_rad=max(abs(self.sensors.roll_rad), abs(self.sensors.pitch_rad)),
            pressure_bar=self.sensors.pressure_bar,
            odometry_s=self.odometry.stamp_s,
            base_speed_m_s=max(abs(self.odometry.left_m_s), abs(self.odometry.right_m_s)),
            moved_since_frame_m=self.moved_since_frame_m,
            base_commanded=self.base_commanded,
            arm_s=self.arm.stamp_s,
            arm_settled=self.arm_settled,
            arm_stowed=self.arm_stowed,
            arm_healthy=self.arm.torque_on and not any(self.arm.hardware_error),
            relay_s=self.relay.stamp_s,
            valve_coil=self.relay.coils.get(Channel.VALVE, True),
            tank_left_ml=self.tank_left_ml,
            pump_coil=self.relay.coils.get(Channel.PUMP, False),
            battery_v=sum(self.battery_v) / len(self.battery_v) if self.battery_v else math.inf,
            moved_since_pause_m=self._rolled_since(self.pause_mark),
            fence_margin_m=self.fence_margin_m,
            arm_torque_on=self.arm.torque_on,
            arm_errors=tuple(self.arm.hardware_error),
        )
