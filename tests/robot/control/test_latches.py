"""Latches and their causes outlive the program; an order, or a person's command, ends them."""

import asyncio

import pytest

from drivers.twin.commands import WorldBumper, WorldEstop
from robot.control import Declined, Machine
from robot.mission import State
from robot.safety import Mode
from tests.robot.control.test_orders import TINY, begin, lives, until_mode
from tests.robot.mission.rover import World, spray_row
from tests.robot.mission.truths import last_process, motions_asked_after

BEFORE = "before the restart: "
LONGER = {"stops_m": (0.25, 0.65), "length_m": 0.9, "twin": {"fruits_per_plant": 2.5}}


async def bumped(world: World, machine: Machine) -> None:
    await begin(machine)
    await world.until(State.AIM)
    world.suffer(WorldBumper(True))
    await until_mode(machine, Mode.SAFE_STOP)
    world.suffer(WorldBumper(False))
    await asyncio.sleep(1.0)


def test_a_stop_by_the_bumper_outlives_two_restarts_until_somebody_acknowledges_and_the_row_goes_on(tmp_path):
    async def looks(_world: World, machine: Machine) -> None:
        status = await machine.status()
        assert (status.mode, status.causes) == (Mode.SAFE_STOP, (f"{BEFORE}the bumper was pressed [F59]",))

    async def goes_on(world: World, machine: Machine) -> None:
        await looks(world, machine)
        with pytest.raises(Declined, match=r"arm is not possible.*before the restart: the bumper was pressed"):
            await machine.arm("test")
        await machine.acknowledge("test")
        assert (await machine.status()).mode is Mode.DISARMED
        await begin(machine)
        await until_mode(machine, Mode.DISARMED)

    lives(tmp_path, bumped, **LONGER)
    idle = lives(tmp_path, looks, **LONGER)
    assert idle.result.mode is Mode.SAFE_STOP
    assert motions_asked_after(last_process(idle), 0.0) == []
    run = lives(tmp_path, goes_on, **LONGER)
    assert (run.result.state, run.result.task_id) == (State.DONE, 1)
    targets = [shot.intent.target_id for shot in run.shots]
    assert len(set(targets)) == len(targets) > 0

    async def disarmed(_world: World, machine: Machine) -> None:
        assert (await machine.status()).mode is Mode.DISARMED

    lives(tmp_path, disarmed, **LONGER)


def test_a_program_that_was_told_to_end_comes_up_disarmed(tmp_path):
    async def first(world: World, machine: Machine) -> None:
        await begin(machine)
        await world.until_valve_opens()
        await asyncio.sleep(0.05)

    async def second(_world: World, machine: Machine) -> None:
        status = await machine.status()
        assert (status.mode, status.causes) == (Mode.DISARMED, ())
        await machine.arm("test")

    before = lives(tmp_path, first, **LONGER)
    assert before.result.causes == ("stopped by SIGTERM",)
    lives(tmp_path, second, **LONGER)


def test_an_e_stop_outlives_a_restart_and_its_reset_needs_the_button_released_as_ever(tmp_path):
    async def pressed(world: World, machine: Machine) -> None:
        world.suffer(WorldEstop(True))
        await until_mode(machine, Mode.ESTOP)

    async def still_pressed(world: World, machine: Machine) -> None:
        world.suffer(WorldEstop(True))
        await asyncio.sleep(1.0)
        status = await machine.status()
        assert status.mode is Mode.ESTOP
        assert status.causes == (f"{BEFORE}the e-stop was pressed [F70l]", "the e-stop was pressed [F70l]")
        with pytest.raises(Declined, match="acknowledge is not possible in mode estop"):
            await machine.acknowledge("test")
        with pytest.raises(Declined, match="still pressed"):
            await machine.reset("test")

    async def released(world: World, machine: Machine) -> None:
        world.suffer(WorldEstop(False))
        await asyncio.sleep(1.0)
        assert (await machine.status()).mode is Mode.ESTOP
        with pytest.raises(Declined, match="arm is not possible in mode estop"):
            await machine.arm("test")
        await machine.reset("test")
        await machine.arm("test")

    lives(tmp_path, pressed, **TINY)
    lives(tmp_path, still_pressed, **TINY)
    lives(tmp_path, released, **TINY)


def test_a_start_at_the_command_line_acknowledges_it_says_so_and_the_next_life_knows(tmp_path):
    lives(tmp_path, bumped, **LONGER)
    run = spray_row(tmp_path, resume=True, **LONGER)
    assert run.result.state is State.DONE
    assert "this command acknowledges the safe_stop before the restart: the bumper was pressed [F59]" in run.said
    assert Mode.SAFE_STOP not in [changed.mode for changed in run.modes]
    modes = [event.text for event in run.events if event.kind == "mode" and event.run_id == 2]
    assert modes[0].startswith("disarmed this command acknowledges the safe_stop")


def test_a_start_at_the_command_line_does_not_talk_past_a_button_that_is_still_pressed(tmp_path):
    async def pressed(world: World, machine: Machine) -> None:
        world.suffer(WorldEstop(True))
        await until_mode(machine, Mode.ESTOP)

    async def press(world: World) -> None:
        world.suffer(WorldEstop(True))

    lives(tmp_path, pressed, **TINY)
    with pytest.raises(ExceptionGroup) as caught:
        spray_row(tmp_path, meddler=press, **TINY)
    assert caught.group_contains(Exception, match="cannot arm: .*the e-stop was pressed")
