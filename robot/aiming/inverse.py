"""Inverse kinematics: nozzle position and spray axis -> joint angles. The turn about the spray axis is free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.aiming.inverse_numeric import solve_numeric
from robot.aiming.inverse_spherical import find_spherical_wrist, solve_spherical
from robot.aiming.kinematics import link_frames, within_limits
from robot.aiming.urdf import ArmModel
from robot.geometry import Vector

POSITION_TOLERANCE_M = 1e-4
AXIS_TOLERANCE_RAD = np.radians(0.01)


@dataclass(frozen=True, slots=True, eq=False)
class Solutions:
    """``joints_rad`` (..., k, n): up to k sets of angles for each pose; ``in_reach`` (..., k): they reach the pose;
    ``valid`` (..., k): and lie inside the limits."""

    joints_rad: Vector
    in_reach: npt.NDArray[np.bool_]
    valid: npt.NDArray[np.bool_]


def inverse_kinematics(model: ArmModel, nozzle_m: Vector, spray_axis: Vector, seed_rad: Vector) -> Solutions:
    """All solutions inside the limits (closed form for a spherical wrist), else some (damped least squares).

    ``nozzle_m`` and ``spray_axis`` (..., 3) in the arm's base frame; ``seed_rad`` (n,) chooses what the pose leaves
    free (the last joint of a spherical wrist, whole turns) and where iterations start. Each valid solution reaches
    the pose within 0.1 mm and 0.01 degrees, checked by forward kinematics.
    """
    position = np.asarray(nozzle_m, dtype=np.float64)
    axis = np.asarray(spray_axis, dtype=np.float64)
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    seed = np.asarray(seed_rad, dtype=np.float64)
    wrist = find_spherical_wrist(model)
    if wrist is None:
        found = solve_numeric(model, position, axis, seed)
    else:
        found = solve_spherical(wrist, position, axis, seed)
    joints = _turns_inside_limits(model, found, seed)
    in_reach = _reached(model, joints, position, axis)
    return Solutions(joints, in_reach, in_reach & within_limits(model, joints))


def nearest_solution(model: ArmModel, nozzle_m: Vector, spray_axis: Vector, seed_rad: Vector) -> Vector | None:
    """The solution (n,) whose largest joint move from ``seed_rad`` is smallest, or None. One pose (3,), (3,)."""
    solutions = inverse_kinematics(model, nozzle_m, spray_axis, seed_rad)
    if not solutions.valid.any():
        return None
    candidates = solutions.joints_rad[solutions.valid]
    return np.asarray(candidates[np.abs(candidates - np.asarray(seed_rad)).max(axis=-1).argmin()])


def _turns_inside_limits(model: ArmModel, joints: Vector, seed: Vector) -> Vector:
    """Add whole turns: inside the limits first, then nearest to the seed."""
    nearest = seed + np.mod(joints - seed + np.pi, 2 * np.pi) - np.pi
    options = nearest[..., None] + 2 * np.pi * np.array([0.0, -1.0, 1.0])
    low, high = model.lower_rad[:, None], model.upper_rad[:, None]
    inside = (options >= low - 1e-9) & (options <= high + 1e-9)
    choice = np.argmax(inside, axis=-1)[..., None]
    chosen = np.take_along_axis(options, choice, axis=-1)[..., 0]
    any_inside = inside.any(axis=-1)
    return np.where(any_inside, np.clip(chosen, low[:, 0], high[:, 0]), chosen)


def _reached(model: ArmModel, joints: Vector, position: Vector, axis: Vector) -> npt.NDArray[np.bool_]:
    frames = link_frames(model, np.nan_to_num(joints))
    off_m = np.linalg.norm(frames.nozzle_m - position[..., None, :], axis=-1)
    off_axis = np.linalg.norm(np.cross(frames.spray_axis, axis[..., None, :]), axis=-1)
    same_way = np.einsum("...k,...k->...", frames.spray_axis, axis[..., None, :]) > 0.0
    finite = np.isfinite(joints).all(axis=-1)
    return np.asarray(finite & same_way & (off_m < POSITION_TOLERANCE_M) & (off_axis < np.sin(AXIS_TOLERANCE_RAD)))
