"""Frames of two cameras become pairs by their times; no frame is in two pairs, none is lost uncounted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera.grabber import Grab
from drivers.camera.pairing import Pairing
from drivers.camera.pictures import Bytes

NOTHING: Bytes = np.empty(0, np.uint8)


def frame(at_s: float) -> Grab[Bytes]:
    return Grab(at_s, NOTHING)


def test_frames_within_the_limit_are_a_pair_whichever_comes_first() -> None:
    for first, second in ((0, 1), (1, 0)):
        pairing = Pairing(0.010)
        assert pairing.add(first, frame(1.000)) is None
        pair = pairing.add(second, frame(1.008))
        assert pair is not None
        assert pair.right is not None
        assert (pair.left.grab_s, pair.right.grab_s) == ((1.000, 1.008) if first == 0 else (1.008, 1.000))
        assert pair.grab_s == 1.000


def test_frames_further_apart_are_dropped_and_counted() -> None:
    pairing = Pairing(0.010)
    for number in range(30):
        assert pairing.add(0, frame(0.066 * number)) is None
        assert pairing.add(1, frame(0.066 * number + 0.030)) is None
    assert pairing.dropped >= 50
    assert pairing.falls_apart
    assert 0.029 < pairing.nearest_miss_s < 0.037


@pytest.mark.parametrize("losing", [0, 1])
def test_one_lost_frame_costs_one_pair_only(losing: int) -> None:
    pairing = Pairing(0.010)
    made = 0
    for number in range(40):
        for side, lag_s in ((0, 0.0), (1, 0.002)):
            if (side, number) != (losing, 20):
                made += pairing.add(side, frame(0.066 * number + lag_s)) is not None
    assert made == 39
    assert pairing.dropped == 1
    assert not pairing.falls_apart


def test_cameras_that_begin_anew_make_no_pair_with_what_came_before() -> None:
    pairing = Pairing(0.010)
    for number in range(30):
        pairing.add(0, frame(0.066 * number))
    assert pairing.falls_apart
    pairing.forget()
    assert not pairing.falls_apart
    assert pairing.add(1, frame(0.066 * 29)) is None


@given(st.lists(st.tuples(st.integers(0, 1), st.floats(0.0, 0.05)), max_size=60))
def test_every_frame_is_in_one_pair_or_waits_or_is_counted(steps: list[tuple[int, float]]) -> None:
    pairing = Pairing(0.010)
    now_s, pairs = 0.0, []
    for side, step_s in steps:
        now_s += step_s
        pair = pairing.add(side, frame(now_s))
        if pair is not None and pair.right is not None:
            assert abs(pair.left.grab_s - pair.right.grab_s) <= 0.010
            pairs.append(pair)
    stamps = [grab.grab_s for pair in pairs for grab in (pair.left, pair.right) if grab is not None]
    lefts = [pair.left.grab_s for pair in pairs]
    assert lefts == sorted(lefts)
    assert 0 <= len(steps) - len(stamps) - pairing.dropped <= 8
