"""The hands on the simulated machine: what left the nozzle, what stands in the ledger, what still moves."""

import asyncio

import pytest

from drivers.relay.values import Channel
from drivers.twin.faults import Fault, FaultPlan, Verb
from robot import safety
from robot.actuation import Refused
from robot.clock import run_virtual
from robot.errors import SprayerError
from robot.ledger.values import Outcome

from .machine import gentle, machine

Q_ML_S = 12.6


def test_a_shot_gives_its_dose_and_is_booked_just_above_it(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            result = await m.spray(0.32)
            return result, m.twin.dispensed_ml, m.twin.valve_open

    result, given_ml, valve_open = run_virtual(main())
    assert not valve_open
    assert result.outcome is Outcome.SPRAYED
    assert given_ml == pytest.approx(Q_ML_S * (0.32 - 0.005), rel=0.08)
    assert given_ml <= result.booked_ml <= 1.05 * given_ml + 0.17


def test_the_booked_sum_is_never_below_the_truth_and_within_five_percent_above_it(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            for _ in range(4):
                await m.spray(0.3)
            return sum(r.booked_ml for r in m.results()), m.twin.dispensed_ml

    booked_ml, given_ml = run_virtual(main())
    assert given_ml <= booked_ml <= 1.05 * given_ml + 0.17


@pytest.mark.parametrize("after_s", [0.0005, 0.005, 0.02, 0.1, 0.25, 0.345, 0.4, 0.5])
def test_valve_closes_when_the_spraying_task_is_cancelled_and_the_shot_is_booked(after_s, tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            shot = asyncio.create_task(m.spray(0.32))
            await asyncio.sleep(after_s)
            shot.cancel()
            shot.cancel()
            with pytest.raises(asyncio.CancelledError):
                await shot
            open_at_return = m.twin.valve_open
            await asyncio.sleep(5.0)
            return open_at_return, m.twin.dispensed_ml, m.results(), m.ledger.dangling()

    open_at_return, given_ml, results, dangling = run_virtual(main())
    assert not open_at_return
    assert dangling == ()
    assert sum(result.booked_ml for result in results) >= given_ml
    if results and results[0].outcome is Outcome.SHORTENED:
        assert given_ml < Q_ML_S * 0.32


def test_stop_shuts_the_valve_in_mid_shot_halts_and_latches(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            shot = asyncio.create_task(m.spray(1.0))
            await asyncio.sleep(0.3)
            parts = await m.actuation.stop("test")
            result = await shot
            after_ml = m.twin.dispensed_ml
            await asyncio.sleep(15.0)
            return parts, result, after_ml, m.twin.dispensed_ml, m.actuation.state

    parts, result, after_ml, later_ml, state = run_virtual(main())
    assert [part.error for part in parts] == ["", "", "", ""]
    assert result.outcome is Outcome.SHORTENED
    assert after_ml < 0.45 * Q_ML_S
    assert later_ml == after_ml <= result.booked_ml
    assert state.mode is safety.Mode.SAFE_STOP
    assert state.causes == ("test",)


def test_a_shot_cut_short_without_a_flow_reading_is_booked_full_and_not_as_whole(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            shot = asyncio.create_task(m.spray(1.0))
            await asyncio.sleep(0.3)
            m.twin.physics.plan = FaultPlan([Fault("inputs", Verb.UNPLUGGED)])
            await m.actuation.stop("test")
            return await shot, m.order(1.0).full_ml, m.twin.dispensed_ml

    result, full_ml, given_ml = run_virtual(main())
    assert result.outcome is Outcome.SHORTENED
    assert result.booked_ml == full_ml > given_ml > 0.0


def test_nothing_is_sprayed_or_moved_while_disarmed(tmp_path):
    async def main():
        async with machine(tmp_path, start=False) as m:
            here = m.actuation.joints_rad
            for attempt in (
                m.spray(),
                m.actuation.start_pump(),
                m.actuation.drive(0.1, 0.0),
                m.actuation.move_arm(gentle(here, tuple(a + 0.05 for a in here))),
            ):
                with pytest.raises(Refused, match="mode is disarmed"):
                    await attempt
            await asyncio.sleep(2.0)
            return m.twin.dispensed_ml, m.twin.base_pose, m.ledger.shots(m.task_id)

    assert run_virtual(main()) == (0.0, (0.0, 0.0, 0.0), ())


def test_a_shot_without_pressure_is_refused_before_the_intent(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            m.actuation.mark_frame()
            with pytest.raises(Refused, match="pressure is"):
                await m.spray()
            return m.ledger.shots(m.task_id), m.twin.dispensed_ml

    assert run_virtual(main()) == ((), 0.0)


def test_the_pump_stops_by_itself_when_nobody_renews_its_lease(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            await m.actuation.start_pump()
            await asyncio.sleep(20.0)
            while_polled = (await m.devices.relay.read()).coils[Channel.PUMP]
            for poll in m.polls:
                poll.cancel()  # the host hangs
            await asyncio.sleep(11.0)
            return while_polled, (await m.devices.relay.read()).coils[Channel.PUMP]

    assert run_virtual(main()) == (True, False)


def test_an_open_that_nobody_confirmed_is_booked_as_the_full_pulse_and_stops_the_machine(tmp_path):
    async def main():
        async with machine(tmp_path, "relay:off@5.3s+60s") as m:
            await m.ready_to_spray()
            now = asyncio.get_running_loop().time()
            await asyncio.sleep(max(0.0, 5.35 - now))
            try:
                result = await m.spray(0.32)
            except SprayerError as error:
                result = error
            return result, m.twin.dispensed_ml, m.actuation.state, m.results()

    result, given_ml, state, results = run_virtual(main())
    assert state.mode is safety.Mode.SAFE_STOP or isinstance(result, SprayerError)
    assert sum(r.booked_ml for r in results) >= given_ml


def test_a_ledger_that_cannot_be_written_means_no_spray(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()

            def full_disk(task_id, intent):
                raise SprayerError("disk full")

            m.ledger.write_intent = full_disk
            with pytest.raises(SprayerError, match="disk full"):
                await m.spray()
            return m.twin.dispensed_ml, m.actuation.state.mode

    assert run_virtual(main()) == (0.0, safety.Mode.SAFE_STOP)


def test_an_arm_that_is_pushed_after_it_settled_does_not_spray(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            await m.ready_to_spray()
            here = m.actuation.joints_rad
            goal = tuple(a + 0.2 for a in here)
            moving = asyncio.create_task(m.actuation.move_arm(gentle(here, goal)))
            await asyncio.sleep(0.2)
            with pytest.raises(Refused, match="arm has not settled"):
                await m.spray()
            await moving
            return m.twin.dispensed_ml

    assert run_virtual(main()) == 0.0


def test_the_base_does_not_drive_with_the_arm_unfolded(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            here = m.actuation.joints_rad
            goal = (*here[:5], here[5] + 0.3)
            await m.actuation.move_arm(gentle(here, goal))
            with pytest.raises(Refused, match="not stowed"):
                await m.actuation.drive(0.1, 0.0)
            return m.twin.base_pose

    assert run_virtual(main()) == (0.0, 0.0, 0.0)


def test_the_lamp_is_lit_only_by_an_armed_machine_and_read_back(tmp_path):
    async def main():
        async with machine(tmp_path) as m:
            assert not m.actuation.lamp_lit
            await m.actuation.switch_lamp(True)
            shown = m.actuation.lamp_lit, m.twin.coils(asyncio.get_running_loop().time())[Channel.LAMP]
            await m.actuation.stop("test")
            with pytest.raises(Refused, match="mode is safe_stop"):
                await m.actuation.switch_lamp(True)
            await m.actuation.switch_lamp(False)  # may always go out
            return shown, m.actuation.lamp_lit

    assert run_virtual(main()) == ((True, True), False)


def test_a_disarmed_machine_lights_no_lamp(tmp_path):
    async def main():
        async with machine(tmp_path, start=False) as m:
            with pytest.raises(Refused, match="mode is disarmed"):
                await m.actuation.switch_lamp(True)
            return m.twin.coils(asyncio.get_running_loop().time())[Channel.LAMP]

    assert not run_virtual(main())
