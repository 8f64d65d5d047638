"""How the true machine differs from what the robot is told."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.twin.nominal import Nominal

Array = npt.NDArray[np.float64]

MOUNT_SHIFT_M = 0.002
MOUNT_TURN_RAD = math.radians(0.3)
FLOW_SHARE = 0.04
VALVE_S = 0.005
WHEEL_SHARE = 0.01
WHEEL_DIFFERENCE_SHARE = 0.0005
JOINT_ZERO_RAD = math.radians(0.05)
METER_SHARE = 0.02
PRESSURE_SHARE = 0.01
LEVEL_SHARE = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class TrueMachine:
    """The parameters that the physics uses.

    ``joint_zero_rad`` is added to the encoder's angle; the ``*_gain`` are reading over truth; wheels (left, right).
    """

    base_from_camera: Array
    nozzle_flow_ml_s: float
    valve_open_s: float
    valve_close_s: float
    wheel_radius_m: tuple[float, float]
    joint_zero_rad: tuple[float, ...]
    flow_meter_gain: float
    pressure_gain: float
    level_offset_ml: float


def exact(nominal: Nominal) -> TrueMachine:
    """A machine that is just as the robot is told."""
    return TrueMachine(
        base_from_camera=nominal.base_from_camera,
        nozzle_flow_ml_s=nominal.nozzle_flow_ml_s,
        valve_open_s=nominal.valve_open_s,
        valve_close_s=nominal.valve_close_s,
        wheel_radius_m=(nominal.wheel_radius_m, nominal.wheel_radius_m),
        joint_zero_rad=(0.0,) * len(nominal.stow_rad),
        flow_meter_gain=1.0,
        pressure_gain=1.0,
        level_offset_ml=0.0,
    )


def draw(nominal: Nominal, seed: int) -> TrueMachine:
    """A machine drawn by seed, uniform within the bounds above; the camera's mount is what is off in hand-eye."""
    rng = np.random.default_rng([seed, 0xDE71])

    def within(bound: float) -> float:
        return float(rng.uniform(-bound, bound))

    mount = np.eye(4)
    mount[:3, :3] = _rotation(_direction(rng) * within(MOUNT_TURN_RAD))
    mount[:3, 3] = _direction(rng) * within(MOUNT_SHIFT_M)
    wheel = nominal.wheel_radius_m * (1.0 + within(WHEEL_SHARE))
    uneven = within(WHEEL_DIFFERENCE_SHARE)
    return TrueMachine(
        base_from_camera=nominal.base_from_camera @ mount,
        nozzle_flow_ml_s=nominal.nozzle_flow_ml_s * (1.0 + within(FLOW_SHARE)),
        valve_open_s=max(0.0, nominal.valve_open_s + within(VALVE_S)),
        valve_close_s=max(0.0, nominal.valve_close_s + within(VALVE_S)),
        wheel_radius_m=(wheel * (1.0 - 0.5 * uneven), wheel * (1.0 + 0.5 * uneven)),
        joint_zero_rad=tuple(within(JOINT_ZERO_RAD) for _ in nominal.stow_rad),
        flow_meter_gain=1.0 + within(METER_SHARE),
        pressure_gain=1.0 + within(PRESSURE_SHARE),
        level_offset_ml=nominal.tank_ml * within(LEVEL_SHARE),
    )


def _direction(rng: np.random.Generator) -> Array:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def _rotation(vector_rad: Array) -> Array:
    """Rodrigues' formula."""
    angle = float(np.linalg.norm(vector_rad))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector_rad / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross))
