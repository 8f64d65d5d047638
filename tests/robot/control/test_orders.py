"""Orders to a living robot, in virtual time: what they do to the simulated machine and to the ledger."""

import asyncio
import signal

import pytest

from drivers.relay.values import Channel
from drivers.twin.commands import WorldEstop
from robot.control import Declined, Machine, TaskChoice
from robot.ledger.values import Outcome
from robot.mission import State
from robot.safety import Mode
from robot.targets import TargetState
from tests.robot.mission.rover import Run, World, spray_row
from tests.robot.mission.truths import last_process, motions_asked_after, openings, sightings

SHORT = {"stops_m": (0.25, 0.65), "length_m": 0.9, "twin": {"fruits_per_plant": 2.5}}
TINY = {"stops_m": (0.25,), "length_m": 0.5, "twin": {"fruits_per_plant": 2.5}}
VALVE_SHUT_S = 0.06
ENERGISED = (Channel.CONTACTOR, Channel.BEACON, Channel.PUMP, Channel.VALVE)


async def begin(machine: Machine, choice: TaskChoice = TaskChoice.AUTO) -> int:
    await machine.arm("test")
    return await machine.start(await machine.plan(choice), "test")


async def until_mode(machine: Machine, mode: Mode) -> None:
    while True:
        if (await machine.status()).mode is mode:
            return
        await asyncio.sleep(0.1)


def go_down() -> None:
    signal.raise_signal(signal.SIGTERM)


def energised(world: World) -> list[Channel]:
    coils = world.twin.coils(world.now_s)
    return [channel for channel in ENERGISED if coils[channel]]


def lives(folder, orders, **more) -> Run:
    """A robot that waits for orders; whatever they come to, a signal ends it, and what went wrong in them is raised."""

    async def meddle(world: World) -> None:
        try:
            await orders(world, await world.machine())
        finally:
            go_down()

    return spray_row(folder, meddler=meddle, start=False, **more)


def test_a_start_by_order_sprays_the_row_and_leaves_it_disarmed_with_every_output_off(tmp_path):
    counted: list[int] = []

    async def orders(world: World, machine: Machine) -> None:
        assert await begin(machine) == 1
        assert (await machine.status()).mode is Mode.AUTO
        await until_mode(machine, Mode.DISARMED)
        status = await machine.status()
        assert status.mission.state is State.DONE
        assert status.ledger is not None
        counted.append(status.ledger.shots)
        assert energised(world) == []
        await machine.arm("test")
        assert (await machine.plan(TaskChoice.AUTO)).task is None
        with pytest.raises(Declined, match="no unfinished task"):
            await machine.plan(TaskChoice.RESUME)

    run = lives(tmp_path, orders, **TINY)
    assert run.result.state is State.DONE
    assert run.result.task_id == 1
    assert counted == [len(openings(last_process(run)))]
    assert counted[0] >= 1
    assert run.twin.dispensed_ml <= run.totals.booked_ml


@pytest.fixture(scope="module")
def stopped_in_a_shot(tmp_path_factory) -> tuple[Run, float]:
    """STOP 50 ms after the valve opened, acknowledged, armed, started again, to the end of the row."""
    stopped_s: list[float] = []

    async def orders(world: World, machine: Machine) -> None:
        await begin(machine)
        await world.until_valve_opens()
        await asyncio.sleep(0.05)
        stopped_s.append(world.now_s)
        parts = await machine.stop("enough")
        assert [(part.part, part.error) for part in parts] == [
            (name, "") for name in ("valve", "base", "arm", "pump")
        ]
        await asyncio.sleep(10.0)
        with pytest.raises(Declined, match="arm is not possible in mode safe_stop"):
            await machine.arm("test")
        await machine.acknowledge("test")
        assert (await machine.status()).mode is Mode.DISARMED
        assert energised(world) == []
        with pytest.raises(Declined, match="start is not possible in mode disarmed"):
            await machine.plan(TaskChoice.AUTO)
        await machine.arm("test")
        plan = await machine.plan(TaskChoice.AUTO)
        assert plan.task == 1
        assert plan.label_left_ml < 2000.0
        await machine.start(plan, "test")
        await until_mode(machine, Mode.DISARMED)

    return lives(tmp_path_factory.mktemp("stopped"), orders, **SHORT), stopped_s[0]


