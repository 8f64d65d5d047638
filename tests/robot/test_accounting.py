"""Every millilitre once: leaks, worn nozzles, disks that fail, uncertain targets; the twin's truth and the ledger."""

import asyncio
from contextlib import suppress
from dataclasses import replace

import pytest

from drivers.errors import DeviceTimeout
from drivers.relay.values import Channel
from drivers.twin import hydraulics
from robot import safety
from robot.actuation import Refused, values
from robot.actuation.booking import FlowAccount, missed
from robot.clock import run_virtual
from robot.errors import FileError, SprayerError
from robot.ledger import Ledger, LedgerRuleError, MeterMark, Outcome
from robot.safety.timing import RELAY_STALE_S
from robot.targets import TargetState

from .ledger.disk import FailingConnection, failing
from .machine import START, a_target, machine

DETECTED_S = 0.5  # F10
PULSE_ML = 0.17
TOLERANCE = 1.05


def now() -> float:
    return asyncio.get_running_loop().time()


async def until(condition, timeout_s: float = 20.0) -> float:
    """The moment at which it holds; looked at every two milliseconds."""
    async with asyncio.timeout(timeout_s):
        while not condition():  # noqa: ASYNC110 - the twin tells nobody
            await asyncio.sleep(0.002)
    return now()


async def arm_again(m) -> None:
    """What an operator does after a stop."""
    m.actuation.change_mode(safety.Verb.ACKNOWLEDGE, "test")
    await m.actuation.energise(lamp=False)
    for verb in (safety.Verb.ARM, safety.Verb.START):
        decision = m.actuation.change_mode(verb, "test")
        assert decision.allowed, decision.reasons


def faults(m) -> dict[str, str]:
    return {fault.id: fault.text for fault in m.actuation.state.faults}


def books(m) -> float:
    totals = m.ledger.totals(m.task_id)
    return totals.booked_ml + totals.pending_ml


# --- leaks (F10)


@pytest.mark.parametrize("share", [0.04, 0.1, 0.5])
@pytest.mark.parametrize("at_s", [7.0, 7.13])
def test_a_leak_stops_pump_power_and_machine_within_half_a_second_and_is_booked_as_long_as_it_lasts(
    share, at_s, tmp_path, monkeypatch
):
    monkeypatch.setattr(hydraulics, "LEAK_SHARE", share)

    async def main():
        async with machine(tmp_path, f"valve:wrong@{at_s}s") as m:
            await m.ready_to_spray()
            await m.spray(0.32)
            await asyncio.sleep(at_s - now())
            shot_ml = m.twin.dispensed_ml

            def off() -> bool:
                coils = m.twin.coils(now())
                return not (coils[Channel.PUMP] or coils[Channel.CONTACTOR])

            off_s = await until(off)
            assert m.actuation.state.mode is safety.Mode.SAFE_STOP
            assert "F10" in faults(m)
            first_ml = m.ledger.totals(m.task_id).leaked_ml
            await asyncio.sleep(12.0)
            totals = m.ledger.totals(m.task_id)
            return off_s - at_s, m.actuation.state.causes, shot_ml, m.twin.dispensed_ml, first_ml, totals

    took_s, causes, shot_ml, given_ml, first_ml, totals = run_virtual(main())
    assert took_s <= DETECTED_S
    assert "the valve leaks" in causes[0]
    assert first_ml < totals.leaked_ml
    assert given_ml <= totals.booked_ml <= TOLERANCE * given_ml + 2 * PULSE_ML
    assert totals.leaked_ml == pytest.approx(given_ml - shot_ml, abs=2 * PULSE_ML + 0.03 * given_ml)


def test_a_drip_is_found_at_the_meters_first_pulse(tmp_path):
    """A meter that counts a pulse in 0.17 ml tells nothing sooner: 2 % of the flow need up to 0.7 s for it."""

    async def main():
        async with machine(tmp_path, "valve:wrong@7s") as m:
            await m.ready_to_spray()
            await m.spray(0.32)
            count_ml = m.twin.inputs(now()).flow_total_ml
            pulse_s = await until(lambda: m.twin.inputs(now()).flow_total_ml > count_ml)
            stop_s = await until(lambda: m.actuation.state.mode is safety.Mode.SAFE_STOP)
            return stop_s - pulse_s

    assert run_virtual(main()) <= 0.15


