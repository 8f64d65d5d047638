"""Where the rover is: an extended Kalman filter over wheel counters, satellite fixes and landmarks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from drivers.wheels.values import Odometry
from robot.geometry import Pose2, wrap_angle

Vector = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PoseNoise:
    """One-sigma errors. ``travel`` is metres a root metre travelled, ``turn`` radians a root metre.

    ``scale`` is the wheel radius' relative error at the start, ``scale_drift`` what it changes a root metre.
    """

    start_xy_m: float = 0.01
    start_heading_rad: float = 0.01
    scale: float = 0.01
    travel: float = 0.003
    turn: float = 0.004
    scale_drift: float = 0.0002


@dataclass(frozen=True, slots=True, eq=False)
class PoseFilter:
    """State (x, y, heading, wheel scale, then x, y, heading at the last landmarks) in the row frame. Immutable.

    ``state`` (7,) with ``covariance`` (7, 7): the old pose is a stochastic clone (Roumeliotis and Burdick 2002), so
    that landmarks, which tell the way since then, mend the scale and all that depends on it, and no more.
    ``scale`` is true travel over counted travel. ``trail`` keeps the last seconds of dead reckoning
    (stamp, pose that no fix ever moved), so that a pose can be asked for at a frame's stamp.
    ``rejected`` counts the positions refused in a row.
    """

    state: Vector
    covariance: Vector
    odometry: Odometry
    track_m: float
    noise: PoseNoise
    trail: tuple[tuple[float, Pose2], ...]
    rejected: int = 0

    @property
    def pose(self) -> Pose2:
        return Pose2(float(self.state[0]), float(self.state[1]), float(self.state[2]))

    @property
    def stamp_s(self) -> float:
        return self.odometry.stamp_s

    @property
    def wheel_scale(self) -> float:
        return float(self.state[3])

    @property
    def position_sigma_m(self) -> float:
        """The larger one-sigma axis of the position's error ellipse."""
        return math.sqrt(max(0.0, float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1])))


TRAIL_S = 3.0
_LATEST_LEAD_S = 0.25
_GATE = 13.8  # chi-square, 2 degrees of freedom, 99.9 %


def start(pose: Pose2, odometry: Odometry, track_m: float, noise: PoseNoise | None = None) -> PoseFilter:
    """A filter that stands at a known pose with these wheel counters. ``ValueError`` for a track that is not positive.

    To resume, give the checkpoint's pose and counters, then ``predict`` with the present odometry.
    """
    if not track_m > 0.0:
        raise ValueError(f"expected a positive track_m, found {track_m}")
    noise = noise or PoseNoise()
    sigmas = np.array([noise.start_xy_m, noise.start_xy_m, noise.start_heading_rad, noise.scale])
    state = np.array([pose.x_m, pose.y_m, pose.heading_rad, 1.0])
    state, covariance = _cloned(state, np.diag(sigmas**2))
    return PoseFilter(state, covariance, odometry, track_m, noise, ((odometry.stamp_s, pose),))


def predict(before: PoseFilter, odometry: Odometry) -> PoseFilter:
    """Move by what the wheels counted since the last reading (differential drive, midpoint rule).

    ``ValueError`` when the reading is older than the filter.
    """
    if odometry.stamp_s < before.stamp_s:
        raise ValueError(f"odometry of {odometry.stamp_s:.3f} s is older than the pose of {before.stamp_s:.3f} s")
    left_m = odometry.left_m - before.odometry.left_m
    right_m = odometry.right_m - before.odometry.right_m
    if left_m == 0.0 and right_m == 0.0:  # standing: nothing moves, nothing gets less certain
        return replace(before, odometry=odometry, trail=_longer(before, odometry.stamp_s, before.trail[-1][1]))
    counted_m, turned_rad = 0.5 * (left_m + right_m), (right_m - left_m) / before.track_m
    x, y, heading, scale = before.state[:4].tolist()
    middle = heading + 0.5 * scale * turned_rad
    cosine, sine = math.cos(middle), math.sin(middle)
    travel_m = scale * counted_m
    moved = [x + travel_m * cosine, y + travel_m * sine, wrap_angle(heading + scale * turned_rad), scale]
    jacobian = np.eye(7)
    jacobian[0, 2], jacobian[1, 2] = -travel_m * sine, travel_m * cosine
    jacobian[:3, 3] = (
        counted_m * cosine - 0.5 * travel_m * sine * turned_rad,
        counted_m * sine + 0.5 * travel_m * cosine * turned_rad,
        turned_rad,
    )
    rolled_m = 0.5 * (abs(left_m) + abs(right_m))
    noise = before.noise
    along = np.array([cosine, sine])
    added = np.zeros((7, 7))
    added[:2, :2] = np.outer(along, along) * noise.travel**2 * rolled_m
    added[2, 2] = noise.turn**2 * rolled_m
    added[3, 3] = noise.scale_drift**2 * rolled_m
    reckoned = _moved(before.trail[-1][1], travel_m, scale * turned_rad)
    return replace(
        before,
        state=np.concatenate([moved, before.state[4:]]),
        covariance=jacobian @ before.covariance @ jacobian.T + added,
        odometry=odometry,
        trail=_longer(before, odometry.stamp_s, reckoned),
    )


