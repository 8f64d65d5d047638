"""From which sides the nozzle may look at a fruit, and what else the spray would meet."""

from __future__ import annotations

import math

import numpy as np

from robot.aiming.capsules import Box, Capsule, Sphere, segment_box_m, segment_segment_m
from robot.geometry import Vector

_GOLDEN_ANGLE_RAD = math.pi * (3.0 - math.sqrt(5.0))


def spray_axes(preferred: Vector, half_angle_rad: float, count: int) -> Vector:
    """Unit axes (count, 3) spread evenly over the cap within ``half_angle_rad`` of ``preferred``, which comes first.

    A Fibonacci spiral: the same axes for the same arguments.
    """
    length = float(np.linalg.norm(preferred))
    if length < 1e-9:
        raise ValueError("the preferred spray axis has no length: is the fruit at the camera?")
    ahead = preferred / length
    helper = np.eye(3)[np.abs(ahead).argmin()]
    side = np.cross(ahead, helper)
    side /= np.linalg.norm(side)
    up = np.cross(ahead, side)
    steps = np.arange(count)
    cosine = 1.0 - steps / max(count - 1, 1) * (1.0 - math.cos(half_angle_rad))
    sine, turn = np.sqrt(np.maximum(0.0, 1.0 - cosine**2)), steps * _GOLDEN_ANGLE_RAD
    return np.asarray(
        cosine[:, None] * ahead + (sine * np.cos(turn))[:, None] * side + (sine * np.sin(turn))[:, None] * up
    )


def spray_caught_by_others(
    nozzle_m: Vector, axis: Vector, stand_off_m: Vector, half_angle_rad: float, others: tuple[Sphere, ...]
) -> Vector:
    """0 .. 1 for each pose (m, 3), (m, 3), (m,): how deep other fruit reach into the cone before the target's centre.

    0: none touches the cone; 1: one covers its axis wholly.
    """
    if not others:
        return np.zeros(len(nozzle_m))
    centres = np.stack([ball.centre_m for ball in others])
    radii = np.array([ball.radius_m for ball in others])
    from_nozzle = centres - nozzle_m[:, None, :]
    along = np.einsum("mok,mk->mo", from_nozzle, axis)
    beside = np.sqrt(np.maximum(0.0, np.einsum("mok,mok->mo", from_nozzle, from_nozzle) - along**2))
    into_cone = along * math.tan(half_angle_rad) + radii - beside
    before_target = (along > -radii) & (along < stand_off_m[:, None])
    share = np.clip(into_cone / (2.0 * radii), 0.0, 1.0)
    return np.asarray(np.where(before_target, share, 0.0).max(axis=1))


def spray_gap_to_body_m(
    nozzle_m: Vector, fruit_m: Vector, spray_radius_m: Vector, body: tuple[Capsule | Box, ...]
) -> Vector:
    """(m,) gaps between the rover and the spray, taken as capsules from ``nozzle_m`` (m, 3) to ``fruit_m`` (3,)."""
    end = np.broadcast_to(fruit_m, nozzle_m.shape)
    gaps = [
        segment_box_m(nozzle_m, end, part)
        if isinstance(part, Box)
        else segment_segment_m(nozzle_m, end, part.start_m, part.end_m) - part.radius_m
        for part in body
    ]
    nearest_m = np.min(np.stack(gaps), axis=0) if gaps else np.full(len(nozzle_m), np.inf)
    return np.asarray(nearest_m - spray_radius_m)
