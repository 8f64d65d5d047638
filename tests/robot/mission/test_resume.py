"""A row that is stopped and gone on with, on the same machine and the same ledger."""

import asyncio
import signal

import pytest

from robot.errors import ConfigError, UsageError
from robot.ledger.values import Outcome
from robot.mission import State
from robot.safety import Mode
from robot.targets import TargetState

from .conftest import SHORT
from .rover import Run, World, spray_row
from .truths import openings, sightings, stop_errors_m


def stopped_then_resumed(folder, at_s: float, **changes) -> tuple[Run, Run]:
    async def stop(world: World) -> None:
        await asyncio.sleep(at_s)
        signal.raise_signal(signal.SIGTERM)

    first = spray_row(folder, meddler=stop, **SHORT, **changes)
    return first, spray_row(folder, resume=True, **SHORT, **changes)


@pytest.fixture(scope="module", params=["moving", "aiming", "spraying"])
def runs(request, undisturbed, tmp_path_factory) -> tuple[Run, Run]:
    state = {"moving": State.MOVE, "aiming": State.AIM, "spraying": State.SPRAY}[request.param]
    start_s, end_s = undisturbed.spans(state)[1]
    at_s = start_s + 0.1 if state is State.SPRAY else 0.5 * (start_s + end_s)
    return stopped_then_resumed(tmp_path_factory.mktemp("resumed"), at_s)


def test_the_second_run_brings_the_row_to_its_end(runs):
    first, second = runs
    assert first.result.mode is Mode.SAFE_STOP
    assert second.result.state is State.DONE
    assert second.result.task_id == first.result.task_id


def test_what_was_sprayed_or_may_have_been_is_not_sprayed_again(runs):
    first, second = runs
    before = {shot.intent.target_id for shot in first.shots if shot.result.outcome is not Outcome.NOT_OPENED}
    new = {shot.intent.target_id for shot in second.shots[len(first.shots) :]}
    assert before
    assert new
    assert before & new == set()
    fruit_of = {target: fruit for fruit, target in (*sightings(first), *sightings(second))}
    assert {fruit_of[target] for target in before} & {fruit_of[target] for target in new} == set()


def test_no_fruit_of_the_undisturbed_row_is_left_out(runs, undisturbed):
    _, second = runs
    treated = {t.id for t in second.targets if t.state in (TargetState.SPRAYED, TargetState.UNCERTAIN)}
    assert len(treated) >= len(undisturbed.shots) - 1


def test_both_runs_together_are_booked_and_delivered_alike(runs):
    _, second = runs
    assert len(second.truth.processes) == 2
    assert sum(len(openings(process)) for process in second.truth.processes) == len(second.truth.delivered)
    assert second.twin.dispensed_ml <= second.totals.booked_ml <= 1.05 * second.twin.dispensed_ml + 0.7


def test_the_resumed_rover_still_stands_within_20_mm_of_its_stops(runs):
    _, second = runs
    assert max(stop_errors_m(second)) <= 0.020


def test_a_resume_with_another_configuration_is_refused(undisturbed, tmp_path):
    start_s, _ = undisturbed.spans(State.AIM)[1]

    async def stop(world: World) -> None:
        await asyncio.sleep(start_s)
        signal.raise_signal(signal.SIGTERM)

    spray_row(tmp_path, meddler=stop, **SHORT)
    with pytest.raises(ConfigError, match="was begun with another configuration"):
        spray_row(tmp_path, resume=True, dosing={"max_ml": 7.0}, **SHORT)


def test_a_resume_without_a_task_is_refused(tmp_path):
    with pytest.raises(UsageError, match="to resume"):
        spray_row(tmp_path, resume=True, **SHORT)


def test_the_labels_cap_counts_what_the_first_run_gave(undisturbed, tmp_path):
    start_s, _ = undisturbed.spans(State.SPRAY)[1]
    cap_ml = 1.2 * undisturbed.shots[0].result.booked_ml + undisturbed.shots[1].intent.full_ml
    first, second = stopped_then_resumed(tmp_path, start_s - 0.2, task={"label_cap_ml": round(cap_ml, 1)})
    assert first.shots
    assert second.totals.booked_ml <= cap_ml
    assert second.twin.dispensed_ml <= cap_ml