def _longer(before: PoseFilter, stamp_s: float, reckoned: Pose2) -> tuple[tuple[float, Pose2], ...]:
    """The trail with one more pose (a second one of the same stamp replaces the first), cut to the last seconds."""
    kept = before.trail[:-1] if stamp_s == before.stamp_s else before.trail
    first = next((i for i, item in enumerate(kept) if item[0] >= stamp_s - TRAIL_S), len(kept))
    return (*kept[first:], (stamp_s, reckoned))


def pose_at(at: PoseFilter, stamp_s: float) -> Pose2:
    """The best estimate of the pose at a stamp of the last seconds: today's pose, driven back along the trail.

    Up to 0.25 s after the newest odometry the rover counts as standing there. ``ValueError`` outside the trail.
    """
    oldest_s, newest_s = at.trail[0][0], at.trail[-1][0]
    if not oldest_s - 1e-9 <= stamp_s <= newest_s + _LATEST_LEAD_S:
        raise ValueError(
            f"no odometry for {stamp_s:.3f} s: the trail covers {oldest_s:.3f} to {newest_s:.3f} s; "
            "read the wheels more often"
        )
    then, now = _interpolated(at.trail, stamp_s), at.trail[-1][1]
    turn = at.pose.heading_rad - now.heading_rad
    cosine, sine = math.cos(turn), math.sin(turn)
    dx_m, dy_m = then.x_m - now.x_m, then.y_m - now.y_m
    return Pose2(
        at.pose.x_m + cosine * dx_m - sine * dy_m,
        at.pose.y_m + sine * dx_m + cosine * dy_m,
        wrap_angle(then.heading_rad + turn),
    )


def update_position(before: PoseFilter, xy_m: tuple[float, float], covariance_m2: Vector, stamp_s: float) -> PoseFilter:
    """Take in a measured position (2, 2 covariance) of the base at ``stamp_s``; an outlier is only counted.

    The gate is chi-square at 99.9 %.
    """
    measured = np.zeros((2, 7))
    measured[:, :2] = np.eye(2)
    return _updated(before, xy_m, measured, covariance_m2, stamp_s)


def update_relative(before: PoseFilter, xy_m: tuple[float, float], covariance_m2: Vector, stamp_s: float) -> PoseFilter:
    """Take in a position measured from what was seen at the last call (or the start); an outlier is only counted.

    It tells the way since then: place and heading of the last call are wrong by what they were wrong before.
    """
    way_x_m, way_y_m = (before.state[:2] - before.state[4:6]).tolist()
    measured = np.zeros((2, 7))
    measured[:, :2] = np.eye(2)
    measured[:, 4:6] = -np.eye(2)
    measured[:, 6] = (way_y_m, -way_x_m)
    after = _updated(before, xy_m, measured, covariance_m2, stamp_s)
    state, covariance = _cloned(after.state[:4], after.covariance[:4, :4])
    return replace(after, state=state, covariance=covariance)


def _updated(
    before: PoseFilter, xy_m: tuple[float, float], measured: Vector, covariance_m2: Vector, stamp_s: float
) -> PoseFilter:
    there = pose_at(before, stamp_s)
    noise = np.asarray(covariance_m2, dtype=np.float64)
    innovation = np.array([xy_m[0] - there.x_m, xy_m[1] - there.y_m])
    spread = measured @ before.covariance @ measured.T + noise
    if float(innovation @ np.linalg.solve(spread, innovation)) > _GATE:
        return replace(before, rejected=before.rejected + 1)
    gain = np.linalg.solve(spread, measured @ before.covariance).T
    state = before.state + gain @ innovation
    state[2], state[6] = wrap_angle(float(state[2])), wrap_angle(float(state[6]))
    keep = np.eye(7) - gain @ measured  # Joseph form
    covariance = keep @ before.covariance @ keep.T + gain @ noise @ gain.T
    return replace(before, state=state, covariance=0.5 * (covariance + covariance.T), rejected=0)


def _cloned(state: Vector, covariance: Vector) -> tuple[Vector, Vector]:
    """The pose twice: one to move on, one to stay. State (4,) and covariance (4, 4) become (7,) and (7, 7)."""
    twice = np.concatenate([np.arange(4), np.arange(3)])
    return state[twice], covariance[np.ix_(twice, twice)]


def _moved(pose: Pose2, travel_m: float, turned_rad: float) -> Pose2:
    middle = pose.heading_rad + 0.5 * turned_rad
    return Pose2(
        pose.x_m + travel_m * math.cos(middle),
        pose.y_m + travel_m * math.sin(middle),
        wrap_angle(pose.heading_rad + turned_rad),
    )


def _interpolated(trail: Sequence[tuple[float, Pose2]], stamp_s: float) -> Pose2:
    after = next((i for i, (stamp, _) in enumerate(trail) if stamp >= stamp_s), len(trail) - 1)
    if after == 0 or trail[after][0] <= stamp_s:
        return trail[after][1]
    (t0, a), (t1, b) = trail[after - 1], trail[after]
    share = (stamp_s - t0) / (t1 - t0)
    return Pose2(
        a.x_m + share * (b.x_m - a.x_m),
        a.y_m + share * (b.y_m - a.y_m),
        wrap_angle(a.heading_rad + share * wrap_angle(b.heading_rad - a.heading_rad)),
    )
