"""Faults of the actuators and of the wires to them, in whole missions of the simulated machine."""

from __future__ import annotations

import asyncio
from unittest.mock import patch

from drivers.relay.values import Channel
from drivers.twin import hydraulics
from drivers.twin.commands import ArmTorque, RelayAllOff, RelaySwitch, WheelsDrive, WheelsStop, WorldServoError
from robot.ledger.values import Outcome
from robot.mission import State
from robot.safety.catalogue import Action
from robot.targets import TargetState
from tests.robot.mission.conftest import SHORT
from tests.robot.mission.rover import Meddler, Run, World, spray_row
from tests.robot.mission.truths import last_process, openings, openings_asked_after

from .judging import is_accounted_for, judged, shut_after_s
from .values import Scenario, Scenarios, Seen, Stage
from .wires import WIRES

LONG_SHOT = {"dosing": {"law": "fixed", "coefficient": 10.0}}  # most of a second: time for something to happen


def failing(fault: str, state: State, share: float, *words: str, number: int = 0, lasts_s: float | None = None,
            kept: str = "every millilitre, the place in the row") -> Scenario:  # fmt: skip
    """``fault`` of the twin's vocabulary from that share of the way through a state on."""

    def scenario(stage: Stage) -> Seen:
        at_s = stage.moment(state, share, number)
        tail = "" if lasts_s is None else f"+{lasts_s}s"
        run = spray_row(stage.folder, faults=(f"{fault}@{at_s:.4f}s{tail}",), **SHORT)
        return judged(run, at_s, *words, kept=kept)

    return scenario


def suffering(command: object, state: State, *words: str, after_s: float = 0.3, kept: str) -> Scenario:
    """The world does something to the machine in that state."""

    def scenario(stage: Stage) -> Seen:
        moments: list[float] = []

        async def strike(world: World) -> None:
            await world.until(state)
            await asyncio.sleep(after_s)
            moments.append(world.now_s)
            world.suffer(command)  # type: ignore[arg-type]

        run = spray_row(stage.folder, meddler=strike, **SHORT)
        return judged(run, moments[0], *words, kept=kept)

    return scenario


def during_a_shot(stage: Stage, strike: Meddler, **how: object) -> tuple[Run, float]:
    """A mission whose first shot is long and struck; and when."""
    moments: list[float] = []

    async def meddle(world: World) -> None:
        await world.until_valve_opens()
        await asyncio.sleep(0.2)
        moments.append(world.now_s)
        await strike(world)

    return spray_row(stage.folder, meddler=meddle, **SHORT, **LONG_SHOT, **how), moments[0]  # type: ignore[arg-type]


def contactor_off_s(run: Run) -> float:
    """When the contactor took the power away."""
    events = last_process(run).events
    return next(event.t for event in events if event.what == "coil_off" and event.detail["channel"] == "contactor")


def is_uncertain_once(run: Run, number: int = -1) -> None:
    """The shot's target is uncertain, booked in full, and was not sprayed again."""
    shot = run.shots[number]
    assert shot.result.outcome is Outcome.UNCERTAIN
    assert shot.result.booked_ml >= shot.intent.full_ml - 1e-9
    assert {target.id: target.state for target in run.targets}[shot.intent.target_id] is TargetState.UNCERTAIN
    assert sum(other.intent.target_id == shot.intent.target_id for other in run.shots) == 1


def unplugged_in_a_shot(stage: Stage) -> Seen:
    """Nobody can shut the valve: the board's own timer does."""
    start_s, _ = openings(last_process(stage.undisturbed))[0]
    run = spray_row(stage.folder, faults=(f"relay:off@{start_s + 0.01:.4f}s",), **SHORT)
    seen = judged(run, start_s + 0.01, "relay", kept="the intent, booked as the board's full pulse")
    is_uncertain_once(run)
    assert 0.0 < run.run_on().dispensed_ml <= run.shots[-1].intent.full_ml
    return seen