def test_a_stop_in_a_shot_shuts_the_valve_in_truth_and_nothing_opens_until_the_next_start(stopped_in_a_shot):
    run, stopped_s = stopped_in_a_shot
    opened = openings(last_process(run))
    assert opened[0][1] <= stopped_s + VALVE_SHUT_S
    assert all(begin_s > stopped_s + 10.0 for begin_s, _ in opened[1:])
    assert [at_s for at_s in motions_asked_after(last_process(run), stopped_s) if at_s < stopped_s + 10.0] == []


def test_after_a_stop_the_row_goes_on_in_the_same_task_and_what_may_be_sprayed_is_left_alone(stopped_in_a_shot):
    run, _ = stopped_in_a_shot
    assert run.result.state is State.DONE
    assert run.result.task_id == 1
    assert run.shots[0].result.outcome is Outcome.SHORTENED
    first = run.shots[0].intent.target_id
    assert [shot.intent.target_id for shot in run.shots].count(first) == 1
    fate = {target.id: target.state for target in run.targets}
    assert fate[first] is TargetState.UNCERTAIN
    fruit_of = {target: fruit for fruit, target in sightings(run)}
    sprayed = [fruit_of[shot.intent.target_id] for shot in run.shots]
    assert len(set(sprayed)) == len(sprayed)
    assert len(sprayed) > 2
    assert run.twin.dispensed_ml <= run.totals.booked_ml


def test_a_shot_that_a_pause_cut_is_not_made_again_when_the_row_goes_on(tmp_path):
    moments: list[float] = []

    async def orders(world: World, machine: Machine) -> None:
        await begin(machine)
        await world.until_valve_opens()
        await asyncio.sleep(0.05)
        moments.append(world.now_s)
        await machine.pause("test")
        await asyncio.sleep(20.0)
        assert (await machine.status()).mode is Mode.PAUSED
        moments.append(world.now_s)
        await machine.resume("test")
        await until_mode(machine, Mode.DISARMED)

    run = lives(tmp_path, orders, **TINY)
    assert run.result.state is State.DONE
    opened = openings(last_process(run))
    assert opened[0][1] <= moments[0] + VALVE_SHUT_S
    assert all(begin_s > moments[1] for begin_s, _ in opened[1:])
    numbers = [shot.intent.target_id for shot in run.shots]
    assert numbers.count(numbers[0]) == 1
    assert len(numbers) > 1


def test_a_resume_in_the_very_moment_of_the_pause_goes_on_too(tmp_path):
    async def orders(world: World, machine: Machine) -> None:
        await begin(machine)
        await world.until_valve_opens()
        pausing = asyncio.create_task(machine.pause("test"))
        await asyncio.sleep(0.0)
        await machine.resume("test")
        await pausing
        await until_mode(machine, Mode.DISARMED)

    run = lives(tmp_path, orders, **TINY)
    assert run.result.state is State.DONE
    numbers = [shot.intent.target_id for shot in run.shots]
    assert numbers.count(numbers[0]) == 1


def test_disarm_ends_the_mission_halts_the_base_and_puts_every_output_off(tmp_path):
    halted_m: list[float] = []

    async def orders(world: World, machine: Machine) -> None:
        await begin(machine)
        await world.until(State.MOVE)
        await asyncio.sleep(1.0)
        await machine.disarm("test")
        status = await machine.status()
        assert (status.mode, status.mission.state) == (Mode.DISARMED, State.IDLE)
        assert energised(world) == []
        await asyncio.sleep(1.0)
        world.twin.advance(world.now_s)
        halted_m.append(world.twin.base_pose[0])
        await asyncio.sleep(5.0)

    run = lives(tmp_path, orders, **TINY)
    assert run.twin.base_pose[0] == pytest.approx(halted_m[0], abs=1e-6)
    assert run.twin.dispensed_ml == 0.0


