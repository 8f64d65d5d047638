"""Closed-form inverse kinematics of a six-joint arm with a spherical wrist.

Joint screws at angle zero (product of exponentials; Murray, Li, Sastry, A Mathematical Introduction to Robotic
Manipulation, ch. 3): the wrist centre fixes joints 1-3 (waist angle, then a planar two-link arm), the spray axis
fixes joints 4 and 5 (Paden-Kahan subproblem 2), joint 6 turns about the spray axis and keeps its seed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot.aiming.kinematics import link_frames, rotations_about
from robot.aiming.urdf import ArmModel
from robot.geometry import Vector

_EXACT = 1e-6
_SINGULAR = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class SphericalWrist:
    """The arm at angle zero, in its base frame: ``axes`` (6, 3), one point on each of the axes 1, 2 and 3, the
    ``centre_m`` where axes 4, 5 and 6 meet, the ``spray_axis`` and how far the nozzle lies from the centre along it."""

    axes: Vector
    waist_m: Vector
    shoulder_m: Vector
    elbow_m: Vector
    centre_m: Vector
    spray_axis: Vector
    nozzle_from_centre_m: float


def find_spherical_wrist(model: ArmModel) -> SphericalWrist | None:
    """The wrist's geometry, or None when the arm has no closed form here.

    Needed: six joints, axes 4-6 through one point, axis 1 perpendicular to parallel axes 2 and 3, nozzle and spray
    axis on axis 6.
    """
    if len(model.joints) != 6:
        return None
    frames = link_frames(model, np.zeros(6))
    own = np.stack([joint.axis for joint in model.joints])
    axes = (frames.rotation[1:-1] @ own[:, :, None])[..., 0]
    points = frames.origin_m[1:-1]
    off_axis = np.eye(3) - axes[3:, :, None] * axes[3:, None, :]
    centre = np.linalg.lstsq(off_axis.reshape(9, 3), (off_axis @ points[3:, :, None]).reshape(9), rcond=None)[0]
    misses = np.linalg.norm((off_axis @ (centre - points[3:])[:, :, None])[..., 0], axis=-1)
    along = float((frames.nozzle_m - centre) @ frames.spray_axis)
    fits = (
        misses.max() < _EXACT
        and abs(axes[0] @ axes[1]) < _EXACT
        and np.linalg.norm(np.cross(axes[1], axes[2])) < _EXACT
        and np.linalg.norm(np.cross(axes[3], axes[4])) > 0.1
        and np.linalg.norm(np.cross(axes[5], frames.spray_axis)) < _EXACT
        and np.linalg.norm(centre + along * frames.spray_axis - frames.nozzle_m) < _EXACT
    )
    if not fits:
        return None
    centre_m = np.asarray(centre, dtype=np.float64)
    return SphericalWrist(axes, points[0], points[1], points[2], centre_m, frames.spray_axis, along)


def solve_spherical(wrist: SphericalWrist, nozzle_m: Vector, spray_axis: Vector, seed_rad: Vector) -> Vector:
    """Eight branches (waist, elbow, wrist) for each pose (..., 3): (..., 8, 6), NaN where a branch has no solution."""
    centre = (nozzle_m - wrist.nozzle_from_centre_m * spray_axis)[..., None, None, None, :]
    waist_side = np.array([1.0, -1.0])[:, None, None]
    elbow_side = np.array([1.0, -1.0])[None, :, None]
    wrist_side = np.array([1.0, -1.0])[None, None, :]
    with np.errstate(invalid="ignore"):
        q1, q2, q3 = _position(wrist, centre, waist_side, elbow_side, seed_rad)
        q4, q5 = _direction(wrist, spray_axis[..., None, None, None, :], (q1, q2, q3), wrist_side, seed_rad)
    shape = q4.shape
    parts = [np.broadcast_to(angle, shape) for angle in (q1, q2, q3, q4, q5, np.asarray(seed_rad[5]))]
    joints = np.stack(parts, axis=-1)
    return np.asarray(joints.reshape(*shape[:-3], 8, 6))


def _position(
    wrist: SphericalWrist, centre: Vector, waist_side: Vector, elbow_side: Vector, seed: Vector
) -> tuple[Vector, Vector, Vector]:
    """Joints 1-3 that bring the wrist's centre to ``centre``."""
    up, side = wrist.axes[0], wrist.axes[1]
    out = np.cross(side, up)
    lateral = float((wrist.centre_m - wrist.waist_m) @ side)
    reach = centre - wrist.waist_m
    a, b, height = reach @ out, reach @ side, reach @ up
    forward = waist_side * np.sqrt(a * a + b * b - lateral * lateral)
    q1 = np.arctan2(b, a) - np.arctan2(lateral, forward)
    q1 = np.where(a * a + b * b < _SINGULAR**2, seed[0], q1)

    def planar(vector: Vector) -> complex:
        return complex(vector @ up, vector @ out)

    # in the plane of the arm a vector is the number z + i x, and a turn q about the side axis is exp(i q)
    from_waist = planar(wrist.shoulder_m - wrist.waist_m)
    upper, lower = planar(wrist.elbow_m - wrist.shoulder_m), planar(wrist.centre_m - wrist.elbow_m)
    target = height + 1j * forward - from_waist
    same_way = float(np.sign(wrist.axes[1] @ wrist.axes[2]))
    cosine = (np.abs(target) ** 2 - abs(upper) ** 2 - abs(lower) ** 2) / (2.0 * abs(upper) * abs(lower))
    cosine = np.where(np.abs(cosine) < 1.0 + _SINGULAR, np.clip(cosine, -1.0, 1.0), np.nan)
    bend = elbow_side * np.arccos(cosine) - np.angle(lower) + np.angle(upper)
    q2 = np.angle(target) - np.angle(upper + lower * np.exp(1j * bend))
    return q1, q2, same_way * bend


