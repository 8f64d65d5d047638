"""What the grower, the label and the tank allow."""

import asyncio

import pytest

from drivers.twin.commands import WheelsDrive, WorldBattery
from robot.mission import State
from robot.safety import Mode
from robot.targets import TargetState

from .conftest import SHORT
from .rover import Run, World, spray_row
from .truths import sightings

DENSE = {"stops_m": SHORT["stops_m"], "length_m": SHORT["length_m"]}
ONE_STOP = {"stops_m": (0.35,), "length_m": 0.9}


def test_only_the_ripeness_that_is_wanted_is_sprayed(tmp_path):
    run = spray_row(tmp_path, targets={"ripeness": ["red"]}, **DENSE)
    ripeness = {fruit.id: fruit.ripeness for fruit in run.truth.fruits}
    kinds = {target: ripeness[fruit] for fruit, target in sightings(run)}
    left = [target for target in run.targets if target.state is TargetState.NOT_WANTED]
    assert {kinds[shot.intent.target_id] for shot in run.shots} == {"red"}
    assert {kinds[target.id] for target in left} == {"turning", "green"}
    assert {target.reason for target in left} == {"turning fruit is not treated", "green fruit is not treated"}
    assert set(kinds.values()) == {"red", "turning", "green"}


def test_the_fixed_law_gives_every_fruit_the_same(tmp_path):
    run = spray_row(tmp_path, dosing={"law": "fixed", "coefficient": 3.0}, **SHORT)
    given = [opening.ml for opening in run.truth.delivered]
    assert len(given) >= 3
    assert {shot.intent.dose_ml for shot in run.shots} == {3.0}
    assert given == pytest.approx([3.0] * len(given), rel=0.1)


def test_a_dose_follows_from_the_size_of_the_fruit(undisturbed):
    """Twice the diameter, eight times the dose, inside minimum and maximum."""
    law, diameters = undisturbed.config.dosing, {target.id: target.diameter_m for target in undisturbed.targets}
    for shot in undisturbed.shots:
        due_ml = law.coefficient * 0.5235987756 * (100.0 * diameters[shot.intent.target_id]) ** 3
        assert shot.intent.dose_ml == pytest.approx(min(max(due_ml, law.min_ml), law.max_ml), rel=0.1)


def refused_reasons(run: Run) -> set[str]:
    sprayed = {shot.intent.target_id for shot in run.shots}
    return {t.reason for t in run.targets if t.id not in sprayed and t.state is TargetState.UNREACHABLE}


def test_a_tank_that_is_nearly_empty_keeps_its_reserve_and_says_so(tmp_path):
    run = spray_row(tmp_path, task={"tank_fill_ml": 215.0}, **ONE_STOP)
    assert run.result.mode is Mode.SAFE_STOP
    assert "paused for 600 s: the tank holds" in run.result.causes[0]
    assert 1 <= len(run.shots) < 6
    assert run.twin.physics.tank_ml >= run.config.fluid.tank_reserve_ml


def test_a_low_battery_pauses_the_row_and_a_charged_one_goes_on_by_itself(tmp_path):
    (tmp_path / "whole").mkdir()
    (tmp_path / "paused").mkdir()
    whole = spray_row(tmp_path / "whole", **ONE_STOP)
    moments: list[float] = []

    async def sag(world: World) -> None:
        await world.until(State.SPRAY, 2)
        world.suffer(WorldBattery(22.0))
        await world.until(State.IDLE)
        moments.append(world.now_s)
        await asyncio.sleep(60.0)
        world.suffer(WorldBattery(25.0))
        moments.append(world.now_s)

    guarded = {"battery_low_v": 22.8, "battery_stop_v": 21.6}
    run = spray_row(tmp_path / "paused", meddler=sag, safety=guarded, **ONE_STOP)
    assert run.result.state is State.DONE
    paused = next(change for change in run.modes if change.mode is Mode.PAUSED)
    assert "the battery is at" in paused.causes[0]
    assert not [opening for opening in run.truth.delivered if moments[0] + 0.2 < opening.closed_t < moments[1]]
    assert {shot.intent.target_id for shot in run.shots} == {shot.intent.target_id for shot in whole.shots}
    assert run.totals.booked_ml >= run.twin.dispensed_ml


def test_a_row_that_somebody_shifted_the_rover_in_while_paused_waits_for_a_person(tmp_path):
    async def sag_and_push(world: World) -> None:
        await world.until(State.SPRAY, 2)
        world.suffer(WorldBattery(22.0))
        await world.until(State.IDLE)
        for _ in range(3):  # a longer push is taken for a drive that does not stop
            world.suffer(WheelsDrive(0.2, 0.0))
            await asyncio.sleep(2.0)
        await asyncio.sleep(60.0)
        world.suffer(WorldBattery(25.0))

    guarded = {"battery_low_v": 22.8, "battery_stop_v": 21.6}
    run = spray_row(tmp_path, meddler=sag_and_push, safety=guarded, **ONE_STOP)
    assert run.result.mode is Mode.SAFE_STOP
    assert "paused for 600 s" in run.result.causes[0]


def test_the_labels_cap_is_never_passed_and_the_refusal_says_so(tmp_path):
    run = spray_row(tmp_path, task={"label_cap_ml": 20.0}, **ONE_STOP)
    assert run.result.state is State.DONE
    assert len(run.shots) >= 1
    assert run.twin.dispensed_ml <= run.totals.booked_ml <= 20.0
    assert any("task:" in reason and "over the cap of 20.00" in reason for reason in refused_reasons(run))


def test_the_cap_of_a_rolling_minute_is_kept_in_truth(tmp_path):
    run = spray_row(tmp_path, safety={"max_minute_ml": 20.0}, **ONE_STOP)
    given = [(opening.closed_t, opening.ml) for opening in run.truth.delivered]
    assert len(given) >= 2
    for end_s, _ in given:
        assert sum(ml for t, ml in given if end_s - 60.0 < t <= end_s) <= 20.0
