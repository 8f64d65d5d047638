"""Faults of seeing and of knowing where the rover is."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import timedelta

import numpy as np
import numpy.typing as npt
import pytest

from drivers.errors import DeviceError
from drivers.gps.nmea import NmeaGps
from drivers.twin import Twin
from drivers.twin.commands import (
    WheelsDrive,
    WheelsStop,
    WorldBumper,
    WorldGpsQuality,
    WorldPush,
    WorldTilt,
)
from robot.actuation import Refused
from robot.clock import run_virtual
from robot.mission import State, TargetSkipped
from robot.safety import Mode
from robot.safety.catalogue import Action
from robot.vision.stereo_rig import StereoRig
from robot.vision.values import Circle, Fruit
from tests.contract.rigged import Rigged
from tests.drivers.gps.rig import now
from tests.drivers.gps.rig import run as on_receiver
from tests.robot.machine import machine
from tests.robot.mission.conftest import SHORT
from tests.robot.mission.oracle import Oracle
from tests.robot.mission.rover import Meddler, World, spray_row
from tests.robot.mission.truths import last_process, openings_asked_after, stop_errors_m

from .buses import failing, suffering
from .judging import is_accounted_for, judged
from .pictures import PICTURES, from_second_look
from .values import Scenario, Scenarios, Seen, Stage

Image = npt.NDArray[np.uint8]
WEEKS_1024 = timedelta(weeks=1024)
BY_WHEELS = "the pose by wheels and landmarks, to 2 cm at every stop"


def rolled_before_a_shot(stage: Stage) -> Seen:
    """Somebody leans on the rover while it aims: it looks again before it sprays."""
    moments: list[float] = []

    async def roll(world: World) -> None:
        await world.until(State.AIM)
        await asyncio.sleep(0.6)
        moments.append(world.now_s)
        world.suffer(WheelsDrive(0.15, 0.0))
        await asyncio.sleep(0.45)
        world.suffer(WheelsStop())

    run = spray_row(stage.folder, meddler=roll, **SHORT)
    assert run.result.state is State.DONE
    is_accounted_for(run)
    process = last_process(run)
    looked_s = min(view.t for view in process.views if view.t > moments[0])
    left_s = next(entered.stamp_s for entered in run.states if entered.reason == "base moved")
    assert [t for t in openings_asked_after(process, left_s) if t < looked_s] == []
    assert {shot.intent.stop for shot in run.shots} == {1, 2}
    return Seen(Action.INHIBIT_SPRAY, _refused_after_s(stage), "the target, looked for again")


def _refused_after_s(stage: Stage) -> float:
    """From the base's first motion until no shot at what was seen before is allowed any more."""

    async def main() -> float:
        async with machine(stage.folder) as m:
            await m.ready_to_spray()
            began_s = now()
            m.twin.apply(began_s, WheelsDrive(0.15, 0.0))
            while not m.actuation.base_moved:  # noqa: ASYNC110 - the machine gives no signal
                await asyncio.sleep(0.005)
            after_s = now() - began_s
            m.twin.apply(now(), WheelsStop())
            await asyncio.sleep(1.0)
            with pytest.raises(Refused, match="base"):
                await m.spray()
            assert m.twin.dispensed_ml == 0.0
            assert m.actuation.state.mode is Mode.AUTO
            return after_s

    return run_virtual(main())


Spoil = Callable[[tuple[Fruit, ...]], tuple[Fruit, ...]]


@dataclass
class Nonsense:
    """Sees what another does, spoilt from the second pair on."""

    oracle: Oracle
    spoil: Spoil
    pairs: int = 0

    def detect(self, left: Image, right: Image, rig: StereoRig) -> tuple[Fruit, ...]:
        self.pairs += 1
        fruits = self.oracle.detect(left, right, rig)
        return fruits if self.pairs == 1 else self.spoil(fruits)

    def detect_mono(self, image: Image) -> tuple[Circle, ...]:
        return self.oracle.detect_mono(image)


def nonsense(spoil: Spoil, *words: str) -> Scenario:
    def scenario(stage: Stage) -> Seen:
        run = spray_row(stage.folder, eyes=lambda oracle: Nonsense(oracle, spoil), **SHORT)
        assert {shot.intent.stop for shot in run.shots} == {1}
        assert [len(frame.fruits) for frame in run.frames][1:] == [0]
        return judged(run, run.spans(State.DETECT)[1][0], "[F57]", *words, kept="the reason, at its stop")

    return scenario


def each(**changes: object) -> Spoil:
    return lambda fruits: tuple(replace(fruit, **changes) for fruit in fruits)  # type: ignore[arg-type]


def huge_box(fruits: tuple[Fruit, ...]) -> tuple[Fruit, ...]:
    return tuple(replace(fruit, left=replace(fruit.left, r_px=5000.0)) for fruit in fruits)


def error(fruits: tuple[Fruit, ...]) -> tuple[Fruit, ...]:
    raise ValueError("operands could not be broadcast together")


def out_of_reach(stage: Stage) -> Seen:
    """A fruit behind the plants, where no arm reaches."""
    told: list[tuple[float, str]] = []

    def farther(fruits: tuple[Fruit, ...]) -> tuple[Fruit, ...]:
        return tuple(replace(fruit, centre_m=np.add(fruit.centre_m, (0.0, 0.0, 1.5))) for fruit in fruits)

    async def listen(world: World) -> None:
        skips = world.bus.subscribe(TargetSkipped)
        while True:
            skipped = await skips.next()
            told.append((world.now_s, skipped.reason))

    run = spray_row(stage.folder, eyes=lambda oracle: Nonsense(oracle, farther), meddler=listen, **SHORT)
    assert run.result.state is State.DONE
    assert {shot.intent.stop for shot in run.shots} == {1}
    is_accounted_for(run)
    begin_s = next(entered.stamp_s for entered in run.states if entered.state is State.AIM and entered.stop == 2)
    at_s, reason = next(item for item in told if item[0] >= begin_s)
    return Seen(Action.WARN, at_s - begin_s, f"the target, skipped: {reason}")


