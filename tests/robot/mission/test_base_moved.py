"""The base does not stay where the targets were seen."""

import asyncio
import math

import pytest

from drivers.twin.commands import WheelsDrive, WheelsStop, WorldPush
from robot.ledger.values import Outcome
from robot.mission import State
from robot.targets import TargetState

from .rover import Run, World, spray_row
from .truths import last_process, openings, sightings, stop_errors_m

DENSE = {"stops_m": (0.25,), "length_m": 0.9}


async def roll(world: World) -> None:
    """Somebody leans on the rover: its wheels turn by some centimetres."""
    world.suffer(WheelsDrive(0.15, 0.0))
    await asyncio.sleep(0.45)
    world.suffer(WheelsStop())


def rolled_while(tmp_path, state: State, count: int, after_s: float) -> tuple[Run, float]:
    began_s: list[float] = []

    async def lean(world: World) -> None:
        await world.until(state, count)
        await asyncio.sleep(after_s)
        began_s.append(world.now_s)
        await roll(world)

    return spray_row(tmp_path, meddler=lean, **DENSE), began_s[0]


@pytest.mark.parametrize(
    ("state", "count", "after_s"), [(State.AIM, 1, 0.6), (State.AIM, 2, 0.3), (State.SPRAY, 1, 0.05)]
)
def test_a_rover_that_was_rolled_looks_again_before_it_sprays(state, count, after_s, tmp_path):
    run, at_s = rolled_while(tmp_path, state, count, after_s)
    views = [view.t for view in last_process(run).views]
    later = [shot.intent.stamp_s for shot in run.shots if shot.intent.stamp_s > at_s]
    looked_s = min(t for t in views if t > at_s)
    assert run.result.state is State.DONE
    assert later
    assert min(later) > looked_s
    assert any(entered.reason == "base moved" for entered in run.states)
    fruit_of = {target: fruit for fruit, target in sightings(run)}
    sprayed = [target.id for target in run.targets if target.state is TargetState.SPRAYED]
    assert len({fruit_of[target] for target in sprayed}) == len(sprayed)


def test_after_a_roll_the_shots_still_meet_their_fruit(tmp_path):
    run, _ = rolled_while(tmp_path, State.AIM, 2, 0.3)
    centres = {fruit.id: (fruit.centre_m, fruit.diameter_m) for fruit in run.truth.fruits}
    fruit_of = {target: fruit for fruit, target in sightings(run)}
    missed = 0
    for shot, opening in zip(run.shots, run.truth.delivered, strict=True):
        centre_m, diameter_m = centres[fruit_of[shot.intent.target_id]]
        away = [c - n for c, n in zip(centre_m, opening.nozzle_m, strict=True)]
        along = sum(a * b for a, b in zip(away, opening.axis, strict=True))
        missed += math.sqrt(max(0.0, sum(a * a for a in away) - along**2)) > 0.5 * diameter_m
    assert missed == 0


def test_a_shot_is_cut_when_the_base_is_rolled_and_its_target_is_uncertain(tmp_path):
    began_s: list[float] = []

    async def lean(world: World) -> None:
        await world.until_valve_opens()
        began_s.append(world.now_s)
        await roll(world)

    run = spray_row(tmp_path, meddler=lean, dosing={"law": "fixed", "coefficient": 10.0}, **DENSE)
    first = run.shots[0]
    _, shut_s = openings(last_process(run))[0]
    assert first.result.outcome is Outcome.SHORTENED
    assert "the base moved" in first.result.reason
    assert shut_s - began_s[0] <= 0.3
    assert run.truth.delivered[0].ml < 0.5 * 10.0
    assert run.truth.delivered[0].ml <= first.result.booked_ml
    assert {target.id: target.state for target in run.targets}[first.intent.target_id] is TargetState.UNCERTAIN
    assert sum(shot.intent.target_id == first.intent.target_id for shot in run.shots) == 1


def test_a_rover_that_was_shoved_on_skidding_wheels_is_found_again_by_satellites(tmp_path):
    """The wheels count nothing; a second of RTK fixes tells. At most the shot under way goes astray."""
    pushed_s: list[float] = []

    async def shove(world: World) -> None:
        await world.until(State.AIM, 2)
        pushed_s.append(world.now_s)
        world.suffer(WorldPush(0.15, 0.0, 0.0))

    run = spray_row(tmp_path, (0.2, 0.6), 0.9, meddler=shove)
    looks = [entered for entered in run.states if entered.reason == "base moved"]
    again_s = next(view.t for view in last_process(run).views if view.t > pushed_s[0])
    assert run.result.state is State.DONE
    assert [look.state for look in looks] == [State.STOP]
    assert looks[0].stamp_s < again_s < pushed_s[0] + 8.0
    assert sum(pushed_s[0] < shot.intent.stamp_s < again_s for shot in run.shots) <= 1
    assert stop_errors_m(run)[-1] <= 0.020


def test_a_frame_that_was_taken_while_the_base_rolled_is_not_used(tmp_path):
    async def lean(world: World) -> None:
        await world.until(State.DETECT)
        await roll(world)

    run = spray_row(tmp_path, meddler=lean, faults=("camera:slow",), **DENSE)
    used = {frame.frame.stamp_s for frame in run.frames}
    views = [view.t for view in last_process(run).views]
    assert views[0] not in used
    assert set(views[1:]) == used
    assert [entered.state for entered in run.states[3:6]] == [State.STOP, State.DETECT, State.AIM]
    assert run.result.state is State.DONE
