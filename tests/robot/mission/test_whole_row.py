"""Whole rows, sprayed with the oracle for a detector: what truly happened against what should."""

import math

import pytest

from drivers.twin.commands import ArmGoal
from drivers.twin.truth_record import Delivered
from robot.commands.demo import reach_of
from robot.mission import State
from robot.report import Judgement, judge
from robot.safety import Mode
from robot.targets import TargetState

from .rover import DEMO, Run, spray_row
from .truths import drive_starts, last_process, motions, openings, overlapping, sightings, stop_errors_m

SHORT_M, SHORT_STOPS_M = 1.6, (0.2, 0.6, 1.0, 1.4)
FULL_M, FULL_STOPS_M = 4.0, tuple(round(0.2 + 0.4 * k, 1) for k in range(10))
ROWS = {
    "left row with RTK": (SHORT_STOPS_M, SHORT_M, "left", "rtk_fixed"),
    "right row with RTK": (SHORT_STOPS_M[:2], 0.8, "right", "rtk_fixed"),
    "full left row by landmarks alone": (FULL_STOPS_M, FULL_M, "left", "none"),
}


@pytest.fixture(scope="module", params=list(ROWS))
def run(request, tmp_path_factory) -> Run:
    stops_m, length_m, side, gps = ROWS[request.param]
    return spray_row(tmp_path_factory.mktemp("row"), stops_m, length_m, side, twin={"gps": gps})


@pytest.fixture(scope="module")
def judgement(run: Run) -> Judgement:
    return judge(run.evidence, run.truth, reach_of(run.config, DEMO, run.truth))


def test_the_mission_comes_to_the_rows_end_and_disarms(run):
    assert run.result.state is State.DONE
    assert run.result.mode is Mode.DISARMED
    assert [trouble.text for trouble in run.troubles if "[F60]" not in trouble.text] == []
    assert ("[F60]" in run.said) is (run.config.twin.gps == "none")
    assert len(run.evidence.stops) == run.states[-1].stops == len(run.frames)


def test_the_base_truly_stands_within_20_mm_of_every_stop(run):
    errors_m = stop_errors_m(run)
    assert len(errors_m) == run.states[-1].stops
    assert max(errors_m) <= 0.020


def test_nine_tenths_of_the_fruit_in_sight_and_reach_are_sprayed(judgement):
    score = judgement.score
    assert score.wanted >= 5
    assert score.sprayed_of_wanted >= 0.9 * score.wanted


def test_no_fruit_is_aimed_at_twice(run):
    fruit_of = {target: fruit for fruit, target in sightings(run)}
    shot_at = [target.id for target in run.targets if target.state is TargetState.SPRAYED]
    assert len({fruit_of[target] for target in shot_at}) == len(shot_at)
    assert sorted({shot.intent.target_id for shot in run.shots}) == shot_at


def test_hardly_a_shot_misses_all_fruit(judgement):
    assert judgement.score.phantoms <= 0.1 * judgement.score.targets_sprayed


def test_the_base_moves_only_with_the_arm_truly_stowed(run):
    starts = drive_starts(last_process(run))
    assert len(starts) >= run.states[-1].stops
    for start in starts:
        assert start.joints_rad == pytest.approx(run.config.arm.stow_rad, abs=0.02)


def test_the_arm_is_sent_nowhere_while_the_base_moves(run):
    process = last_process(run)
    base = motions(process, "base")
    goals = [timed.t for timed in process.commands if isinstance(timed.command, ArmGoal)]
    assert len(base) >= run.states[-1].stops
    assert len(goals) > len(run.shots)
    assert [t for t in goals for start, end in base if start <= t <= end] == []


def test_the_valve_opens_only_while_the_base_stands(run):
    process = last_process(run)
    opened = openings(process)
    assert len(opened) == len(run.shots) > 0
    assert overlapping(opened, motions(process, "base")) == []


def test_the_nozzle_keeps_still_while_the_valve_is_open(run):
    assert len(run.shaken) == len(run.shots)
    assert max(shaken.joints_rad for shaken in run.shaken) <= run.config.arm.settle_tolerance_rad
    assert max(shaken.nozzle_m for shaken in run.shaken) <= 0.003


def test_the_median_dose_is_delivered_within_five_percent_of_what_was_commanded(judgement):
    assert judgement.score.delivered_vs_commanded_median_percent <= 5.0


def test_the_ledger_books_every_shot_at_least_as_it_was_delivered_and_the_sum_hardly_more(run, judgement):
    delivered_ml = sum(opening.ml for opening in run.truth.delivered)
    assert delivered_ml == pytest.approx(run.twin.dispensed_ml)
    assert delivered_ml <= run.totals.booked_ml <= 1.05 * delivered_ml + 0.34
    assert run.totals.pending_ml == 0.0
    assert len(judgement.delivered_by_intent_ml) == len(run.shots)


def test_every_opening_lasted_no_longer_than_the_boards_own_timer(run):
    longest = max(shot.intent.pulse_s for shot in run.shots)
    assert all(end - start <= longest + 0.06 for start, end in openings(last_process(run)))


def test_every_target_has_a_fate_and_every_one_that_got_nothing_a_reason(run):
    sprayed = {shot.intent.target_id for shot in run.shots}
    for target in run.targets:
        assert target.state is not TargetState.OPEN
        assert (target.state is TargetState.SPRAYED) == (target.id in sprayed)
        assert target.state is TargetState.SPRAYED or target.reason


def test_a_fruit_seen_from_several_stops_is_one_target(run):
    targets_of: dict[int, set[int]] = {}
    fruits_of: dict[int, set[int]] = {}
    seen = list(sightings(run))
    for fruit, target in seen:
        targets_of.setdefault(fruit, set()).add(target)
        fruits_of.setdefault(target, set()).add(fruit)
    assert len(run.targets) < len(seen)
    assert [targets for targets in targets_of.values() if len(targets) > 1] == []
    assert [fruits for fruits in fruits_of.values() if len(fruits) > 1] == []


def test_the_nozzle_points_at_the_fruit_it_sprays(run, judgement):
    """The spray's axis passes the true centre of the fruit within its radius."""
    centres = {fruit.id: (fruit.centre_m, fruit.diameter_m) for fruit in run.truth.fruits}
    by_intent = {shot.intent_id: shot.intent.target_id for shot in run.shots}
    assert len(by_intent) == len(run.truth.delivered)
    missed = 0
    for opening, target in zip(run.truth.delivered, by_intent.values(), strict=True):
        if target in judgement.fruit_of:
            centre_m, diameter_m = centres[judgement.fruit_of[target]]
            missed += _distance_from_axis_m(opening, centre_m) > 0.5 * diameter_m
    assert missed <= 0.05 * len(run.shots)


def _distance_from_axis_m(opening: Delivered, point_m: tuple[float, float, float]) -> float:
    away = [p - n for p, n in zip(point_m, opening.nozzle_m, strict=True)]
    along = sum(a * b for a, b in zip(away, opening.axis, strict=True))
    return math.sqrt(max(0.0, sum(a * a for a in away) - along * along))
