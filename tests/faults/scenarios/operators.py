"""Faults of communication, and what operators and strangers do."""

from __future__ import annotations

import asyncio
from unittest.mock import patch

import pytest

from drivers.modem.emulated_sim import RECEIVED_READ, StoredPdu
from drivers.modem.pdu import Deliver
from drivers.modem.user_data import Alphabet, Part
from drivers.twin.commands import WheelsDrive, WheelsStop, WorldEstop, WorldNetwork
from robot import safety
from robot.actuation import Actuation, Refused
from robot.clock import run_virtual
from robot.commands.run import single_error
from robot.ledger import LedgerReader
from robot.mission import State
from robot.runtime import ledger_path
from robot.runtime.manual.base import step
from robot.safety.catalogue import Action
from robot.safety.timing import LEASE_BEAT_S
from tests.drivers.modem.rigs import WORKER, Rig
from tests.drivers.modem.rigs import run as on_modem
from tests.drivers.modem.test_gsm import SENT, sim_with, stored
from tests.robot.machine import machine
from tests.robot.manual.hand_session import by_hand
from tests.robot.mission.conftest import SHORT
from tests.robot.mission.rover import World, spray_row
from tests.robot.mission.truths import last_process

from .buses import failing, suffering
from .judging import judged
from .values import Scenarios, Seen, Stage


def broken_texts(_stage: Stage) -> Seen:
    """A PDU that ends too soon, one of data, one of eleven parts: kept raw with the reason, and STOP comes through."""
    seen: list[Seen] = []

    async def test(bench: Rig) -> None:
        began_s = bench.clock()
        assert [sms.text for sms in await bench.device.receive()] == ["STOP"]
        rejected = bench.device.rejected()
        seen.append(Seen(Action.WARN, bench.clock() - began_s, "the raw messages"))
        assert {text.code for text in rejected} == {"undecodable", "data", "oversize"}
        assert all(text.pdu and text.reason for text in rejected)

    oversize = [stored(Deliver(WORKER, "x" * 153, SENT, Alphabet.GSM7, Part(9, 11, n))) for n in range(1, 12)]
    on_modem(
        test,
        sim=sim_with(
            StoredPdu(RECEIVED_READ, "0004FF9171", 5), stored(Deliver(WORKER, "\x01\x02", SENT, Alphabet.DATA)),
            *oversize, stored(Deliver(WORKER, "STOP", SENT)),
        ),
    )  # fmt: skip
    return seen[0]


def without_network(stage: Stage) -> Seen:
    moments: list[float] = []

    async def lose(world: World) -> None:
        await world.until(State.AIM)
        moments.append(world.now_s)
        world.suffer(WorldNetwork(False))

    run = spray_row(stage.folder, meddler=lose, **SHORT)
    assert len(run.shots) == len(stage.undisturbed.shots)
    return judged(run, moments[0], "modem: found without a network", "[F70a]", kept="the mission goes on")


def heartbeat_lost(stage: Stage) -> Seen:
    """The operator's terminal hangs while the base drives: it stands, and the lease is kept for a while."""
    beats_s: list[float] = []
    reasons: list[str] = []

    async def beat_for_a_while(actuation: Actuation) -> None:
        lease = actuation.state.lease
        assert lease is not None
        for _ in range(25):
            actuation.beat_lease(lease.holder)
            beats_s.append(asyncio.get_running_loop().time())
            await asyncio.sleep(LEASE_BEAT_S)

    async def drive(hands, _twin):  # type: ignore[no-untyped-def]
        with pytest.raises(Refused, match="no sign of life") as caught:
            await step(hands, 0.5, 0.1)
        reasons.append(str(caught.value))
        assert hands.actuation.state.lease is not None
        await asyncio.sleep(1.0)
        with pytest.raises(Refused):
            await hands.actuation.drive(0.1, 0.0)

    with patch("robot.runtime.manual.session._keep_lease", beat_for_a_while):
        session = by_hand(stage.folder, drive)
    assert reasons
    moved = [t for t in session.process.commands if isinstance(t.command, WheelsDrive) and t.command.speed_m_s]
    stopped_s = min(t.t for t in session.process.commands if isinstance(t.command, WheelsStop) and t.t > beats_s[-1])
    assert all(timed.t <= stopped_s for timed in moved)
    assert session.after.base_pose[0] < 0.35
    return Seen(Action.PAUSE, stopped_s - beats_s[-1], "the lease, for five seconds more")


