"""Time-synchronised joint motions from rest to rest inside velocity and acceleration limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drivers.arm.values import JointTrajectory
from robot.geometry import Vector

_STILL_RAD = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class MotionLimits:
    """Largest speed (n,) and acceleration (n,) of each joint."""

    velocity_rad_s: Vector
    acceleration_rad_s2: Vector


def travel_time_s(move_rad: Vector, limits: MotionLimits) -> Vector:
    """Shortest time of straight joint-space moves (..., n) from rest to rest, all joints together; result (...)."""
    share_v = (np.abs(move_rad) / limits.velocity_rad_s).max(axis=-1)
    share_a = (np.abs(move_rad) / limits.acceleration_rad_s2).max(axis=-1)
    # a unit move s in 0..1 with speed limit 1 / share_v and acceleration limit 1 / share_a
    cruises = share_v * share_v >= share_a
    with_cruise = share_v + share_a / np.where(share_v > 0.0, share_v, 1.0)
    return np.asarray(np.where(cruises, with_cruise, 2.0 * np.sqrt(share_a)))


def joint_trajectory(way_rad: Vector, limits: MotionLimits, sample_s: float) -> JointTrajectory:
    """Through the rows of ``way_rad`` (k, n), at rest in each, on straight joint-space lines, trapezoidal in speed.

    Each piece lasts a whole number of samples (its speed is lowered to fit), so that every way point is a sample;
    a way without motion gives a trajectory of one point.
    """
    way = np.asarray(way_rad, dtype=np.float64)
    rows = [way[:1]]
    for start, end in pairwise(way):
        move = end - start
        if float(np.abs(move).max()) <= _STILL_RAD:
            continue
        shortest_s = float(travel_time_s(move, limits))
        count = max(2, math.ceil(shortest_s / sample_s - 1e-9))
        share = _trapezoid(np.arange(1, count + 1) / count, _ramp_share(move, limits, shortest_s))
        rows.append(start + share[:, None] * move)
        rows[-1][-1] = end
    samples = np.concatenate(rows)
    times = tuple(float(k * sample_s) for k in range(len(samples)))
    return JointTrajectory(times, tuple(tuple(float(angle) for angle in row) for row in samples))


def _ramp_share(move: Vector, limits: MotionLimits, duration_s: float) -> float:
    """The part of the duration in which the move speeds up (and again in which it slows down), 0 .. 0.5."""
    share_v = float((np.abs(move) / limits.velocity_rad_s).max())
    share_a = float((np.abs(move) / limits.acceleration_rad_s2).max())
    return min(0.5, share_a / share_v / duration_s) if share_v > 0.0 else 0.5


def _trapezoid(time_share: Vector, ramp: float) -> Vector:
    """Way done (0..1) at ``time_share`` (0..1) of a move with trapezoidal speed."""
    peak = 1.0 / (1.0 - ramp)
    mirrored = np.minimum(time_share, 1.0 - time_share)
    done = np.where(mirrored < ramp, 0.5 * peak * mirrored**2 / ramp, peak * (mirrored - 0.5 * ramp))
    return np.asarray(np.where(time_share <= 0.5, done, 1.0 - done))
