"""A device fails in the middle of a mission: the machine ends as ``robot/safety/failsafe.py`` says.

Numbers in brackets are those of the fault catalogue.
"""

import pytest

from drivers.twin import hydraulics
from robot.errors import UnavailableError
from robot.mission import State
from robot.safety import Mode
from robot.safety.timing import CLOSE_DEADLINE_S, CLOSE_TRIES
from robot.targets import TargetState
from tests.robot.mission.conftest import SHORT
from tests.robot.mission.rover import Run, spray_row
from tests.robot.mission.truths import (
    last_process,
    motions_asked_after,
    openings,
    openings_asked_after,
    stop_errors_m,
    valve_pulses,
)

VALVE_LAG_S = 0.06
LETTING_GO_S = 4 * CLOSE_TRIES * CLOSE_DEADLINE_S  # the longest way through the stop of a machine that does not answer


def moment(undisturbed: Run, state: State, share: float, number: int = 0) -> float:
    """That share of the way through the ``number``-th stay in a state."""
    start, end = undisturbed.spans(state)[number]
    return start + share * (end - start)


def fail(tmp_path, fault: str, at_s: float, lasts_s: float | None = None) -> Run:
    tail = "" if lasts_s is None else f"+{lasts_s}s"
    return spray_row(tmp_path, faults=(f"{fault}@{at_s:.4f}s{tail}",), **SHORT)


def is_safe_and_accounted_for(run: Run) -> None:
    """Latched; the valve shut by itself at the latest; no command that moves or opens; not a millilitre unbooked."""
    assert run.result.mode is Mode.SAFE_STOP
    assert run.result.state is State.IDLE
    process = last_process(run)
    assert openings_asked_after(process, run.latched_s) == []
    assert motions_asked_after(process, run.latched_s) == []
    assert run.last_s - run.latched_s <= LETTING_GO_S
    after = run.run_on()
    assert not after.valve_open
    assert not after.physics.hydraulics.pump_on
    longest_s = max((pulse.duration_s for pulse in valve_pulses(process)), default=0.0)
    assert all(end - start <= longest_s + VALVE_LAG_S for start, end in openings(process) if end < float("inf"))
    assert run.dangling == 0
    assert run.totals.booked_ml >= after.dispensed_ml


CASES = [
    # fault, when, what a person reads
    ("relay:off", State.MOVE, 0.5, "relay"),
    ("relay:off", State.AIM, 0.5, "relay"),
    ("relay:off", State.SPRAY, 0.3, "relay"),
    ("relay:garbage", State.AIM, 0.5, "a garbled answer"),
    ("relay:garbage", State.SPRAY, 0.01, "a garbled answer"),
    ("relay:intermittent", State.SPRAY, 0.01, "relay"),
    ("arm:off", State.AIM, 0.5, "arm"),
    ("arm:off", State.MOVE, 0.5, "arm"),
    ("arm:stuck", State.AIM, 0.6, "every joint within"),
    ("camera:off", State.STOP, 0.5, "camera"),
    ("inputs:off", State.AIM, 0.5, "inputs"),
    ("inputs:off", State.SPRAY, 0.3, "inputs"),
    ("wheels:off", State.MOVE, 0.6, "wheels"),
    ("wheels:off", State.AIM, 0.5, "wheels"),
    ("wheels:stuck", State.MOVE, 0.5, "counters that move"),
    ("valve:off", State.AIM, 0.5, "flow meter saw"),
    ("inputs:stuck", State.SPRAY, 0.01, "flow meter saw"),
    ("camera:garbage", State.STOP, 0.5, "a garbled answer"),
    ("arm:intermittent", State.AIM, 0.5, "arm"),
]


@pytest.mark.parametrize(("fault", "state", "share", "words"), CASES)
def test_a_lost_device_ends_in_a_safe_stop_with_its_name(fault, state, share, words, undisturbed, tmp_path):
    at_s = moment(undisturbed, state, share)
    run = fail(tmp_path, fault, at_s)
    device = fault.partition(":")[0]
    assert at_s <= run.latched_s
    assert device in run.said or device == "valve" or fault == "inputs:stuck"
    assert words in run.said
    is_safe_and_accounted_for(run)


