"""F66 and its repair: whoever acknowledges it has seen to the nozzle, and the shots of before count no more."""

import asyncio
from dataclasses import replace

import pytest

from robot.control import Machine
from robot.ledger import Ledger, Outcome, Result
from robot.mission import State
from robot.runtime import ledger_path
from robot.runtime.resuming import BY_HAND
from robot.safety import Mode
from tests.robot.control.test_orders import begin, lives, until_mode
from tests.robot.ledger.rows import INTENT, NOON, TASK, target
from tests.robot.mission.rover import World, spray_row

ROW = {"stops_m": (0.25, 0.65), "length_m": 0.9, "twin": {"fruits_per_plant": 2.5}}
MODEL_ML, MEASURED_ML = 5.0, 3.75  # no shot alone is a reason to stop, ten of them are
BEFORE = 9
LONGEST_ROW_S = 200.0


@pytest.fixture
def worn(tmp_path):
    """A folder whose ledger remembers nine thin shots: the next one tells."""
    path = ledger_path(tmp_path / "run")
    path.parent.mkdir()
    with Ledger.open(path, utc=lambda: NOON) as ledger:
        ledger.begin_run("boot", NOON)
        task_id = ledger.begin_task(replace(TASK, route=BY_HAND))
        for number in range(1, BEFORE + 1):
            ledger.upsert_targets(task_id, [target(number)])
            intent = ledger.write_intent(task_id, replace(INTENT, target_id=number, model_ml=MODEL_ML))
            ledger.write_result(intent, Result(Outcome.SPRAYED, MODEL_ML, 0.4, MEASURED_ML, "", 13.0))
    return tmp_path


async def until_f66(_world: World, machine: Machine) -> None:
    await begin(machine)
    await until_mode(machine, Mode.SAFE_STOP)
    status = await machine.status()
    assert "F66" in [fault.fault for fault in status.faults]
    assert any("over 10 shots the flow meter saw" in cause for cause in status.causes)


async def acknowledged_it_goes_on(_world: World, machine: Machine) -> None:
    await machine.acknowledge("test")
    assert (await machine.status()).faults == ()
    await begin(machine)
    async with asyncio.timeout(LONGEST_ROW_S):
        await until_mode(machine, Mode.DISARMED)
    assert (await machine.status()).mission.state is State.DONE


def checked(run) -> list[tuple[int, str]]:  # type: ignore[no-untyped-def]
    return [(event.run_id, event.text) for event in run.events if event.kind == "nozzle"]


def test_an_acknowledged_nozzle_fault_is_over_and_the_row_is_done_in_the_same_life(worn):
    async def orders(world: World, machine: Machine) -> None:
        await until_f66(world, machine)
        await acknowledged_it_goes_on(world, machine)

    run = lives(worn, orders, **ROW)
    assert run.result.state is State.DONE
    assert checked(run) == [(2, "seen to by demo")]
    assert len(run.shots) > 2
    assert run.twin.dispensed_ml <= run.totals.booked_ml


def test_acknowledged_after_a_restart_the_shots_of_before_count_no_more_either(worn):
    async def orders(world: World, machine: Machine) -> None:
        status = await machine.status()
        assert status.mode is Mode.SAFE_STOP
        assert any(cause.endswith("[F66]") for cause in status.causes)
        await acknowledged_it_goes_on(world, machine)

    before = lives(worn, until_f66, **ROW)
    assert checked(before) == []
    assert len(before.shots) == 1
    run = lives(worn, orders, **ROW)
    assert run.result.state is State.DONE
    assert checked(run) == [(3, "seen to by demo")]
    targets = [shot.intent.target_id for shot in run.shots]
    assert len(set(targets)) == len(targets) > 2


def test_a_start_at_the_command_line_is_such_a_word_too(worn):
    lives(worn, until_f66, **ROW)
    run = spray_row(worn, resume=True, **ROW)
    assert run.result.state is State.DONE
    assert checked(run) == [(3, "seen to by demo")]


def test_another_stop_says_nothing_of_the_nozzle(tmp_path):
    async def orders(world: World, machine: Machine) -> None:
        await begin(machine)
        await world.until(State.AIM)
        await machine.stop("enough")
        await machine.acknowledge("test")

    assert checked(lives(tmp_path, orders, **ROW)) == []
