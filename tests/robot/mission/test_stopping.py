"""Stopped at any moment of any state: nothing opens, nothing moves on, nothing stays unbooked."""

import asyncio
import random
import signal

import pytest

from drivers.relay.values import Channel
from drivers.twin.commands import WorldBumper, WorldEstop
from robot.ledger.values import Outcome
from robot.mission import State
from robot.safety import Mode

from .conftest import SHORT
from .rover import Run, World, spray_row
from .truths import last_process, motions, motions_asked_after, openings, openings_asked_after

VALVE_SHUT_S = 0.06  # the frame on the wire and the valve's own latency, with its deviation
BASE_HALTED_S = 0.5  # 0.25 m/s at twice 0.4 m/s2
BRAKING_RAD = 0.35    # a joint at 1.5 rad/s, at 4 rad/s2 and with the servo's lag
HEARD_S = 0.1        # from the signal to the latch: the next timer of the loop
WORKING = (State.MOVE, State.STOP, State.DETECT, State.AIM, State.SPRAY)
MOMENTS_A_STATE = 6


def moment_in(undisturbed: Run, state: State, number: int) -> float:
    """A random time in the state; half of those in SPRAY within the first 50 ms, when intent and opening are due."""
    dice = random.Random(f"{state} {number}")
    start, end = dice.choice(undisturbed.spans(state))
    if state is State.SPRAY and number % 2:
        end = start + 0.05
    return dice.uniform(start, end)


@pytest.mark.parametrize("number", range(MOMENTS_A_STATE))
@pytest.mark.parametrize("state", WORKING)
def test_a_stop_at_any_moment_shuts_halts_holds_latches_and_books(state, number, undisturbed, tmp_path):
    at_s = moment_in(undisturbed, state, number)

    async def stop(world: World) -> None:
        await asyncio.sleep(at_s)
        signal.raise_signal(signal.SIGTERM)

    run = spray_row(tmp_path, meddler=stop, **SHORT)
    assert run.states[-2].state is state
    assert run.states[-1].state is State.IDLE
    assert run.result.mode is Mode.SAFE_STOP
    assert run.result.causes == ("stopped by SIGTERM",)
    assert run.troubles == []
    assert 0.0 <= run.latched_s - at_s <= HEARD_S
    everything_ceased(run)


def everything_ceased(run: Run) -> None:
    """In the twin's truth, from the moment the stop was latched, and in the ledger."""
    process, at_s = last_process(run), run.latched_s
    assert openings_asked_after(process, at_s) == []
    assert motions_asked_after(process, at_s) == []
    assert all(end <= at_s + VALVE_SHUT_S for _, end in openings(process))
    held = run.twin.joints_rad
    after = run.run_on()
    assert after.joints_rad == pytest.approx(held, abs=BRAKING_RAD)
    assert after.physics.resting
    assert not any(after.coils(after.now_s).values())
    assert all(end <= at_s + BASE_HALTED_S for _, end in motions(process, "base") if end < float("inf"))
    assert run.dangling == 0
    assert run.totals.booked_ml >= after.dispensed_ml
    assert all(shot.result is not None for shot in run.shots)


def test_a_shot_that_a_stop_cut_short_is_booked_shorter_and_its_target_is_not_forgotten(undisturbed, tmp_path):
    async def stop(world: World) -> None:
        await world.until_valve_opens()
        await asyncio.sleep(0.05)
        signal.raise_signal(signal.SIGTERM)

    run = spray_row(tmp_path, meddler=stop, **SHORT)
    assert [shot.result.outcome for shot in run.shots] == [Outcome.SHORTENED]
    whole_ml = undisturbed.truth.delivered[0].ml
    assert run.twin.dispensed_ml < 0.8 * whole_ml
    assert run.totals.booked_ml < whole_ml
    fate = {target.id: target.state.value for target in run.targets}
    assert fate[run.shots[0].intent.target_id] == "uncertain"


@pytest.mark.parametrize("state", [State.MOVE, State.AIM, State.SPRAY])
def test_the_e_stop_latches_and_everything_ceases_in(state, tmp_path):
    pressed_s: list[float] = []

    async def press(world: World) -> None:
        await world.until(state)
        if state is State.SPRAY:
            await world.until_valve_opens()
        await asyncio.sleep(0.08 if state is State.SPRAY else 0.5)
        pressed_s.append(world.now_s)
        world.suffer(WorldEstop(True))

    run = spray_row(tmp_path, meddler=press, **SHORT)
    assert run.states[-2].state is state
    assert run.result.mode is Mode.ESTOP
    assert run.result.causes[0] == "the e-stop was pressed [F70l]"
    assert run.latched_s - pressed_s[0] <= 0.15  # the inputs are read ten times a second
    everything_ceased(run)
    process = last_process(run)
    if state is State.SPRAY:
        assert openings(process)[-1][1] <= pressed_s[0] + VALVE_SHUT_S  # the button cuts the power, asks nobody


def test_the_bumper_stops_the_rover_within_ten_centimetres(tmp_path):
    hit_x_m: list[float] = []

    async def bump(world: World) -> None:
        await world.until(State.MOVE, 2)
        await asyncio.sleep(0.9)
        hit_x_m.append(world.twin.base_pose[0])
        world.suffer(WorldBumper(True))

    run = spray_row(tmp_path, meddler=bump, **SHORT)
    assert run.result.mode is Mode.SAFE_STOP
    assert "the bumper was pressed" in run.result.causes[0]
    assert 0.0 < run.twin.base_pose[0] - hit_x_m[0] <= 0.10
    everything_ceased(run)


def test_a_stop_before_the_first_state_never_lets_the_mission_begin(tmp_path):
    async def stop(world: World) -> None:
        await world.until_on(Channel.BEACON)
        signal.raise_signal(signal.SIGTERM)

    run = spray_row(tmp_path, meddler=stop, **SHORT)
    assert run.result.state is State.IDLE
    assert run.result.mode is Mode.SAFE_STOP
    assert last_process(run).views == ()
    assert run.run_on().base_pose == (0.0, 0.0, 0.0)
    assert run.twin.dispensed_ml == 0.0
