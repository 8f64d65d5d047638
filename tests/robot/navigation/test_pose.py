"""The pose filter against a simulated rover whose wheels are 1 % off."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from drivers.gps.values import Fix, FixQuality
from drivers.wheels.values import Odometry
from robot.geometry import Pose2
from robot.navigation import (
    Datum,
    DriveLimits,
    FixRules,
    PoseFilter,
    PoseNoise,
    estimate_shift,
    pose_at,
    predict,
    start,
    update_fix,
    update_landmarks,
    update_position,
    usable,
)
from tests.robot.navigation.rover import TRACK_M, Rover, drive_to

LIMITS = DriveLimits()
DATUM = Datum(48.7, 9.1, math.radians(30.0))
STOPS_M = [0.2 + 0.4 * k for k in range(10)]
ORIGIN = Pose2(0.0, 0.0, 0.0)


def counted(stamp_s: float, left_m: float, right_m: float) -> Odometry:
    return Odometry(stamp_s, left_m, right_m, 0.0, 0.0)


def fix_at(
    x_m: float, y_m: float, stamp_s: float, quality: FixQuality = FixQuality.RTK_FIXED, accuracy_m: float = 0.01
) -> Fix:
    """Latitude and longitude of a row position, by the radii of curvature at the datum."""
    latitude = math.radians(DATUM.latitude_deg)
    e2 = 0.00669437999014
    w = math.sqrt(1 - e2 * math.sin(latitude) ** 2)
    meridian_m, normal_m = 6378137.0 * (1 - e2) / w**3, 6378137.0 / w
    sine, cosine = math.sin(DATUM.heading_rad), math.cos(DATUM.heading_rad)
    east_m, north_m = x_m * sine - y_m * cosine, x_m * cosine + y_m * sine
    return Fix(
        stamp_s=stamp_s,
        utc=None,
        quality=quality,
        latitude_deg=DATUM.latitude_deg + math.degrees(north_m / meridian_m),
        longitude_deg=DATUM.longitude_deg + math.degrees(east_m / (normal_m * math.cos(latitude))),
        altitude_m=None,
        accuracy_m=accuracy_m,
        satellites=12,
        hdop=0.8,
        speed_m_s=None,
        course_rad=None,
    )


class RtkReceiver:
    """5 Hz, 8 mm of white noise and a slow wander of 5 mm, 50 ms late."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._wander = rng.normal(0.0, 0.005, 2)
        self._next_s = 0.0
        self._held: list[Fix] = []

    def __call__(self, rover: Rover, pose_filter: PoseFilter) -> PoseFilter:
        ready, self._held = self._held, []
        for fix in ready:
            pose_filter = update_fix(pose_filter, fix, DATUM, FixRules())
        if rover.now_s >= self._next_s:
            self._next_s += 0.2
            self._wander = 0.99 * self._wander + self._rng.normal(0.0, 0.0007, 2)
            error = self._wander + self._rng.normal(0.0, 0.008, 2)
            self._held.append(fix_at(rover.x_m + error[0], rover.y_m + error[1], rover.now_s))
        return pose_filter