def double_press(stage: Stage) -> Seen:
    """The same shot asked for twice, 20 ms apart: one is given."""

    async def main() -> Seen:
        async with machine(stage.folder) as m:
            await m.ready_to_spray()
            first = asyncio.create_task(m.spray(0.32))
            await asyncio.sleep(0.02)
            loop = asyncio.get_running_loop()
            at_s = loop.time()
            with pytest.raises(Refused, match="a shot is under way") as caught:
                await m.spray(0.32)
            after_s = loop.time() - at_s
            result = await first
            assert m.results() == [result]
            assert 0.8 * 4.0 < m.twin.dispensed_ml <= result.booked_ml
            return Seen(Action.WARN, after_s, f"both requests: one row, one refusal ({caught.value})")

    return run_virtual(main())


def two_operators(stage: Stage) -> Seen:
    async def main() -> Seen:
        async with machine(stage.folder, start=False) as m:
            assert (await m.actuation.take_lease("Ada")).allowed
            at_s = asyncio.get_running_loop().time()
            second = await m.actuation.take_lease("Bob")
            after_s = asyncio.get_running_loop().time() - at_s
            assert "'Ada' holds the controls" in second.reasons[0]
            assert not m.actuation.beat_lease("Bob").allowed
            assert m.actuation.state.lease is not None
            assert m.actuation.state.lease.holder == "Ada"
            return Seen(Action.WARN, after_s, f"who held it, and who asked: {second.reasons[0]}")

    return run_virtual(main())


def pressed_before_the_start(stage: Stage) -> Seen:
    """Pressed, or its wire broken, when the program comes up: it is not armed."""

    async def press(world: World) -> None:
        world.suffer(WorldEstop(True))

    with pytest.raises(ExceptionGroup) as caught:
        spray_row(stage.folder, meddler=press, **SHORT)
    assert "the e-stop" in str(single_error(caught.value))
    with LedgerReader.open_read_only(ledger_path(stage.folder / "run")) as ledger:
        stopped = [event for event in ledger.events() if event.kind == "mode"]
    assert stopped[0].text.startswith("estop")
    return Seen(Action.ESTOP, stopped[0].stamp_s, "the moment; nothing was armed")


def released_while_start_is_held(stage: Stage) -> Seen:
    """START again and again, through press, release and reset: nothing moves until somebody arms anew."""

    async def main() -> Seen:
        async with machine(stage.folder) as m:
            loop = asyncio.get_running_loop()

            async def hold_start(until_s: float) -> None:
                while loop.time() < until_s:
                    m.actuation.change_mode(safety.Verb.START, "held")
                    await asyncio.sleep(0.02)

            at_s = loop.time()
            m.twin.apply(at_s, WorldEstop(True))
            while m.actuation.state.mode is not safety.Mode.ESTOP:
                assert loop.time() - at_s < 1.0
                await asyncio.sleep(0.005)
            after_s = loop.time() - at_s
            await hold_start(loop.time() + 0.5)
            assert m.actuation.state.mode is safety.Mode.ESTOP
            assert not m.actuation.change_mode(safety.Verb.RESET, "too early").allowed
            m.twin.apply(loop.time(), WorldEstop(False))
            await hold_start(loop.time() + 0.5)
            assert m.actuation.state.mode is safety.Mode.ESTOP
            coils = m.twin.coils(loop.time())
            assert m.actuation.change_mode(safety.Verb.RESET, "reset").allowed
            await hold_start(loop.time() + 0.5)
            assert m.actuation.state.mode is safety.Mode.DISARMED
            assert m.twin.coils(loop.time()) == coils
            assert m.twin.base_pose == (0.0, 0.0, 0.0)
            assert m.twin.dispensed_ml == 0.0
            return Seen(Action.ESTOP, after_s, "nothing starts")

    return run_virtual(main())


def estop_in_a_shot(stage: Stage) -> Seen:
    moments: list[float] = []

    async def press(world: World) -> None:
        await world.until_valve_opens()
        moments.append(world.now_s)
        world.suffer(WorldEstop(True))

    run = spray_row(stage.folder, meddler=press, **SHORT)
    assert [event for event in last_process(run).events if event.what == "valve_closed"]
    return judged(run, moments[0], "the e-stop was pressed", "[F70l]", kept="the moment; the shot, booked")


OPERATORS: Scenarios = {
    "F70a": {"silent": failing("modem:off", State.AIM, 0.5, "modem", kept="the mission goes on"),
              "no network": without_network},
    "F70c": {"": broken_texts},
    "F70i": {"": heartbeat_lost},
    "F70j": {"": double_press},
    "F70k": {"": two_operators},
    "F70l": {
        "while it drives": suffering(WorldEstop(True), State.MOVE, "the e-stop was pressed", after_s=0.5,
                                     kept="the moment"),
        "while it aims": suffering(WorldEstop(True), State.AIM, "the e-stop was pressed", after_s=0.5,
                                   kept="the moment"),
        "in a shot": estop_in_a_shot,
        "before the start": pressed_before_the_start,
    },
    "F70m": {"": released_while_start_is_held},
}  # fmt: skip
