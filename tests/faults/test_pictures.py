"""Pictures go bad in the middle of a mission: no shot follows from them, and a person reads why.

Numbers in brackets are those of the fault catalogue. F50 (no pictures at all) is among the lost devices.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from drivers.twin.commands import WheelsDrive
from drivers.twin.plants import grow
from robot.mission import State
from robot.safety import Mode
from tests.drivers.camera.scenes import turned_optics
from tests.robot.mission.conftest import SHORT
from tests.robot.mission.oracle import WatchedRenderer
from tests.robot.mission.rover import Run, World, spray_row
from tests.robot.mission.truths import last_process, openings

IN_TIME_S = 2.0  # from the first look at a bad picture to the latch

Picture = np.ndarray
Spoil = Callable[[Picture, Picture], tuple[Picture, Picture]]


def spoiled_from_stop_two(tmp_path, spoil: Spoil, **changes) -> Run:
    """A mission whose pictures are spoiled once the second stop is reached."""

    async def meddle(world: World) -> None:
        await world.until(State.MOVE, 2)
        expose = world.twin.expose
        world.twin.expose = lambda *how: spoil(*expose(*how))  # type: ignore[method-assign]

    return spray_row(tmp_path, meddler=meddle, **SHORT, **changes)


def looked_s(run: Run) -> float:
    """When the second stop was first looked at."""
    return run.spans(State.DETECT)[1][0]


def nothing_was_sprayed_on_it(run: Run, words: str) -> None:
    """Latched in time with the cause in words; what was sprayed is what the first stop's good picture showed."""
    assert run.result.mode is Mode.SAFE_STOP
    assert words in run.said
    assert run.latched_s - looked_s(run) <= IN_TIME_S
    assert [frame.stop for frame in run.frames] == [1]
    assert {shot.intent.stop for shot in run.shots} == {1}
    assert all(end < looked_s(run) for _, end in openings(last_process(run)))
    assert run.totals.booked_ml >= run.run_on().dispensed_ml


def black(left: Picture, right: Picture) -> tuple[Picture, Picture]:
    return np.zeros_like(left), np.zeros_like(right)


def white(left: Picture, right: Picture) -> tuple[Picture, Picture]:
    return np.full_like(left, 255), np.full_like(right, 255)


def covered_left(left: Picture, right: Picture) -> tuple[Picture, Picture]:
    """A hand on one lens: dim, without any shape, with the noise of the sensor."""
    flat = np.full_like(left, 90)
    return flat + (left & 1), right


def smeared(left: Picture, right: Picture) -> tuple[Picture, Picture]:
    """Spray on both lenses."""
    return cv2.GaussianBlur(left, (0, 0), 6.0) ^ (left & 1), cv2.GaussianBlur(right, (0, 0), 6.0) ^ (right & 1)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        pytest.param(black, "the left view black", id="F52 cap on"),
        pytest.param(white, "the left view white", id="F52 burnt out"),
        pytest.param(covered_left, "the left view covered", id="F52 a hand on one lens"),
        pytest.param(smeared, "blurred", id="F52 spray on the lenses"),
    ],
)
def test_a_lens_that_sees_nothing_stops_the_mission(spoil, words, tmp_path):
    """With a fixed exposure: the camera is not asked to see through its cap."""
    nothing_was_sprayed_on_it(spoiled_from_stop_two(tmp_path, spoil, camera={"exposure": "fixed"}), words)


def test_a_cap_is_told_from_dusk_once_the_exposure_can_do_no_more(tmp_path):
    """F52: metering tries all that the camera has, each for a second, before it is the lens that is to blame."""
    run = spoiled_from_stop_two(tmp_path, black)
    assert run.result.mode is Mode.SAFE_STOP
    assert "take the cap off the lens" in run.said
    assert run.latched_s - looked_s(run) <= 8.0
    assert {shot.intent.stop for shot in run.shots} == {1}
    assert [frame.stop for frame in run.frames] == [1]


