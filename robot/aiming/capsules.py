"""Capsules, spheres and boxes, and the distances between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot.geometry import Transform, Vector

_TINY_M2 = 1e-18


@dataclass(frozen=True, slots=True, eq=False)
class Capsule:
    """All points within ``radius_m`` of the segment from ``start_m`` (3,) to ``end_m`` (3,)."""

    start_m: Vector
    end_m: Vector
    radius_m: float

    def moved(self, target_from_source: Transform) -> Capsule:
        return Capsule(target_from_source.apply(self.start_m), target_from_source.apply(self.end_m), self.radius_m)


@dataclass(frozen=True, slots=True, eq=False)
class Sphere:
    """A ball of ``radius_m`` about ``centre_m`` (3,)."""

    centre_m: Vector
    radius_m: float

    def moved(self, target_from_source: Transform) -> Sphere:
        return Sphere(target_from_source.apply(self.centre_m), self.radius_m)


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A box with half edge lengths ``half_m`` (3,) about the origin of ``pose``, along its axes."""

    pose: Transform
    half_m: Vector

    def moved(self, target_from_source: Transform) -> Box:
        return Box(target_from_source @ self.pose, self.half_m)


def segment_segment_m(start_a: Vector, end_a: Vector, start_b: Vector, end_b: Vector) -> Vector:
    """Distance between segments a and b; every argument (..., 3), broadcast against each other; result (...).

    Segments of no length are points. After Ericson, Real-Time Collision Detection, 5.1.9.
    """
    along_a, along_b, between = end_a - start_a, end_b - start_b, start_a - start_b
    aa, bb = _dot(along_a, along_a), _dot(along_b, along_b)
    ab, a_between, b_between = _dot(along_a, along_b), _dot(along_a, between), _dot(along_b, between)
    denominator = aa * bb - ab * ab
    parallel = denominator <= 1e-12 * aa * bb + _TINY_M2
    s = np.where(parallel, 0.0, (ab * b_between - a_between * bb) / np.where(parallel, 1.0, denominator))
    s = np.clip(s, 0.0, 1.0)
    t = np.clip((ab * s + b_between) / np.maximum(bb, _TINY_M2), 0.0, 1.0)
    s = np.clip((ab * t - a_between) / np.maximum(aa, _TINY_M2), 0.0, 1.0)
    gap = between + s[..., None] * along_a - t[..., None] * along_b
    return np.sqrt(_dot(gap, gap))


def segment_point_m(start: Vector, end: Vector, point: Vector) -> Vector:
    """Distance from points to segments; arguments (..., 3), broadcast; result (...)."""
    along, to_point = end - start, point - start
    t = np.clip(_dot(along, to_point) / np.maximum(_dot(along, along), _TINY_M2), 0.0, 1.0)
    gap = to_point - t[..., None] * along
    return np.sqrt(_dot(gap, gap))


def segment_box_m(start: Vector, end: Vector, box: Box) -> Vector:
    """Distance from segments (..., 3) to a box, 0 inside; result (...).

    The squared distance along a segment is convex and piecewise quadratic: the root of its derivative lies between
    two of the crossings of the segment with the six planes of the box's faces, where the derivative is linear.
    """
    box_from_frame = box.pose.inverse()
    origin, along = box_from_frame.apply(start), box_from_frame.rotate(end - start)
    safe = np.where(np.abs(along) < 1e-12, 1e-12, along)
    crossings = np.concatenate([(box.half_m - origin) / safe, (-box.half_m - origin) / safe], axis=-1)
    ends = np.broadcast_to(np.array([0.0, 1.0]), (*origin.shape[:-1], 2))
    knots = np.sort(np.concatenate([np.clip(crossings, 0.0, 1.0), ends], axis=-1), axis=-1)
    points = origin[..., None, :] + knots[..., None] * along[..., None, :]
    slope = _dot(points - np.clip(points, -box.half_m, box.half_m), along[..., None, :])
    last_falling = np.clip((slope <= 0.0).sum(axis=-1) - 1, 0, knots.shape[-1] - 2)[..., None]
    t0, t1 = (np.take_along_axis(knots, last_falling + k, axis=-1)[..., 0] for k in (0, 1))
    g0, g1 = (np.take_along_axis(slope, last_falling + k, axis=-1)[..., 0] for k in (0, 1))
    rise = g1 - g0
    t = np.where(rise > 0.0, t0 - g0 * (t1 - t0) / np.where(rise > 0.0, rise, 1.0), t0)
    nearest = origin + np.clip(t, t0, t1)[..., None] * along
    outside = nearest - np.clip(nearest, -box.half_m, box.half_m)
    return np.sqrt(_dot(outside, outside))


def capsule_distance_m(a: Capsule, b: Capsule) -> float:
    """Gap between two capsules, negative when they overlap."""
    apart = segment_segment_m(a.start_m, a.end_m, b.start_m, b.end_m)
    return float(apart) - a.radius_m - b.radius_m


def _dot(a: Vector, b: Vector) -> Vector:
    return np.asarray(np.einsum("...k,...k->...", a, b))