def no_answer_to(stage: Stage, from_s: float, to_s: float) -> tuple[Run, Seen]:
    """The board obeys and does not answer, from and to seconds after SPRAY was entered."""
    at_s = stage.moment(State.SPRAY, 0.0)
    fault = f"relay:garbage@{at_s + from_s:.4f}s+{to_s - from_s:.4f}s"
    run = spray_row(stage.folder, faults=(fault,), **SHORT)
    is_uncertain_once(run)
    return run, judged(run, at_s + from_s, "unconfirmed")


def no_answer_to_open(stage: Stage) -> Seen:
    opened_s = openings(last_process(stage.undisturbed))[0][0] - stage.moment(State.SPRAY, 0.0)
    run, seen = no_answer_to(stage, 0.0, opened_s + 0.01)
    assert "open unconfirmed" in run.shots[-1].result.reason
    assert shut_after_s(run, openings(last_process(run))[0][0]) <= 0.4
    return seen


def no_answer_to_close(stage: Stage) -> Seen:
    """Three tries, then the next barrier: the contactor takes the valve's and the pump's power."""
    start_s, end_s = openings(last_process(stage.undisturbed))[0]
    from_s = end_s - 0.1
    run = spray_row(stage.folder, faults=(f"relay:garbage@{from_s:.4f}s",), **SHORT)
    seen = judged(run, from_s, "closing is unconfirmed", kept="that the closing is unconfirmed; booked in full")
    is_uncertain_once(run)
    assert start_s < contactor_off_s(run) <= from_s + 1.2
    return seen


def another_master(state: State, words: str) -> Scenario:
    """Somebody else on the bus switches the valve on, before the pump ever ran."""

    def scenario(stage: Stage) -> Seen:
        moments: list[float] = []

        async def switch(world: World) -> None:
            await world.until(state)
            await asyncio.sleep(0.1)
            moments.append(world.now_s)
            world.suffer(RelaySwitch(Channel.VALVE, True, world.now_s))

        run = spray_row(stage.folder, meddler=switch, **SHORT)
        return judged(run, moments[0], words, kept="the coils as read", longest_s=0.6)

    return scenario


def board_restarted(stage: Stage) -> Seen:
    """All its coils drop in the middle of a shot, and it answers on as if nothing had been."""

    async def restart(world: World) -> None:
        world.suffer(RelayAllOff(world.now_s))

    run, at_s = during_a_shot(stage, restart)
    is_uncertain_once(run)
    return judged(run, at_s, "is uncertain", kept="the target's fate: uncertain, booked in full")


def leaking(share: float) -> Scenario:
    """Its seat lets a share of the flow through. What still drips when the program has ended nobody can book."""

    def scenario(stage: Stage) -> Seen:
        at_s = stage.moment(State.AIM, 0.5, number=1)
        with patch.object(hydraulics, "LEAK_SHARE", share):
            run = spray_row(stage.folder, faults=(f"valve:wrong@{at_s:.4f}s",), **SHORT)
            assert contactor_off_s(run) - run.latched_s <= 0.2
            assert run.totals.leaked_ml > 0.0
            assert run.totals.booked_ml >= run.twin.dispensed_ml
            return judged(run, at_s, "the valve leaks", leaked_ml=150.0 * share, kept="the litres that leaked")

    return scenario


def rolling_on(share: float) -> Scenario:
    """The drive keeps its speed whatever it is told; the contactor takes its power."""

    def scenario(stage: Stage) -> Seen:
        at_s = stage.moment(State.MOVE, share)
        run = spray_row(stage.folder, faults=(f"wheels:stuck@{at_s:.4f}s",), **SHORT)
        assert contactor_off_s(run) - at_s <= 2.5
        return judged(run, at_s, "wheels", kept="the speed")

    return scenario