def test_an_armed_machine_that_still_leaks_stops_again(tmp_path):
    async def main():
        async with machine(tmp_path, "valve:wrong@7s") as m:
            await m.ready_to_spray()
            await until(lambda: m.actuation.state.mode is safety.Mode.SAFE_STOP)
            await asyncio.sleep(1.0)
            await arm_again(m)
            await m.actuation.start_pump()
            await until(lambda: m.actuation.state.mode is safety.Mode.SAFE_STOP)
            await asyncio.sleep(RELAY_STALE_S)
            return m.twin.coils(now()), m.twin.dispensed_ml, books(m)

    coils, given_ml, booked_ml = run_virtual(main())
    assert not coils[Channel.PUMP]
    assert not coils[Channel.CONTACTOR]
    assert given_ml <= booked_ml


def test_what_leaks_while_the_program_is_down_is_booked_by_the_next_run_once(tmp_path, monkeypatch):
    monkeypatch.setattr(hydraulics, "LEAK_SHARE", 0.3)

    async def main():
        async with machine(tmp_path, "valve:wrong@6s") as m:
            await m.ready_to_spray()
            await until(lambda: m.actuation.state.mode is safety.Mode.SAFE_STOP)
            twin, task_id, before_ml = m.twin, m.task_id, books(m)
        await asyncio.sleep(20.0)
        for _ in range(2):
            async with machine(tmp_path, start=False, twin=twin) as m:
                rows = [row.leak.reason for row in m.ledger.leaks(task_id)]
                booked_ml = m.ledger.totals(task_id).booked_ml
        return before_ml, rows, twin.dispensed_ml, booked_ml

    before_ml, rows, given_ml, booked_ml = run_virtual(main())
    assert before_ml < given_ml - 1.0
    assert rows.count("flow while the program was not running") == 1
    assert given_ml <= booked_ml <= TOLERANCE * given_ml + 3 * PULSE_ML


def test_a_program_that_ended_in_mid_shot_leaves_no_leak_to_the_next(tmp_path):
    """The whole pulse is booked for its intent, and what the meter counted of it is part of that."""

    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            shot = asyncio.create_task(m.spray(0.32))
            await until(lambda: m.twin.valve_open)
            m.ledger.write_result = never
            with pytest.raises(FileError):
                await shot
            twin, task_id, full_ml = m.twin, m.task_id, m.order(0.32).full_ml
        async with machine(tmp_path, start=False, twin=twin) as m:
            dangling = m.ledger.book_dangling(START)
            return len(dangling), m.ledger.leaks(), twin.dispensed_ml, m.ledger.totals(task_id).booked_ml, full_ml

    def never(*_):
        raise FileError("killed")

    dangling, leaks, given_ml, booked_ml, full_ml = run_virtual(main())
    assert dangling == 1
    assert leaks == ()
    assert given_ml <= booked_ml == pytest.approx(full_ml)


def test_a_shot_whose_count_nobody_read_is_no_leak(tmp_path):
    """Booked in full; what the meter tells of it later is that shot's."""

    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            read, silent = m.devices.inputs.read, True

            async def reading():
                if silent and m.twin.dispensed_ml > 0.0:
                    raise DeviceTimeout("inputs", "an answer", "silence", "look at the cable")
                return await read()

            m.devices.inputs.read = reading
            result = await m.spray(0.32)
            silent = False
            await asyncio.sleep(2.0)
            return result, m.ledger.leaks(), m.actuation.state.mode, m.twin.dispensed_ml, books(m)

    result, leaks, mode, given_ml, booked_ml = run_virtual(main())
    assert result.measured_ml is None
    assert leaks == ()
    assert mode is not safety.Mode.SAFE_STOP
    assert given_ml <= booked_ml


# --- the account alone


def account(total_ml: float = 0.0, tolerance: float = 0.0) -> FlowAccount:
    settings = values.HandSettings((0.0,), 0.01, 0.1, 1.0, 10.0, PULSE_ML, tolerance, 0.02)
    made = FlowAccount(settings)
    made.begin(total_ml, 0.0)
    return made


def test_a_reading_from_before_the_count_of_a_shot_tells_nothing():
    meter = account()
    meter.take(4.0, 10.0)
    assert meter.leaked(3.0, 9.9) is None
    assert meter.leaked(4.0, 10.1) is None
    assert meter.leaked(4.17, 10.2).booked_ml == pytest.approx(PULSE_ML)