def test_arming_with_the_e_stop_pressed_is_declined_with_the_reason_and_nothing_stays_on(tmp_path):
    async def orders(world: World, machine: Machine) -> None:
        world.suffer(WorldEstop(True))
        await until_mode(machine, Mode.ESTOP)
        with pytest.raises(Declined, match="arm is not possible in mode estop") as declined:
            await machine.arm("test")
        assert any("e-stop" in reason for reason in declined.value.reasons)
        with pytest.raises(Declined, match="still pressed"):
            await machine.reset("test")
        world.suffer(WorldEstop(False))
        await asyncio.sleep(0.5)
        await machine.reset("test")
        assert (await machine.status()).mode is Mode.DISARMED
        assert energised(world) == []

    run = lives(tmp_path, orders, **TINY)
    assert run.result.mode is Mode.DISARMED


def test_a_plan_is_void_when_the_machine_was_stopped_in_between(tmp_path):
    async def orders(world: World, machine: Machine) -> None:
        await machine.arm("test")
        plan = await machine.plan(TaskChoice.AUTO)
        await machine.stop("test")
        await machine.acknowledge("test")
        await machine.arm("test")
        with pytest.raises(Declined, match="mode changes was 1 and is 4 now"):
            await machine.start(plan, "test")
        assert (await machine.status()).mode is Mode.READY

    run = lives(tmp_path, orders, **TINY)
    assert motions_asked_after(last_process(run), 0.0) == []


def test_a_second_start_of_the_same_plan_is_declined(tmp_path):
    async def orders(world: World, machine: Machine) -> None:
        await machine.arm("test")
        plan = await machine.plan(TaskChoice.AUTO)
        await machine.start(plan, "test")
        stopping = asyncio.create_task(machine.stop("test"))
        await stopping
        with pytest.raises(Declined, match="start is not possible in mode safe_stop"):
            await machine.start(plan, "test")

    lives(tmp_path, orders, **TINY)


def test_the_next_life_goes_on_with_the_unfinished_task_of_the_last_one(tmp_path):
    async def first(world: World, machine: Machine) -> None:
        await begin(machine)
        await world.until(State.MOVE, 2)
        await asyncio.sleep(0.5)

    async def second(world: World, machine: Machine) -> None:
        await machine.arm("test")
        plan = await machine.plan(TaskChoice.AUTO)
        assert (plan.task, plan.stop) == (1, 2)
        await machine.start(plan, "test")
        await until_mode(machine, Mode.DISARMED)

    before = lives(tmp_path, first, **SHORT)
    assert before.result.mode is Mode.SAFE_STOP
    run = lives(tmp_path, second, **SHORT)
    assert run.result.state is State.DONE
    assert run.result.task_id == 1
    earlier = {shot.intent.target_id for shot in before.shots}
    later = {shot.intent.target_id for shot in run.shots[len(before.shots) :]}
    assert earlier
    assert later
    assert earlier & later == set()


def test_an_unfinished_task_of_another_configuration_must_be_given_up_in_so_many_words(tmp_path):
    async def first(world: World, machine: Machine) -> None:
        await begin(machine)
        await world.until(State.STOP)

    async def second(world: World, machine: Machine) -> None:
        await machine.arm("test")
        with pytest.raises(Declined, match="was begun with another configuration"):
            await machine.plan(TaskChoice.AUTO)
        assert (await machine.plan(TaskChoice.NEW)).task is None

    lives(tmp_path, first, **TINY)
    lives(tmp_path, second, dosing={"max_ml": 7.0}, **TINY)


def test_a_stop_while_it_is_being_armed_wins(tmp_path):
    async def orders(world: World, machine: Machine) -> None:
        arming = asyncio.create_task(machine.arm("test"))
        await world.until_on(Channel.CONTACTOR)
        await machine.stop("test")
        with pytest.raises(Declined):
            await arming
        assert (await machine.status()).mode is Mode.SAFE_STOP
        assert energised(world) == []

    lives(tmp_path, orders, **TINY)


def test_two_hundred_stops_are_one_stop(tmp_path):
    async def orders(world: World, machine: Machine) -> None:
        for _ in range(200):
            await machine.stop("again")
        status = await machine.status()
        assert (status.mode, status.causes) == (Mode.SAFE_STOP, ("again",))

    lives(tmp_path, orders, **TINY)
