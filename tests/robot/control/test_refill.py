"""F65 and its repair, in virtual time: a row that waits for liquid, an operator who fills the tank and says so."""

import asyncio
import math
from collections import Counter

import pytest

from drivers.twin.commands import WorldRefill
from robot.control import Declined, Machine
from robot.ledger import Ledger
from robot.mission import State
from robot.runtime import ledger_path
from robot.runtime.resuming import tank_left_ml
from robot.safety import Mode
from robot.targets import TargetState
from tests.robot.control.test_orders import begin, lives, until_mode
from tests.robot.mission.rover import Run, World
from tests.robot.mission.truths import last_process, openings, sightings

ROW = {"stops_m": (0.25, 0.65), "length_m": 0.9, "twin": {"fruits_per_plant": 2.5}}
LOW = {"task": {"tank_fill_ml": 215.0}}  # the first shot takes the balance below what the next may need
FILLED_ML = 4321.0625


async def fill(world: World, machine: Machine, tank_ml: float = FILLED_ML) -> None:
    """As a person does: pour, then say so."""
    world.suffer(WorldRefill(tank_ml))
    await machine.refill(tank_ml, "test")


def by_fate(run: Run) -> Counter[TargetState]:
    return Counter(target.state for target in run.targets)


def fruits_shot(run: Run) -> list[int]:
    fruit_of = {target: fruit for fruit, target in sightings(run)}
    return [fruit_of[shot.intent.target_id] for shot in run.shots]


@pytest.fixture(scope="module")
def full(tmp_path_factory) -> Run:
    """The same row with liquid enough."""

    async def orders(_world: World, machine: Machine) -> None:
        await begin(machine)
        await until_mode(machine, Mode.DISARMED)

    return lives(tmp_path_factory.mktemp("full"), orders, **ROW)


def test_a_row_that_waits_for_liquid_goes_on_by_itself_leaves_nobody_out_and_sprays_none_twice(full, tmp_path):
    balances: list[tuple[float, float]] = []
    filled_s: list[float] = []

    async def orders(world: World, machine: Machine) -> None:
        await begin(machine)
        await until_mode(machine, Mode.PAUSED)
        status = await machine.status()
        assert any(cause.endswith("refill it [F65]") for cause in status.causes)
        await asyncio.sleep(60.0)
        assert (await machine.status()).mode is Mode.PAUSED
        given_ml = (await machine.status()).ledger.booked_ml
        filled_s.append(world.now_s)
        await fill(world, machine)
        assert (await machine.status()).tank_left_ml == FILLED_ML
        await until_mode(machine, Mode.AUTO)
        assert world.now_s - filled_s[0] < 2.0
        assert (await machine.status()).faults == ()
        await until_mode(machine, Mode.DISARMED)
        status = await machine.status()
        balances.append((status.tank_left_ml, FILLED_ML - (status.ledger.booked_ml - given_ml)))

    run = lives(tmp_path, orders, **ROW, **LOW)
    assert run.result.state is State.DONE
    assert sorted(fruits_shot(run)) == sorted(set(fruits_shot(run))) == sorted(fruits_shot(full))
    assert by_fate(run) == by_fate(full)
    assert sum(begin_s > filled_s[0] for begin_s, _ in openings(last_process(run))) == len(run.shots) - 1 > 0
    assert balances[0][0] == pytest.approx(balances[0][1], abs=1e-9)
    assert run.twin.physics.tank_ml >= balances[0][0]  # truly: never more was given than booked
    assert run.twin.dispensed_ml <= run.totals.booked_ml


def test_the_balance_is_right_after_a_sigterm_and_the_row_goes_on_with_it(full, tmp_path):
    plans: list[float] = []

    async def first(world: World, machine: Machine) -> None:
        await begin(machine)
        await until_mode(machine, Mode.PAUSED)
        await fill(world, machine)
        await until_mode(machine, Mode.AUTO)
        await world.until_valve_opens()
        await asyncio.sleep(0.05)  # told to end in the middle of a shot

    async def second(_world: World, machine: Machine) -> None:
        await begin(machine)
        status = await machine.status()
        plans.append(status.tank_left_ml)
        await until_mode(machine, Mode.DISARMED)

    before = lives(tmp_path, first, **ROW, **LOW)
    booked_ml = [shot.result.booked_ml for shot in before.shots]
    assert len(booked_ml) == 2
    run = lives(tmp_path, second, **ROW, **LOW)
    assert plans == [pytest.approx(FILLED_ML - booked_ml[1], abs=1e-9)]
    assert run.result.state is State.DONE
    assert sorted(fruits_shot(run)) == sorted(fruits_shot(full))
    with Ledger.open(ledger_path(tmp_path / "run")) as ledger:
        left_ml = tank_left_ml(ledger, 1, 215.0, math.nan)
    assert left_ml == pytest.approx(FILLED_ML - sum(shot.result.booked_ml for shot in run.shots[1:]), abs=1e-9)
    assert run.twin.physics.tank_ml >= left_ml


def test_a_tank_that_was_filled_while_the_program_was_stopped_counts_for_the_task_that_goes_on(tmp_path):
    async def first(_world: World, machine: Machine) -> None:
        await begin(machine)
        await until_mode(machine, Mode.PAUSED)

    async def second(world: World, machine: Machine) -> None:
        await fill(world, machine)
        await begin(machine)
        assert (await machine.status()).tank_left_ml == FILLED_ML
        await until_mode(machine, Mode.DISARMED)

    lives(tmp_path, first, **ROW, **LOW)
    run = lives(tmp_path, second, **ROW, **LOW)
    assert run.result.state is State.DONE
    assert by_fate(run)[TargetState.OPEN] == 0


@pytest.mark.parametrize("tank_ml", [0.0, -5.0, 10_000.5, math.nan, math.inf])
def test_what_no_tank_holds_is_declined_and_the_row_waits_on(tank_ml, tmp_path):
    async def orders(world: World, machine: Machine) -> None:
        await begin(machine)
        await until_mode(machine, Mode.PAUSED)
        left_ml = (await machine.status()).tank_left_ml
        with pytest.raises(Declined, match="more than 0 and at most 10000 ml"):
            await machine.refill(tank_ml, "test")
        await asyncio.sleep(2.0)
        status = await machine.status()
        assert (status.mode, status.tank_left_ml) == (Mode.PAUSED, left_ml)

    run = lives(tmp_path, orders, **ROW, **LOW)
    assert [event for event in run.events if event.kind == "refill"] == []


def test_a_refill_while_the_machine_acts_and_one_without_a_task_are_declined(tmp_path):
    async def orders(world: World, machine: Machine) -> None:
        with pytest.raises(Declined, match=r"no task is unfinished.*begins with 8000 ml"):
            await machine.refill(5000.0, "test")
        await begin(machine)
        await world.until(State.DETECT)
        with pytest.raises(Declined, match="not filled in mode auto; pause or stop first"):
            await machine.refill(5000.0, "test")
        assert (await machine.status()).tank_left_ml == 8000.0
        await machine.stop("enough")
        await machine.refill(5000.0, "test")
        assert (await machine.status()).tank_left_ml == 5000.0

    run = lives(tmp_path, orders, **ROW)
    assert [event.run_id for event in run.events if event.kind == "refill"] == [1]