@pytest.mark.parametrize("device", ["gps", "modem"])
def test_the_mission_goes_on_without(device, undisturbed, tmp_path):
    run = fail(tmp_path, f"{device}:off", moment(undisturbed, State.AIM, 0.5))
    assert run.result.state is State.DONE
    assert run.result.mode is Mode.DISARMED
    assert device in run.said
    assert len(run.shots) == len(undisturbed.shots)
    assert max(stop_errors_m(run)) <= 0.020
    assert run.totals.booked_ml >= run.run_on().dispensed_ml


def test_a_receiver_that_lies_by_metres_does_not_lead_the_rover_astray(undisturbed, tmp_path):
    """F61."""
    run = fail(tmp_path, "gps:wrong", moment(undisturbed, State.AIM, 0.5))
    assert run.result.state is State.DONE
    assert max(stop_errors_m(run)) <= 0.020


@pytest.mark.parametrize(("share", "within_s"), [(0.1, 0.5), (0.02, 2.0)])
def test_a_leaking_valve_stops_machine_pump_and_power_and_is_booked(
    share, within_s, undisturbed, tmp_path, monkeypatch
):
    """F10. The meter counts 0.17 ml a pulse: a drip of 2 % shows every 0.7 s, between shots.

    What still drips when the program has ended, until the pressure is gone, nobody can book.
    """
    monkeypatch.setattr(hydraulics, "LEAK_SHARE", share)
    at_s = moment(undisturbed, State.AIM, 0.5, number=1)
    run = fail(tmp_path, "valve:wrong", at_s)
    assert run.result.mode is Mode.SAFE_STOP
    assert "the valve leaks" in run.result.causes[0]
    assert 0.0 < run.latched_s - at_s <= within_s
    assert openings_asked_after(last_process(run), run.latched_s) == []
    off_s = [e.t for e in last_process(run).events if e.what == "coil_off" and e.detail["channel"] == "contactor"]
    assert off_s[0] - run.latched_s <= 0.2
    assert run.totals.leaked_ml > 0.0
    assert run.totals.booked_ml >= run.twin.dispensed_ml
    after = run.run_on()
    assert not after.physics.hydraulics.pump_on
    assert after.dispensed_ml - run.totals.booked_ml <= 3.0 * share / 0.02


def test_a_valve_that_does_not_open_leaves_its_target_uncertain_and_booked_in_full(undisturbed, tmp_path):
    """F66: the meter tells that the fruit did not get its dose, not how much it got."""
    run = fail(tmp_path, "valve:off", moment(undisturbed, State.AIM, 0.5))
    assert run.twin.dispensed_ml == 0.0
    shot = run.shots[-1]
    assert shot.result.booked_ml == pytest.approx(shot.intent.full_ml)
    assert {t.id: t.state for t in run.targets}[shot.intent.target_id] is TargetState.UNCERTAIN


def test_the_valve_of_a_board_that_is_gone_shuts_by_the_boards_own_timer(undisturbed, tmp_path):
    """F02: nobody can shut it, and the shot is booked as the full pulse."""
    start_s, _ = openings(last_process(undisturbed))[0]
    run = fail(tmp_path, "relay:off", start_s + 0.01)
    after = run.run_on()
    shot = run.shots[-1]
    assert not after.valve_open
    assert 0.0 < after.dispensed_ml <= shot.intent.full_ml
    assert shot.result.booked_ml >= shot.intent.full_ml
    assert {t.id: t.state for t in run.targets}[shot.intent.target_id] is TargetState.UNCERTAIN


def test_wheels_that_obey_no_more_lose_their_power_within_a_second(undisturbed, tmp_path):
    """F21: the controller keeps its speed whatever it is told; the contactor takes its power."""
    at_s = moment(undisturbed, State.MOVE, 0.5)
    run = fail(tmp_path, "wheels:stuck", at_s)
    off_s = [e.t for e in last_process(run).events if e.what == "coil_off" and e.detail["channel"] == "contactor"]
    assert len(off_s) == 1
    assert off_s[0] - at_s <= 1.0


def test_a_device_that_is_not_there_keeps_the_robot_from_coming_up(tmp_path):
    with pytest.raises(UnavailableError, match="relay: expected an answer to the first request, found silence"):
        fail(tmp_path, "relay:off", 0.0)


def test_a_fault_that_passes_does_not_start_the_machine_again(undisturbed, tmp_path):
    run = fail(tmp_path, "arm:off", moment(undisturbed, State.AIM, 0.5), lasts_s=0.2)
    is_safe_and_accounted_for(run)