def test_frozen_pictures_stop_the_mission(undisturbed, tmp_path):
    """F51: the picture that freezes is a true one; the second and third tell that time stands still."""
    begin_s, _ = undisturbed.spans(State.DETECT)[0]
    run = spray_row(tmp_path, faults=(f"camera:stuck@{begin_s - 0.01:.4f}s",), **SHORT)
    assert run.result.mode is Mode.SAFE_STOP
    assert "identical ones in a row" in run.said
    assert run.latched_s - looked_s(run) <= IN_TIME_S
    assert [frame.stop for frame in run.frames] == [1]
    assert {shot.intent.stop for shot in run.shots} == {1}


def test_swapped_views_stop_the_mission(undisturbed, tmp_path):
    """F53."""
    at_s = undisturbed.spans(State.DETECT)[1][0] - 0.5
    nothing_was_sprayed_on_it(
        spray_row(tmp_path, faults=(f"camera:wrong@{at_s:.4f}s",), **SHORT), "change left and right"
    )


@pytest.mark.parametrize("turned_deg", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (-0.5, 0.0, 0.0)], ids=str)
def test_a_knock_on_the_camera_stops_the_mission(turned_deg, tmp_path):
    """F54: one eye has turned about x (pitch) or z (roll) since it was calibrated."""

    async def knock(world: World) -> None:
        await world.until(State.MOVE, 2)
        world.twin.renderer = WatchedRenderer(grow(world.twin.scene), turned_optics(turned_deg), world.twin.seed)

    run = spray_row(tmp_path, meddler=knock, **SHORT)
    nothing_was_sprayed_on_it(run, "something has moved the lenses")


def test_a_camera_that_was_knocked_before_the_mission_sprays_nothing(tmp_path):
    """F54."""

    async def knock(world: World) -> None:
        world.twin.renderer = WatchedRenderer(grow(world.twin.scene), turned_optics((1.0, 0.0, 0.0)), world.twin.seed)

    run = spray_row(tmp_path, meddler=knock, **SHORT)
    assert run.result.mode is Mode.SAFE_STOP
    assert "something has moved the lenses" in run.said
    assert run.shots == ()
    assert run.twin.dispensed_ml == 0.0


def test_an_eye_that_lags_behind_does_no_harm_as_the_base_stands(undisturbed, tmp_path):
    """F55: the right view is 0.2 s older; pictures are used only from a base that has stood for longer."""
    past: list[tuple[float, object]] = []

    async def lag(world: World) -> None:
        now_expose = world.twin.expose

        def expose(now_s, exposure_s, gain, sequence):
            left, _ = now_expose(now_s, exposure_s, gain, sequence)
            shot = next(shot for stamp_s, shot in reversed(past) if stamp_s <= now_s - 0.2)
            _, right = world.twin.renderer.render(
                shot.row_from_camera, shot.light, exposure_s, gain, shot.bodies, sequence + 100_000
            )
            now_expose(now_s, exposure_s, gain, sequence)  # what the oracle knows is the present
            return left, right

        world.twin.expose = expose
        while True:
            past.append((world.now_s, world.twin.shot(world.now_s)))
            await asyncio.sleep(0.02)

    run = spray_row(tmp_path, meddler=lag, **SHORT)
    assert run.result.state is State.DONE
    assert len(run.frames) == 2
    for frame in run.frames:
        poses = [s.row_from_camera for t, s in past if frame.frame.stamp_s - 0.25 <= t <= frame.frame.stamp_s]
        assert np.ptp(np.array(poses), axis=0).max() < 1e-4
    assert len(run.shots) == len(undisturbed.shots)


def test_a_picture_from_before_it_was_asked_for_is_not_used(undisturbed, tmp_path):
    """F56: its stamp is a second old, when the base was still rolling."""
    at_s = undisturbed.spans(State.DETECT)[1][0] - 0.5
    run = spray_row(tmp_path, faults=(f"camera:delayed@{at_s:.4f}s",), **SHORT)
    nothing_was_sprayed_on_it(run, "a pair exposed after it was asked for")
    rolled_s = [timed.t for timed in last_process(run).commands if isinstance(timed.command, WheelsDrive)]
    assert max(rolled_s) < looked_s(run)