def rolled_in_a_shot(stage: Stage) -> Seen:
    """Somebody leans on the rover: the shot is cut, and only that."""

    async def roll(world: World) -> None:
        world.suffer(WheelsDrive(0.15, 0.0))
        await asyncio.sleep(0.45)
        world.suffer(WheelsStop())

    run, at_s = during_a_shot(stage, roll)
    first = run.shots[0]
    assert first.result.outcome is Outcome.SHORTENED
    assert "the base moved" in first.result.reason
    assert run.truth.delivered[0].ml <= first.result.booked_ml < 8.0
    is_accounted_for(run)
    assert run.result.state is State.DONE
    looked_s = min(view.t for view in last_process(run).views if view.t > at_s)
    assert [t for t in openings_asked_after(last_process(run), at_s) if t < looked_s] == []
    return Seen(Action.INHIBIT_SPRAY, shut_after_s(run, at_s), "the shortened shot, booked from the meter")


SERVO_OVERLOAD = 0x20

BUSES: Scenarios = {
    "F01": {
        "while it drives": failing("relay:off", State.MOVE, 0.5, "relay", "[F01]"),
        "while it aims": failing("relay:off", State.AIM, 0.5, "relay", "[F01]"),
        "for good, with garbled answers": failing("relay:garbage", State.AIM, 0.5, "a garbled answer"),
        "every other answer lost": failing("relay:intermittent", State.SPRAY, 0.01, "relay"),
        "plug pulled": failing("relay:unplugged", State.AIM, 0.5, "relay"),
    },
    "F02": {"": unplugged_in_a_shot},
    "F03": {"": no_answer_to_open},
    "F04": {"": no_answer_to_close},
    "F08": {
        "another master, while it drives": another_master(State.MOVE, "the valve is open"),
        "another master, while it stands": another_master(State.STOP, "though nobody opened it [F08]"),
    },
    "F09": {"": board_restarted},
    "F10": {"two per cent": leaking(0.02), "ten per cent": leaking(0.1)},
    "F11": {
        "while it aims": failing("arm:off", State.AIM, 0.5, "arm", "[F11]", kept="the last posture"),
        "while it drives": failing("arm:off", State.MOVE, 0.5, "arm", "[F11]", kept="the last posture"),
        "for a moment": failing("arm:off", State.AIM, 0.5, "arm", lasts_s=0.2, kept="the last posture"),
        "every other answer": failing("arm:intermittent", State.AIM, 0.5, "arm", kept="the last posture"),
    },
    "F12": {
        "while it aims": suffering(WorldServoError(2, SERVO_OVERLOAD), State.AIM, "0x20", kept="the error byte"),
        "while it drives": suffering(WorldServoError(2, SERVO_OVERLOAD), State.MOVE, "0x20", kept="the error byte"),
        "while it sprays": suffering(
            WorldServoError(2, SERVO_OVERLOAD), State.SPRAY, "0x20", after_s=0.02, kept="the error byte"
        ),
    },
    "F13": {
        "while it aims": suffering(ArmTorque(False), State.AIM, "torque", kept="the posture before"),
        "while it drives": suffering(ArmTorque(False), State.MOVE, "torque", kept="the posture before"),
    },
    "F14": {"": failing("arm:stuck", State.AIM, 0.6, "every joint within", kept="the joint and its distance")},
    "F20": {
        "while it drives": failing("wheels:off", State.MOVE, 0.6, "wheels", "[F20]", kept="the wheel counters"),
        "while it aims": failing("wheels:off", State.AIM, 0.5, "wheels", "[F20]", kept="the wheel counters"),
    },
    "F20b": {
        "while it aims": failing("inputs:off", State.AIM, 0.5, "inputs", kept="the last reading"),
        "while it sprays": failing("inputs:off", State.SPRAY, 0.3, "inputs", kept="the last reading"),
    },
    "F21": {"at full speed": rolling_on(0.5), "while it brakes": rolling_on(0.85)},
    "F22": {"": rolled_in_a_shot},
    **WIRES,
}

__all__ = ["BUSES", "during_a_shot", "failing", "suffering"]