class FruitLandmarks:
    """Six fruits a stop, each seen from this stop and the next with a median error of 8 mm, most of it along row y."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._known: dict[tuple[int, int], npt.NDArray[np.float64]] = {}
        self._fruits = {(k, i): np.array([k * 0.4 + rng.uniform(0.1, 0.5), 0.6]) for k in range(10) for i in range(6)}
        self.sigma_m = np.array([0.004, 0.010])

    def look(self, rover: Rover, pose_filter: PoseFilter, stop: int) -> PoseFilter:
        seen_from = pose_filter.pose
        row_from_truth = seen_from.transform() @ rover.pose.transform().inverse()
        seen: dict[tuple[int, int], npt.NDArray[np.float64]] = {}
        for key, place in self._fruits.items():
            if key[0] in (stop - 1, stop):
                noisy = place + self._rng.normal(0.0, self.sigma_m)
                seen[key] = row_from_truth.apply([*noisy, 0.0])[:2]
        book = self._known
        shift = estimate_shift([seen[key] - book[key] for key in seen if key in book])
        if shift is not None:
            pose_filter = update_landmarks(pose_filter, seen_from, shift, pose_filter.stamp_s)
        moved = pose_filter.pose.transform() @ seen_from.transform().inverse()
        for key, place in seen.items():
            now = moved.apply([*place, 0.0])[:2]
            book[key] = 0.5 * (book[key] + now) if key in book else now
        return pose_filter


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("radius_error", [-0.01, 0.01])
def test_with_rtk_every_stop_of_4_m_is_within_20_mm_of_truth(seed: int, radius_error: float) -> None:
    rng = np.random.default_rng(seed)
    rover, receiver = Rover(radius_error), RtkReceiver(rng)
    pose_filter = start(ORIGIN, rover.odometry(), TRACK_M)
    for stop_m in STOPS_M:
        pose_filter = drive_to(rover, pose_filter, stop_m, LIMITS, receiver)
        for _ in range(40):
            rover.run(0.0, 0.0, 0.05)
            pose_filter = receiver(rover, predict(pose_filter, rover.odometry()))
        assert abs(rover.x_m - stop_m) < 0.020
        assert abs(rover.y_m) < 0.020
        assert abs(pose_filter.pose.x_m - rover.x_m) < 0.020
    assert pose_filter.wheel_scale - 1.0 == pytest.approx(radius_error, abs=0.006)


def drift_without_gps(seed: int, radius_error: float, landmarks: bool) -> float:
    rng = np.random.default_rng(seed)
    rover, fruit = Rover(radius_error), FruitLandmarks(rng)
    pose_filter = start(ORIGIN, rover.odometry(), TRACK_M)
    for stop, stop_m in enumerate(STOPS_M):
        pose_filter = drive_to(rover, pose_filter, stop_m, LIMITS)
        if landmarks:
            pose_filter = fruit.look(rover, pose_filter, stop)
    return math.hypot(pose_filter.pose.x_m - rover.x_m, pose_filter.pose.y_m - rover.y_m)


def test_fruit_landmarks_keep_drift_below_20_mm_over_4_m_without_gps() -> None:
    drifts = [drift_without_gps(seed, error, landmarks=True) for seed in range(8) for error in (-0.01, 0.01)]
    assert np.percentile(drifts, 90) < 0.020
    assert np.median(drifts) < 0.012
    assert drift_without_gps(0, 0.01, landmarks=False) > 0.035


def test_dead_reckoning_on_true_wheels_is_exact_on_a_curve() -> None:
    rover = Rover(lag_s=0.0)
    pose_filter = start(ORIGIN, rover.odometry(), TRACK_M)
    for _ in range(200):
        rover.run(0.2, 0.3, 0.05)
        pose_filter = predict(pose_filter, rover.odometry())
    assert pose_filter.pose.x_m == pytest.approx(rover.x_m, abs=0.002)
    assert pose_filter.pose.y_m == pytest.approx(rover.y_m, abs=0.002)
    assert math.remainder(pose_filter.pose.heading_rad - rover.heading_rad, math.tau) == pytest.approx(0.0, abs=1e-6)


def test_uncertainty_grows_with_travel_and_shrinks_with_a_fix() -> None:
    before = start(ORIGIN, counted(0.0, 0.0, 0.0), TRACK_M)
    after = predict(before, counted(10.0, 2.0, 2.0))
    assert after.position_sigma_m > before.position_sigma_m + 0.01
    fixed = update_position(after, (2.0, 0.0), np.eye(2) * 0.01**2, 10.0)
    assert fixed.position_sigma_m < 0.011


def test_uncertainty_tells_the_true_error_of_a_wheel_that_is_1_percent_off() -> None:
    after = predict(start(ORIGIN, counted(0.0, 0.0, 0.0), TRACK_M), counted(16.0, 4.0, 4.0))
    assert math.sqrt(after.covariance[0, 0]) == pytest.approx(0.04, rel=0.1)


def test_standing_still_changes_neither_pose_nor_uncertainty() -> None:
    before = start(Pose2(1.0, 0.1, 0.05), counted(0.0, 5.0, 5.0), TRACK_M)
    after = predict(before, counted(100.0, 5.0, 5.0))
    assert after.pose == before.pose
    np.testing.assert_array_equal(after.covariance, before.covariance)


def test_a_jump_of_the_receiver_is_refused_and_counted() -> None:
    before = start(ORIGIN, counted(0.0, 0.0, 0.0), TRACK_M)
    after = update_fix(before, fix_at(3.0, 0.0, 0.0), DATUM, FixRules())
    assert (after.pose, after.rejected) == (before.pose, 1)
    again = update_fix(after, fix_at(0.001, 0.0, 0.0), DATUM, FixRules())
    assert again.rejected == 0
    assert again.pose.x_m == pytest.approx(0.0005, abs=0.0005)


def test_the_antenna_may_stand_off_the_base_centre() -> None:
    rules = FixRules(antenna_xy_m=(-0.2, 0.1))
    turned = start(Pose2(1.0, 0.0, 0.0), counted(0.0, 0.0, 0.0), TRACK_M)
    after = update_fix(turned, fix_at(0.8, 0.1, 0.0), DATUM, rules)
    assert after.rejected == 0
    assert after.pose.x_m == pytest.approx(1.0, abs=1e-4)
    assert after.pose.y_m == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    ("quality", "accuracy_m", "good"),
    [
        (FixQuality.RTK_FIXED, 0.01, True),
        (FixQuality.RTK_FLOAT, 0.2, True),
        (FixQuality.RTK_FLOAT, 0.8, False),
        (FixQuality.SINGLE, 0.01, False),
        (FixQuality.NONE, 0.01, False),
    ],
)
def test_only_good_fixes_count(quality: FixQuality, accuracy_m: float, good: bool) -> None:
    assert usable(fix_at(0.0, 0.0, 0.0, quality, accuracy_m), FixRules()) is good


def test_a_fix_without_figures_changes_nothing() -> None:
    before = start(ORIGIN, counted(0.0, 0.0, 0.0), TRACK_M)
    nothing = Fix(0.0, None, FixQuality.RTK_FIXED, None, None, None, None, 0, None, None, None)
    assert update_fix(before, nothing, DATUM, FixRules()) is before


def test_a_fix_older_than_the_trail_changes_nothing() -> None:
    later = predict(start(ORIGIN, counted(0.0, 0.0, 0.0), TRACK_M), counted(50.0, 0.0, 0.0))
    assert update_fix(later, fix_at(0.0, 0.0, 1.0), DATUM, FixRules()) is later


def test_pose_at_a_frames_stamp_lies_between_the_readings_round_it() -> None:
    at = start(ORIGIN, counted(0.0, 0.0, 0.0), TRACK_M)
    for k in range(1, 21):
        at = predict(at, counted(0.05 * k, 0.01 * k, 0.01 * k))
    assert pose_at(at, 0.525).x_m == pytest.approx(0.105, abs=1e-9)
    assert pose_at(at, 1.0) == at.pose


def test_a_later_correction_moves_the_pose_of_the_frame_with_it() -> None:
    at = start(ORIGIN, counted(0.0, 0.0, 0.0), TRACK_M)
    for k in range(1, 21):
        at = predict(at, counted(0.05 * k, 0.01 * k, 0.01 * k))
    frame_before = pose_at(at, 0.5)
    at = update_position(at, (at.pose.x_m + 0.01, 0.0), np.eye(2) * 1e-8, 1.0)
    assert pose_at(at, 0.5).x_m - frame_before.x_m == pytest.approx(0.01, abs=2e-4)


@pytest.mark.parametrize("stamp_s", [-0.1, 1.5])
def test_pose_outside_the_trail_is_an_error(stamp_s: float) -> None:
    at = predict(start(ORIGIN, counted(0.0, 0.0, 0.0), TRACK_M), counted(1.0, 0.1, 0.1))
    with pytest.raises(ValueError, match="no odometry for"):
        pose_at(at, stamp_s)


def test_the_trail_keeps_three_seconds() -> None:
    at = start(ORIGIN, counted(0.0, 0.0, 0.0), TRACK_M)
    for k in range(1, 201):
        at = predict(at, counted(0.05 * k, 0.01 * k, 0.01 * k))
    assert at.trail[-1][0] - at.trail[0][0] == pytest.approx(3.0, abs=0.051)
    assert len(at.trail) <= 62


def test_two_readings_of_one_stamp_keep_one_place_on_the_trail() -> None:
    at = start(ORIGIN, counted(0.0, 0.0, 0.0), TRACK_M)
    at = predict(at, counted(0.0, 0.1, 0.1))
    assert len(at.trail) == 1
    assert pose_at(at, 0.0).x_m == pytest.approx(0.1)


def test_odometry_from_the_past_is_an_error() -> None:
    at = predict(start(ORIGIN, counted(0.0, 0.0, 0.0), TRACK_M), counted(1.0, 0.1, 0.1))
    with pytest.raises(ValueError, match="older than the pose"):
        predict(at, counted(0.5, 0.1, 0.1))


def test_resuming_counts_what_the_wheels_rolled_while_the_program_was_down() -> None:
    checkpoint = start(Pose2(1.2, 0.01, 0.0), counted(0.0, 1.19, 1.19), TRACK_M, PoseNoise(start_xy_m=0.02))
    resumed = predict(checkpoint, counted(0.1, 1.29, 1.29))
    assert resumed.pose.x_m == pytest.approx(1.3)


def test_a_track_must_be_positive() -> None:
    with pytest.raises(ValueError, match="track_m"):
        start(ORIGIN, counted(0.0, 0.0, 0.0), 0.0)