def test_a_meter_that_was_reset_is_counted_anew():
    meter = account(5.0)
    meter.take(9.0, 1.0)
    assert meter.leaked(0.17, 2.0) is None
    assert meter.leaked(0.51, 3.0).booked_ml == pytest.approx(3 * PULSE_ML)


def test_what_was_booked_in_excess_of_a_shot_covers_what_still_comes_of_it_and_no_more():
    meter = account()
    meter.take(4.0, 1.0)
    meter.credit(1.0, until_s=2.0)
    assert meter.leaked(4.6, 1.5) is None
    leak = meter.leaked(5.2, 1.8)
    assert leak.booked_ml == pytest.approx(0.2)
    assert leak.measured_ml == pytest.approx(0.2)
    meter.credit(5.0, until_s=2.0)
    assert meter.leaked(5.4, 2.1) is None  # the last reading of the shot
    assert meter.leaked(5.6, 2.2).booked_ml == pytest.approx(0.2)


def test_before_it_has_begun_it_knows_of_no_leak():
    made = FlowAccount(values.HandSettings((0.0,), 0.01, 0.1, 1.0, 10.0, PULSE_ML, 0.0, 0.02))
    assert made.leaked(99.0, 1.0) is None


@pytest.mark.parametrize(
    ("mark_ml", "covered_ml", "now_ml", "leaked_ml"),
    [
        (10.0, 0.0, 10.05, None),
        (10.0, 0.0, 11.0, 1.17),
        (10.0, 6.0, 14.0, None),  # of the shot that the program died in
        (10.0, 6.0, 17.0, 1.17),
        (10.0, 0.0, 3.0, None),  # the meter had lost its power
        (10.0, 0.0, 99_999.0, None),  # another meter
    ],
)
def test_what_passed_between_two_runs(mark_ml, covered_ml, now_ml, leaked_ml):
    settings = values.HandSettings((0.0,), 0.01, 0.1, 1.0, 10.0, PULSE_ML, 0.0, 0.02, tank_ml=10_000.0)
    leak = missed(MeterMark(1, mark_ml, covered_ml), now_ml, 5.0, settings)
    assert (leak and leak.booked_ml) == (leaked_ml and pytest.approx(leaked_ml))


# --- nozzle and tank (F65, F66)


