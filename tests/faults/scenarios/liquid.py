"""Faults of liquid and energy."""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import Mapping

import pytest

from drivers.relay.values import Channel
from drivers.twin.commands import RelayPulse, WorldBattery, WorldRefill
from drivers.twin.truth_record import read_truth
from robot.errors import SprayerError
from robot.ledger.values import Outcome
from robot.mission import State
from robot.safety.catalogue import Action
from robot.targets import TargetState
from tests.robot.mission.conftest import SHORT
from tests.robot.mission.rover import Run, World, spray_row

from .judging import judged
from .values import Scenario, Scenarios, Seen, Stage

GUARDED = {"battery_low_v": 22.8, "battery_stop_v": 21.6}
SOON = {"longest_pause_s": 5.0}  # then nobody is waited for any longer


def tank_at_its_reserve(stage: Stage) -> Seen:
    """The first shot takes the balance below what the next may need."""
    run = spray_row(stage.folder, task={"tank_fill_ml": 215.0}, safety=SOON, **SHORT)
    assert len(run.shots) == 1
    assert run.twin.physics.tank_ml >= run.config.fluid.tank_reserve_ml
    assert any(target.state is TargetState.OPEN for target in run.targets)
    return judged(run, run.shots[0].result.stamp_s, "the tank holds", "[F65]", kept="the targets that are not done")


def is_left_uncertain(run: Run) -> Seen:
    """The last shot did not give what it should: booked in full, its target uncertain, the machine stopped."""
    shot = run.shots[-1]
    assert shot.result.outcome is Outcome.UNCERTAIN
    assert shot.result.booked_ml >= shot.intent.full_ml - 1e-9
    assert {target.id: target.state for target in run.targets}[shot.intent.target_id] is TargetState.UNCERTAIN
    return judged(run, shot.intent.stamp_s, "flow meter saw", kept="the target's fate: uncertain, booked in full")


def clogged(fault: str, state: State, share: float) -> Scenario:
    def scenario(stage: Stage) -> Seen:
        return is_left_uncertain(
            spray_row(stage.folder, faults=(f"{fault}@{stage.moment(state, share):.4f}s",), **SHORT)
        )

    return scenario


def emptied(stage: Stage) -> Seen:
    """The tank is empty though the ledger's balance says otherwise: air comes."""

    async def empty(world: World) -> None:
        await world.until(State.AIM)
        world.suffer(WorldRefill(0.0))

    return is_left_uncertain(spray_row(stage.folder, meddler=empty, **SHORT))


def pump_dead(stage: Stage) -> Seen:
    """Its relay clicks and it does not run."""
    asked_s: list[float] = []

    async def cut(world: World) -> None:
        apply = world.twin.apply

        def without_pump(now_s, command):  # type: ignore[no-untyped-def]
            if isinstance(command, RelayPulse) and command.channel is Channel.PUMP:
                asked_s.append(now_s)
                return
            apply(now_s, command)

        world.twin.apply = without_pump  # type: ignore[method-assign]

    run = spray_row(stage.folder, meddler=cut, **SHORT)
    assert run.shots == ()
    assert run.twin.dispensed_ml == 0.0
    return judged(run, asked_s[0], "pump: expected", "bar", kept="the pressure")


def other_product(changed: Mapping[str, object]) -> Scenario:
    """Another product in the tank is another task: the row is not gone on with."""

    def scenario(stage: Stage) -> Seen:
        async def stop(world: World) -> None:
            await world.until(State.STOP)
            signal.raise_signal(signal.SIGTERM)

        spray_row(stage.folder, meddler=stop, **SHORT)
        asked = len(read_truth(stage.folder / "truth.jsonl").processes[-1].commands)
        began_s = time.process_time()
        with pytest.raises(SprayerError) as caught:
            spray_row(stage.folder, resume=True, task=changed, **SHORT)
        after_s = time.process_time() - began_s
        assert "task" in str(caught.value)
        processes = read_truth(stage.folder / "truth.jsonl").processes
        assert len(processes[0].commands) == asked
        assert all(list(process.commands) == [] for process in processes[1:])
        return Seen(Action.SAFE_STOP, after_s, "the task as it was begun")

    return scenario


def battery(voltage_v: float, words: str, least: Action) -> Scenario:
    def scenario(stage: Stage) -> Seen:
        moments: list[float] = []

        async def sag(world: World) -> None:
            await world.until(State.AIM)
            await asyncio.sleep(0.3)
            moments.append(world.now_s)
            world.suffer(WorldBattery(voltage_v))

        run = spray_row(stage.folder, meddler=sag, safety=GUARDED | SOON, **SHORT)
        return judged(run, moments[0], "the battery is at", words, kept="the voltage", least=least)

    return scenario


LIQUID: Scenarios = {
    "F65": {"": tank_at_its_reserve},
    "F66": {
        "valve does not open": clogged("valve:off", State.AIM, 0.5),
        "flow meter stuck": clogged("inputs:stuck", State.SPRAY, 0.01),
        "tank empty, balance wrong": emptied,
    },
    "F67": {"": pump_dead},
    "F68": {"another product": other_product({"product": "Another"})},
    "F69": {"": battery(22.0, "[F69]", Action.PAUSE)},
    "F69b": {"": battery(21.0, "[F69b]", Action.SAFE_STOP)},
}

