"""No false alarm in any light, and every fault found; the rates are those of the pairs made here."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from drivers.camera import frame_checks as checks
from drivers.camera.frame_checks import PictureFault
from drivers.camera.frame_watch import FrameWatch
from drivers.camera.values import Image
from drivers.camera.view_matching import match
from tests.drivers.camera.scenes import (
    Taken,
    calibration,
    compressed,
    dark,
    fogged,
    frame_of,
    pairs,
    under_tape,
)


@cache
def scenes() -> tuple[Taken, ...]:
    """108 pairs of twelve rows."""
    return tuple(pairs(range(12)))


@cache
def streamed() -> tuple[Taken, ...]:
    return tuple(compressed(taken) for taken in scenes())


def found(left: Image, right: Image) -> PictureFault | None:
    finding = FrameWatch().look(frame_of(left, right))
    return None if finding is None else finding.fault


def can_be_judged(taken: Taken) -> bool:
    views = [checks.measure(checks.grey_of(view)) for view in (taken.left, taken.right)]
    return min(view.contrast for view in views) >= checks.JUDGED_CONTRAST


@pytest.mark.parametrize("source", [scenes, streamed])
@pytest.mark.long
def test_no_scene_in_any_light_raises_an_alarm(source) -> None:
    watch = FrameWatch(calibration())
    alarms = [f"{taken.what}: {finding.found}" for taken in source() if (finding := watch.look(taken.frame))]
    assert alarms == []


@pytest.mark.long
def test_a_calibrated_pair_is_on_its_rows_to_a_fraction_of_a_pixel() -> None:
    watch = FrameWatch(calibration())
    for taken in scenes():
        watch.look(taken.frame)
        if watch.misalignment is not None:
            assert watch.misalignment.row_px < 0.5 * checks.ROW_LIMIT_PX
            assert abs(watch.misalignment.yaw_rad) < 0.5 * checks.YAW_LIMIT_RAD


def test_three_identical_pictures_are_frozen() -> None:
    """F51."""
    watch, taken = FrameWatch(), scenes()[0]
    findings = [watch.look(frame_of(taken.left, taken.right, sequence)) for sequence in range(1, 5)]
    assert [finding and finding.fault for finding in findings] == [None, None, "frozen", "frozen"]
    assert watch.repeats
    other = scenes()[1]
    assert watch.look(other.frame) is None
    assert not watch.repeats


def test_a_still_scene_is_not_frozen_for_its_noise() -> None:
    watch = FrameWatch()
    noise = np.random.default_rng(3)
    taken = scenes()[0]
    for _ in range(6):
        noisy = np.clip(taken.left + noise.integers(-1, 2, taken.left.shape), 0, 255).astype(np.uint8)
        assert watch.look(frame_of(noisy, taken.right)) is None


@pytest.mark.parametrize("gain", [1.0, 2.0, 4.0, 8.0, 16.0])
@pytest.mark.parametrize("streams", [False, True])
def test_a_cap_on_the_lens_is_black_at_every_gain(gain: float, streams: bool) -> None:
    """F52."""
    for sequence in range(4):
        taken = Taken(dark(gain, sequence, 0), dark(gain, sequence, 1), "capped")
        taken = compressed(taken) if streams else taken
        assert found(taken.left, taken.right) is PictureFault.BLACK


def test_a_cap_on_one_lens_is_found_in_every_light() -> None:
    for taken in scenes()[::3]:
        assert found(taken.left, dark(1.0, 5, 1)) is not None
        assert found(dark(1.0, 5, 0), taken.right) is not None


def test_a_white_picture_is_white() -> None:
    white = np.full((480, 640, 3), 255, np.uint8)
    white[:10, :, :] = 200
    assert found(white, white) is PictureFault.WHITE


@pytest.mark.parametrize("level", [25.0, 90.0, 200.0])
def test_something_right_before_a_lens_covers_it(level: float) -> None:
    for taken in scenes()[:20]:
        assert found(under_tape(level), taken.right) in (PictureFault.COVERED, PictureFault.BLACK)
        assert found(taken.left, under_tape(level)) is not None


@pytest.mark.parametrize(("sigma_px", "share"), [(3.0, 0.95), (6.0, 0.95)])
def test_a_fogged_lens_is_found(sigma_px: float, share: float) -> None:
    """F52: one lens, and both at once."""
    judged = [taken for taken in scenes()[::3] if can_be_judged(taken)]
    one = [found(taken.left, fogged(taken.right, sigma_px)) for taken in judged]
    both = [found(fogged(taken.left, sigma_px), fogged(taken.right, sigma_px)) for taken in judged]
    assert len(judged) >= 20
    for outcome in (one, both):
        assert np.mean([fault is not None for fault in outcome]) >= share


def test_swapped_views_are_found_in_every_scene_with_enough_to_see() -> None:
    """F53."""
    tellable = [taken for taken in streamed() if len(matches_of(taken)) >= 2 * checks.SWAPPED_MATCHES]
    assert len(tellable) >= 70
    for taken in tellable:
        assert found(taken.right, taken.left) is PictureFault.SWAPPED


def matches_of(taken: Taken):
    return match(checks.grey_of(taken.left), checks.grey_of(taken.right))


@pytest.mark.parametrize(
    ("turned_deg", "axis"),
    [((1.0, 0.0, 0.0), "pitch_rad"), ((-1.0, 0.0, 0.0), "pitch_rad"), ((0.0, 0.0, 1.0), "roll_rad"),
     ((0.0, 1.0, 0.0), "yaw_rad"), ((2.0, 0.0, 0.0), "pitch_rad")],
)  # fmt: skip
@pytest.mark.long
def test_a_lens_knocked_by_a_degree_is_found_and_its_turn_told(turned_deg, axis: str) -> None:
    """F54: within 30 pairs."""
    watch = FrameWatch(calibration())
    seen = list(pairs(range(3), turned_deg))
    findings = [watch.look(taken.frame) for taken in seen]
    assert len(findings) <= 30
    told = {finding.fault for finding in findings if finding}
    assert told == {PictureFault.DECALIBRATED}
    assert watch.misalignment is not None
    turned = dict(zip(("pitch_rad", "yaw_rad", "roll_rad"), np.radians(turned_deg), strict=True))
    assert getattr(watch.misalignment, axis) == pytest.approx(turned[axis], abs=np.radians(0.35))


def test_faults_that_are_not_looked_for_are_not_found() -> None:
    taken = scenes()[0]
    watch = FrameWatch(faults=frozenset({PictureFault.BLACK}))
    assert [watch.look(frame_of(taken.right, taken.left)) for _ in range(5)] == [None] * 5