def test_a_worn_nozzle_keeps_the_valve_shut_until_an_operator_has_seen_to_it(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            order = m.order(0.32)
            worn = replace(order, model_ml=order.model_ml / 1.5)
            result = await m.actuation.spray(worn)
            given_ml = m.twin.dispensed_ml
            assert "check nozzle" in faults(m)["F66"]
            with pytest.raises(Refused, match=r"flow meter saw .* check nozzle"):
                await m.spray(0.32)
            await asyncio.sleep(5.0)
            assert m.twin.dispensed_ml == given_ml
            await m.actuation.nozzle_checked("Ada")
            await arm_again(m)
            await m.ready_to_spray()
            await m.spray(0.32)
            return result, given_ml, m.twin.dispensed_ml, m.ledger.events("nozzle"), m.ledger.flow_history(10)

    result, given_ml, later_ml, events, history = run_virtual(main())
    assert result.outcome is Outcome.SPRAYED
    assert given_ml <= result.booked_ml
    assert later_ml > given_ml
    assert [event.text for event in events] == ["seen to by Ada"]
    assert len(history) == 1  # since the operator's word


def test_ten_shots_that_are_off_by_a_fifth_keep_it_shut_over_a_restart_too(tmp_path):
    async def life(count, share=1.25):
        given = []
        async with machine(tmp_path) as m:
            m.ledger.upsert_targets(m.task_id, [a_target(number) for number in range(1, count + 1)])
            await m.ready_to_spray()
            for number in range(1, count + 1):
                order = m.order(0.32, target_id=number)
                with suppress(Refused):
                    result = await m.actuation.spray(replace(order, model_ml=order.model_ml / share))
                    given.append(result.measured_ml)
            return len(given), faults(m).get("F66", "")

    first, problem = run_virtual(life(7))
    assert (first, problem) == (7, "")
    second, problem = run_virtual(life(7))
    assert second == 3  # with the seven of before
    assert "over 10 shots the flow meter saw" in problem


def test_a_dry_tank_stops_the_pump(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            m.twin.physics.refill(0.0)
            result = await m.spray(0.32)
            coils = m.twin.coils(now())
            return result, coils, faults(m), m.twin.dispensed_ml, books(m)

    result, coils, found, given_ml, booked_ml = run_virtual(main())
    assert result.outcome is Outcome.UNCERTAIN
    assert not coils[Channel.PUMP]
    assert "refill it" in found["F66"]
    assert given_ml <= booked_ml


# --- disks (F36, F38, F39)


@pytest.fixture
def fragile(monkeypatch):
    """Ledgers of the machine whose writes can be made to fail."""
    opened = Ledger.open
    monkeypatch.setattr(Ledger, "open", lambda path, utc: opened(path, utc, factory=FailingConnection))


@pytest.mark.parametrize("name", ["SQLITE_READONLY", "SQLITE_IOERR_WRITE", "SQLITE_FULL"])
def test_an_outcome_that_the_disk_does_not_take_is_kept_and_written_when_it_does(name, tmp_path, fragile):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            shot = asyncio.create_task(m.spray(0.32))
            await until(lambda: m.twin.valve_open)
            with failing(name):
                with pytest.raises(FileError):
                    await shot
                assert not m.twin.valve_open
                assert m.actuation.state.mode is safety.Mode.SAFE_STOP
                assert all(part.error == "" for part in await m.actuation.stop("again"))
                await asyncio.sleep(0.15)
                assert set(faults(m)) == {"F38" if name == "SQLITE_READONLY" else "F36"}
                pending = m.ledger.totals(m.task_id)
                await asyncio.sleep(3.0)
                assert len(m.ledger.dangling()) == 1
                m.actuation.change_mode(safety.Verb.ACKNOWLEDGE, "test")
                await m.actuation.energise(lamp=False)
                await asyncio.sleep(0.15)
                decision = m.actuation.change_mode(safety.Verb.ARM, "test")
                assert "the disk says no" in "; ".join(decision.reasons)
                given_ml = m.twin.dispensed_ml
            await asyncio.sleep(1.0)
            await arm_again(m)
            return pending, given_ml, m.twin.dispensed_ml, m.results(), m.ledger.dangling(), faults(m)

    pending, given_ml, later_ml, results, dangling, found = run_virtual(main())
    assert pending.pending_ml >= given_ml == later_ml
    assert [result.outcome for result in results] == [Outcome.SPRAYED]
    assert given_ml <= results[0].booked_ml <= TOLERANCE * given_ml + PULSE_ML
    assert dangling == ()
    assert found == {}


def test_an_intent_that_the_disk_does_not_take_opens_nothing_and_the_disk_is_tried_again(tmp_path, fragile):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            with failing("SQLITE_FULL"):
                with pytest.raises(FileError, match="no ledger, no spray"):
                    await m.spray(0.32)
                await asyncio.sleep(1.0)
                assert "no ledger, no spray" in faults(m)["F36"]
                assert m.twin.dispensed_ml == 0.0
            await asyncio.sleep(1.0)
            await arm_again(m)
            await m.ready_to_spray()
            await m.spray(0.32)
            return m.twin.dispensed_ml, books(m), [event.text for event in m.ledger.events("fault")]

    given_ml, booked_ml, events = run_virtual(main())
    assert 0.0 < given_ml <= booked_ml
    assert len(events) == 1
    assert events[0].startswith("intent refused: ")


def test_an_outcome_that_never_reaches_the_disk_is_booked_in_full_by_the_next_run(tmp_path, fragile):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            shot = asyncio.create_task(m.spray(0.32))
            await until(lambda: m.twin.valve_open)
            with failing("SQLITE_FULL"):
                with pytest.raises(FileError):
                    await shot
                parts = await m.actuation.de_energise()
            return m.ledger.path, m.task_id, m.order(0.32).full_ml, parts, m.twin.dispensed_ml

    path, task_id, full_ml, parts, given_ml = run_virtual(main())
    assert [(part.part, part.error != "") for part in parts] == [("relay board", False), ("ledger", True)]
    for _ in range(2):
        with Ledger.open(path, lambda: START) as after:
            after.begin_run("boot-2", START)
            after.book_dangling(START)
            assert after.totals(task_id).booked_ml == pytest.approx(full_ml)
            assert given_ml <= full_ml
            with pytest.raises(LedgerRuleError, match="is uncertain"):
                after.write_intent(task_id, after.shots(task_id)[0].intent)


def test_what_waits_is_written_at_the_end_of_the_program(tmp_path, fragile):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            shot = asyncio.create_task(m.spray(0.32))
            await until(lambda: m.twin.valve_open)
            with failing("SQLITE_FULL"), pytest.raises(FileError):
                await shot
            for poll in m.polls:
                poll.cancel()
            parts = await m.actuation.de_energise()
            return parts, m.ledger.dangling()

    parts, dangling = run_virtual(main())
    assert [part.error for part in parts] == ["", ""]
    assert dangling == ()


def test_a_leak_on_a_full_disk_is_kept_and_booked_later(tmp_path, fragile):
    async def main():
        async with machine(tmp_path, "valve:wrong@7s") as m:
            await m.ready_to_spray()
            await m.spray(0.32)
            with failing("SQLITE_FULL"):
                await until(lambda: m.actuation.state.mode is safety.Mode.SAFE_STOP)
                await asyncio.sleep(3.0)
                assert m.ledger.leaks() == ()
            await asyncio.sleep(10.0)
            return m.twin.dispensed_ml, books(m)

    given_ml, booked_ml = run_virtual(main())
    assert given_ml <= booked_ml <= TOLERANCE * given_ml + 2 * PULSE_ML


def test_a_slow_disk_delays_the_shot_and_never_the_close(tmp_path, monkeypatch):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            quick_ml = await gives(m)
            monkeypatch.setattr(values, "LEDGER_WRITE_S", 0.2)
            begun_s = now()
            shot = asyncio.create_task(m.spray(0.32))
            opened_s = await until(lambda: m.twin.valve_open)
            shut_s = await until(lambda: not m.twin.valve_open)
            await shot
            await asyncio.sleep(0.2)
            assert "1 of 3 writes took over 50 ms, the longest 200 ms" in faults(m)["F39"]
            monkeypatch.setattr(values, "LEDGER_WRITE_S", 0.002)
            await asyncio.sleep(61.0)
            assert faults(m) == {}
            return quick_ml, m.twin.dispensed_ml - quick_ml, opened_s - begun_s, shut_s - opened_s, books(m)

    async def gives(m):
        await m.spray(0.32)
        return m.twin.dispensed_ml

    quick_ml, slow_ml, waited_s, open_s, booked_ml = run_virtual(main())
    assert waited_s >= 0.2
    assert open_s == pytest.approx(0.32, abs=0.04)
    assert slow_ml == pytest.approx(quick_ml, rel=0.05)
    assert quick_ml + slow_ml <= booked_ml


def test_a_stop_while_the_disk_dawdles_leaves_the_valve_shut(tmp_path, monkeypatch):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            monkeypatch.setattr(values, "LEDGER_WRITE_S", 2.0)
            shot = asyncio.create_task(m.spray(0.32))
            await asyncio.sleep(1.0)
            began_s = now()
            await m.actuation.stop("test")
            took_s = now() - began_s
            result = await shot
            return took_s, result, m.twin.dispensed_ml

    took_s, result, given_ml = run_virtual(main())
    assert took_s < 0.15
    assert result.outcome is Outcome.NOT_OPENED
    assert given_ml == 0.0


# --- uncertain targets


def test_an_uncertain_target_is_sprayed_again_only_after_an_operators_release(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            shot = asyncio.create_task(m.spray(1.0))
            await until(lambda: m.twin.valve_open)
            shot.cancel()
            with pytest.raises(asyncio.CancelledError):
                await shot
            given_ml = m.twin.dispensed_ml
            with pytest.raises(SprayerError, match="is uncertain"):
                await m.spray(0.32)
            assert m.twin.dispensed_ml == given_ml
            await arm_again(m)
            await m.ready_to_spray()
            m.ledger.release_target(m.task_id, 1, "Ada", "hardly wet")
            await m.spray(0.32)
            return given_ml, m.twin.dispensed_ml, books(m), m.ledger.targets(m.task_id)[0].state

    given_ml, later_ml, booked_ml, state = run_virtual(main())
    assert given_ml < later_ml <= booked_ml
    assert state is TargetState.SPRAYED
