"""Forward kinematics and Jacobian, for one or many sets of joint angles at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.aiming.urdf import ArmModel
from robot.geometry import Vector


@dataclass(frozen=True, slots=True, eq=False)
class LinkFrames:
    """Frames in the arm's base frame: entry 0 the root link, k the link behind joint k, the last the nozzle.

    ``rotation`` (..., n + 2, 3, 3), ``origin_m`` (..., n + 2, 3) for n joints.
    """

    rotation: Vector
    origin_m: Vector

    @property
    def nozzle_m(self) -> Vector:
        """Nozzle tip (..., 3)."""
        return self.origin_m[..., -1, :]

    @property
    def spray_axis(self) -> Vector:
        """Unit spray axis (..., 3), out of the nozzle."""
        return self.rotation[..., -1, :, 0]


def rotations_about(axes: Vector, angles_rad: Vector) -> Vector:
    """Rodrigues' formula: unit ``axes`` (..., 3), ``angles_rad`` (...) -> (..., 3, 3)."""
    cross = cross_matrices(axes)
    sine, cosine = np.sin(angles_rad)[..., None, None], np.cos(angles_rad)[..., None, None]
    return np.asarray(np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross))


def cross_matrices(vectors: Vector) -> Vector:
    """(..., 3) -> (..., 3, 3) with ``cross_matrices(a) @ b == cross(a, b)``."""
    out = np.zeros((*vectors.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -vectors[..., 2], vectors[..., 1], -vectors[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = vectors[..., 2], -vectors[..., 1], vectors[..., 0]
    return out


def link_frames(model: ArmModel, joints_rad: Vector) -> LinkFrames:
    """Frames of all links at ``joints_rad`` (..., n)."""
    angles = np.asarray(joints_rad, dtype=np.float64)
    count = len(model.joints)
    if angles.shape[-1:] != (count,):
        raise ValueError(f"expected {count} joint angles, found shape {angles.shape}; give one angle a joint")
    turned = rotations_about(np.stack([joint.axis for joint in model.joints]), angles)
    rotation = np.empty((*angles.shape[:-1], count + 2, 3, 3))
    origin_m = np.empty((*angles.shape[:-1], count + 2, 3))
    rotation[..., 0, :, :], origin_m[..., 0, :] = np.eye(3), 0.0
    for k, joint in enumerate(model.joints):
        fixed = joint.parent_from_joint
        origin_m[..., k + 1, :] = origin_m[..., k, :] + rotation[..., k, :, :] @ fixed.translation_m
        rotation[..., k + 1, :, :] = rotation[..., k, :, :] @ (fixed.rotation @ turned[..., k, :, :])
    fixed = model.last_from_nozzle
    origin_m[..., -1, :] = origin_m[..., -2, :] + rotation[..., -2, :, :] @ fixed.translation_m
    rotation[..., -1, :, :] = rotation[..., -2, :, :] @ fixed.rotation
    return LinkFrames(rotation, origin_m)


def nozzle_jacobian(model: ArmModel, joints_rad: Vector) -> Vector:
    """Geometric Jacobian (..., 6, n): tip velocity (m/s) over angular velocity (rad/s) per joint velocity (rad/s)."""
    frames = link_frames(model, joints_rad)
    axes = np.stack([joint.axis for joint in model.joints])
    turning = (frames.rotation[..., 1:-1, :, :] @ axes[:, :, None])[..., 0]
    moving = np.cross(turning, frames.nozzle_m[..., None, :] - frames.origin_m[..., 1:-1, :])
    return np.concatenate([np.swapaxes(moving, -1, -2), np.swapaxes(turning, -1, -2)], axis=-2)


def within_limits(model: ArmModel, joints_rad: Vector, tolerance_rad: float = 1e-9) -> npt.NDArray[np.bool_]:
    """Whether all angles of ``joints_rad`` (..., n) lie inside the position limits; result (...)."""
    angles = np.asarray(joints_rad, dtype=np.float64)
    inside = (angles >= model.lower_rad - tolerance_rad) & (angles <= model.upper_rad + tolerance_rad)
    return np.asarray(inside.all(axis=-1))


def joint_reach_m(model: ArmModel) -> Vector:
    """(n,) bound on the distance of any point of the arm from each joint's axis, over all angles."""
    reach = np.zeros(len(model.joints))
    beyond = float(np.linalg.norm(model.last_from_nozzle.translation_m))
    for k in reversed(range(len(model.joints))):
        on_link = [
            float(np.linalg.norm([item.capsule.start_m, item.capsule.end_m], axis=1).max()) + item.capsule.radius_m
            for item in model.capsules
            if item.link == k + 1
        ]
        beyond = max([beyond, *on_link])
        reach[k] = beyond
        beyond += float(np.linalg.norm(model.joints[k].parent_from_joint.translation_m))
    return reach