def satellites(meddle: Callable[[World], None], *words: str) -> Scenario:
    """The mission goes on by wheels and landmarks."""

    def scenario(stage: Stage) -> Seen:
        moments: list[float] = []

        async def strike(world: World) -> None:
            await world.until(State.AIM)
            moments.append(world.now_s)
            meddle(world)

        return goes_on_without(stage, moments, strike, words)

    return scenario


def receiver(fault: str, *words: str) -> Scenario:
    def scenario(stage: Stage) -> Seen:
        at_s = stage.moment(State.AIM, 0.5)
        return goes_on_without(stage, [at_s], None, words, f"{fault}@{at_s:.4f}s")

    return scenario


def goes_on_without(
    stage: Stage, at_s: list[float], meddler: Meddler | None, words: tuple[str, ...], *faults: str
) -> Seen:
    run = spray_row(stage.folder, meddler=meddler, faults=faults, **SHORT)
    assert len(run.shots) == len(stage.undisturbed.shots)
    assert max(stop_errors_m(run)) <= 0.020
    return judged(run, at_s[0], *words, kept=BY_WHEELS)


def weeks_rolled_over(world: World) -> None:
    fix = world.twin.fix

    def old(now_s: float):  # type: ignore[no-untyped-def]
        seen = fix(now_s)
        assert seen.utc is not None
        return replace(seen, utc=seen.utc - WEEKS_1024)

    world.twin.fix = old  # type: ignore[method-assign]


def garbage_on_the_wire(_stage: Stage) -> Seen:
    """Bits turned in every sentence for a while: counted; fixes come again when it is over."""
    seen: list[Seen] = []

    async def test(rigged: Rigged[NmeaGps], _twin: Twin) -> None:
        device = rigged.device
        await device.next_fix()
        await asyncio.sleep(max(0.0, 2.0 - now()))
        while now() < 3.2:
            try:
                await device.next_fix()
            except DeviceError:
                break
        statistics = device.statistics
        bad = statistics.bad_sentences + statistics.refused
        assert bad >= 1
        seen.append(Seen(Action.WARN, max(0.0, now() - 2.0), f"the count of bad sentences ({bad})"))
        async with asyncio.timeout(6.0):
            fix = await device.next_fix()
        assert fix.latitude_deg is not None

    on_receiver(test, "gps:garbage@2s+1s")
    return seen[0]


def pushed_over_the_fence(stage: Stage) -> Seen:
    """Somebody shoves the rover sideways, its wheels skid; satellites tell where it is."""
    moments: list[float] = []

    async def push(world: World) -> None:
        await world.until(State.AIM)
        await asyncio.sleep(1.0)
        moments.append(world.now_s)
        world.suffer(WorldPush(0.0, 0.28, 0.0))

    fence = {"navigation": {"geofence_m": [[-1.0, -0.2], [3.0, -0.2], [3.0, 0.2], [-1.0, 0.2]]}}
    run = spray_row(stage.folder, meddler=push, **SHORT, **fence)  # type: ignore[arg-type]
    return judged(run, moments[0], "outside of the geofence [F63]", kept="the pose")


def _bumped(state: State, after_s: float) -> Scenario:
    return suffering(WorldBumper(True), state, "bumper", after_s=after_s, kept="the moment")


def _tilted(state: State, after_s: float) -> Scenario:
    return suffering(WorldTilt(0.0, 0.5), state, "tilts", after_s=after_s, kept="the angle")


PERCEPTION: Scenarios = {
    **PICTURES,
    "F50": {
        "gone": failing("camera:off", State.STOP, 0.5, "camera", kept="the place in the row"),
        "garbled": failing("camera:garbage", State.STOP, 0.5, "a garbled answer", kept="the place in the row"),
        "late": from_second_look("camera:delayed", "a pair exposed after it was asked for"),
    },
    "F56": {"": rolled_before_a_shot},
    "F57": {
        "centres that are no number": nonsense(each(centre_m=np.array([np.nan, 0.0, 1.0])), "the centre"),
        "infinite diameters": nonsense(each(diameter_m=np.inf), "a diameter of inf"),
        "huge boxes": nonsense(huge_box, "the outline"),
        "ten thousand fruits": nonsense(lambda fruits: fruits * 10_000, "fruits (at most"),
        "an error": nonsense(error, "ValueError: operands"),
    },
    "F58": {"": out_of_reach},
    "F59": {
        "while it drives": _bumped(State.MOVE, 0.5),
        "while it aims": _bumped(State.AIM, 0.5),
        "while it sprays": _bumped(State.SPRAY, 0.03),
    },
    "F60": {
        "silent": receiver("gps:off", "gps"),
        "no fix": satellites(lambda world: world.suffer(WorldGpsQuality(0)), "[F60]", "NONE"),
        "no corrections": satellites(lambda world: world.suffer(WorldGpsQuality(1)), "[F60]", "SINGLE"),
    },
    "F61": {"": receiver("gps:wrong", "[F61]")},
    "F62": {"in a mission": receiver("gps:garbage", "garbled"), "on the wire": garbage_on_the_wire},
    "F42": {"": satellites(weeks_rolled_over, "the receiver's date is 20", "[F42]")},
    "F63": {"": pushed_over_the_fence},
    "F64": {
        "while it drives": _tilted(State.MOVE, 0.5),
        "while it aims": _tilted(State.AIM, 0.5),
        "while it sprays": _tilted(State.SPRAY, 0.03),
    },
}

