"""Inverse kinematics by damped least squares with restarts, for arms without a closed form."""

from __future__ import annotations

import numpy as np

from robot.aiming.kinematics import link_frames, nozzle_jacobian
from robot.aiming.low_discrepancy import spread_between
from robot.aiming.urdf import ArmModel
from robot.geometry import Vector

_STARTS_INSIDE = 16
_STARTS_FREE = 48
_ITERATIONS = 60
_LEVER_M = 0.3
_DAMPING = 1e-3
_STEP_RAD = 0.4
_SOLVED = 1e-9


def solve_numeric(model: ArmModel, nozzle_m: Vector, spray_axis: Vector, seed_rad: Vector) -> Vector:
    """Up to 64 candidates for each pose (..., 3): (..., k, n); the caller checks which ones reached it.

    The same starts for every call: the seed, then fixed spreads inside the limits. First with the angles held inside
    the limits; when a pose stays unsolved, also free of them, which finds folded postures in the limits' corners.
    Damped least squares on tip position and axis error (weighted by a lever of 0.3 m; Wampler 1986).
    """
    lower, upper = model.lower_rad, model.upper_rad
    starts = spread_between(lower, upper, _STARTS_INSIDE + _STARTS_FREE)
    starts[0] = np.clip(seed_rad, lower, upper)
    position, axis = nozzle_m[..., None, :], spray_axis[..., None, :]
    inside, solved = _descend(model, position, axis, starts[:_STARTS_INSIDE], (lower, upper))
    if solved:
        return inside
    endless = np.full_like(lower, np.inf)
    free, _ = _descend(model, position, axis, starts[_STARTS_INSIDE:], (-endless, endless))
    return np.concatenate([inside, free], axis=-2)


def _descend(
    model: ArmModel, position: Vector, axis: Vector, starts: Vector, bounds: tuple[Vector, Vector]
) -> tuple[Vector, bool]:
    """Angles (..., k, n) from each of ``starts`` (k, n); stops early, and says so, when every pose has a solution
    within finite bounds."""
    joints = np.broadcast_to(starts, (*position.shape[:-2], *starts.shape)).copy()
    bounded = bool(np.isfinite(bounds[0]).all())
    for _ in range(_ITERATIONS):
        frames = link_frames(model, joints)
        off = np.concatenate([position - frames.nozzle_m, _LEVER_M * _turn_to(frames.spray_axis, axis)], axis=-1)
        if bounded and float(np.abs(off).max(axis=-1).min(axis=-1).max()) < _SOLVED:
            return joints, True
        jacobian = nozzle_jacobian(model, joints)
        across = np.eye(3) - frames.spray_axis[..., :, None] * frames.spray_axis[..., None, :]
        jacobian[..., 3:, :] = _LEVER_M * (across @ jacobian[..., 3:, :])
        normal = jacobian @ np.swapaxes(jacobian, -1, -2)
        damping = _DAMPING * np.minimum(1.0, np.einsum("...k,...k->...", off, off))[..., None, None] + 1e-12
        step = (np.swapaxes(jacobian, -1, -2) @ np.linalg.solve(normal + damping * np.eye(6), off[..., None]))[..., 0]
        largest = np.maximum(np.abs(step).max(axis=-1, keepdims=True) / _STEP_RAD, 1.0)
        joints = np.clip(joints + step / largest, *bounds)
    return joints, False


def _turn_to(start: Vector, end: Vector) -> Vector:
    """Rotation vectors that turn unit vectors ``start`` onto ``end``."""
    cross = np.cross(start, end)
    sine = np.linalg.norm(cross, axis=-1, keepdims=True)
    cosine = np.einsum("...k,...k->...", start, np.broadcast_to(end, start.shape))[..., None]
    angle = np.arctan2(sine, cosine)
    any_across = np.roll(start, 1, axis=-1) - np.roll(start, -1, axis=-1)
    direction = np.where(sine > 1e-9, cross / np.maximum(sine, 1e-12), any_across)
    return np.where((sine > 1e-9) | (cosine < 0.0), angle * direction, 0.0)