def _direction(
    wrist: SphericalWrist, spray_axis: Vector, arm: tuple[Vector, Vector, Vector], wrist_side: Vector, seed: Vector
) -> tuple[Vector, Vector]:
    """Joints 4 and 5 that turn the spray axis into place behind joints 1-3."""
    w4, w5, start = wrist.axes[3], wrist.axes[4], wrist.spray_axis
    turned = (
        rotations_about(wrist.axes[0], arm[0])
        @ rotations_about(wrist.axes[1], arm[1])
        @ rotations_about(wrist.axes[2], arm[2])
    )
    wanted = (np.swapaxes(turned, -1, -2) @ spray_axis[..., None])[..., 0]
    between, normal = float(w4 @ w5), np.cross(w4, w5)
    on4, on5 = wanted @ w4, float(start @ w5)
    alpha = (between * on5 - on4) / (between**2 - 1.0)
    beta = (between * on4 - on5) / (between**2 - 1.0)
    squared = (1.0 - alpha**2 - beta**2 - 2.0 * alpha * beta * between) / float(normal @ normal)
    gamma = wrist_side * np.sqrt(np.where(np.abs(squared) < 1e-15, 0.0, squared))
    middle = alpha[..., None] * w4 + beta[..., None] * w5 + gamma[..., None] * normal
    q5 = _angle_about(w5, start, middle)
    q4 = _angle_about(w4, middle, wanted)
    straight = np.linalg.norm(np.cross(wanted, w4), axis=-1) < _SINGULAR
    return np.where(straight, seed[3], q4), np.broadcast_to(q5, q4.shape)


def _angle_about(axis: Vector, start: Vector, end: Vector) -> Vector:
    across = np.cross(start, end) @ axis
    along = np.einsum("...k,...k->...", start, end) - (start @ axis) * (end @ axis)
    return np.asarray(np.arctan2(across, along))
