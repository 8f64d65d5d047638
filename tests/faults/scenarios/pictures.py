"""Pictures go bad in the middle of a mission: no shot follows from them, and a person reads why."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.commands import WheelsDrive
from drivers.twin.plants import grow
from robot.mission import State
from tests.drivers.camera.scenes import turned_optics
from tests.robot.mission.conftest import SHORT
from tests.robot.mission.oracle import WatchedRenderer
from tests.robot.mission.rover import Meddler, Run, World, spray_row
from tests.robot.mission.truths import last_process, openings

from .judging import judged
from .values import Scenario, Scenarios, Seen, Stage

Picture = npt.NDArray[np.uint8]
Spoil = Callable[[Picture, Picture], tuple[Picture, Picture]]

KEPT = "the reason; the stop is looked at again by a resume"
FIXED_EXPOSURE = {"camera": {"exposure": "fixed"}}  # the camera is not asked to see through its cap


def looked_s(run: Run) -> float:
    """When the second stop was first looked at."""
    return run.spans(State.DETECT)[1][0]


def nothing_sprayed_on_it(run: Run, *words: str, kept: str = KEPT) -> Seen:
    """What was sprayed is what the first stop's good picture showed."""
    assert [frame.stop for frame in run.frames] == [1]
    assert {shot.intent.stop for shot in run.shots} == {1}
    assert all(end < looked_s(run) for _, end in openings(last_process(run)))
    return judged(run, looked_s(run), *words, kept=kept)


def spoiled(spoil: Spoil, *words: str, **changes: object) -> Scenario:
    """From the second stop on every pair is spoiled."""

    async def meddle(world: World) -> None:
        await world.until(State.MOVE, 2)
        expose = world.twin.expose
        world.twin.expose = lambda *how: spoil(*expose(*how))  # type: ignore[method-assign]

    def scenario(stage: Stage) -> Seen:
        run = spray_row(stage.folder, meddler=meddle, **SHORT, **changes)  # type: ignore[arg-type]
        return nothing_sprayed_on_it(run, *words)

    return scenario


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
    dull = [np.asarray(cv2.GaussianBlur(view, (0, 0), 6.0), np.uint8) ^ (view & 1) for view in (left, right)]
    return dull[0], dull[1]


def frozen(stage: Stage) -> Seen:
    """The picture that freezes is a true one; the second and third tell that time stands still."""
    begin_s, _ = stage.undisturbed.spans(State.DETECT)[0]
    run = spray_row(stage.folder, faults=(f"camera:stuck@{begin_s - 0.01:.4f}s",), **SHORT)
    assert [frame.stop for frame in run.frames] == [1]
    assert {shot.intent.stop for shot in run.shots} == {1}
    return judged(run, looked_s(run), "identical ones in a row", "[F51]", kept=KEPT)


def from_second_look(fault: str, *words: str) -> Scenario:
    def scenario(stage: Stage) -> Seen:
        at_s = stage.undisturbed.spans(State.DETECT)[1][0] - 0.5
        run = spray_row(stage.folder, faults=(f"{fault}@{at_s:.4f}s",), **SHORT)
        rolled_s = [timed.t for timed in last_process(run).commands if isinstance(timed.command, WheelsDrive)]
        assert max(rolled_s) < looked_s(run)
        return nothing_sprayed_on_it(run, *words)

    return scenario


def knock(turned_deg: tuple[float, float, float], state: State, count: int) -> Meddler:
    """One eye turns about x (pitch) or z (roll)."""

    async def meddle(world: World) -> None:
        if count:
            await world.until(state, count)
        world.twin.renderer = WatchedRenderer(grow(world.twin.scene), turned_optics(turned_deg), world.twin.seed)

    return meddle


def knocked(*turned_deg: float) -> Scenario:
    def scenario(stage: Stage) -> Seen:
        pitch, yaw, roll = turned_deg
        run = spray_row(stage.folder, meddler=knock((pitch, yaw, roll), State.MOVE, 2), **SHORT)
        return nothing_sprayed_on_it(run, "something has moved the lenses", "[F54]", kept="the offset in pixels")

    return scenario


def knocked_before(stage: Stage) -> Seen:
    run = spray_row(stage.folder, meddler=knock((1.0, 0.0, 0.0), State.MOVE, 0), **SHORT)
    assert run.shots == ()
    assert run.twin.dispensed_ml == 0.0
    begin_s, _ = run.spans(State.DETECT)[0]
    return judged(run, begin_s, "something has moved the lenses", "[F54]", kept="the offset in pixels")


def one_eye_lags(stage: Stage) -> Seen:
    """The right view is 0.2 s older; it does no harm, as pictures are used from a base that has stood for longer."""
    past: list[tuple[float, object]] = []

    async def lag(world: World) -> None:
        now_expose = world.twin.expose

        def expose(now_s, exposure_s, gain, sequence):  # type: ignore[no-untyped-def]
            left, _ = now_expose(now_s, exposure_s, gain, sequence)
            shot = next(shot for stamp_s, shot in reversed(past) if stamp_s <= now_s - 0.2)
            _, right = world.twin.renderer.render(
                shot.row_from_camera, shot.light, exposure_s, gain, shot.bodies, sequence + 100_000
            )
            now_expose(now_s, exposure_s, gain, sequence)  # what the oracle knows is the present
            return left, right

        world.twin.expose = expose  # type: ignore[method-assign]
        while True:
            past.append((world.now_s, world.twin.shot(world.now_s)))
            await asyncio.sleep(0.02)

    run = spray_row(stage.folder, meddler=lag, **SHORT)
    assert len(run.frames) == 2
    for frame in run.frames:
        poses = [s.row_from_camera for t, s in past if frame.frame.stamp_s - 0.25 <= t <= frame.frame.stamp_s]  # type: ignore[attr-defined]
        assert np.ptp(np.array(poses), axis=0).max() < 1e-4
    assert len(run.shots) == len(stage.undisturbed.shots)
    return replace(judged(run, 0.0, kept="the pairs: the base stood through both views"), after_s=0.0)


PICTURES: Scenarios = {
    "F51": {"": frozen},
    "F52": {
        "cap on": spoiled(black, "the left view black", "[F52]", **FIXED_EXPOSURE),
        "cap on, exposure free": spoiled(black, "take the cap off the lens", "[F52]"),
        "burnt out": spoiled(white, "the left view white", "[F52]", **FIXED_EXPOSURE),
        "a hand on one lens": spoiled(covered_left, "the left view covered", "[F52]", **FIXED_EXPOSURE),
        "spray on the lenses": spoiled(smeared, "blurred", "[F52]", **FIXED_EXPOSURE),
    },
    "F53": {"": from_second_look("camera:wrong", "change left and right", "[F53]")},
    "F54": {
        "pitched": knocked(1.0, 0.0, 0.0),
        "rolled": knocked(0.0, 0.0, 1.0),
        "pitched back by half a degree": knocked(-0.5, 0.0, 0.0),
        "before the mission": knocked_before,
    },
    "F55": {"an eye that lags": one_eye_lags},
}
