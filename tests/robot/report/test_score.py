"""The score counts what the truth says, not what the robot believes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from drivers.twin.truth_record import read_truth
from robot.dosing import DoseLaw, DoseRules, Hidden, LawKind, RipenessFactors
from robot.errors import UsageError
from robot.ledger import Ledger, LedgerReader
from robot.report import Judgement, judge, read_evidence, score_rows
from robot.vision.values import Ripeness
from tests.robot.report.sprayed_row import USUAL, Sprayed, write_ledger, write_truth


def judged(
    folder: Path,
    shots: tuple[Sprayed, ...] = USUAL,
    restart_after: int | None = None,
    reachable: frozenset[int] | None = None,
    factors: RipenessFactors | None = None,
) -> Judgement:
    write_ledger(folder / "ledger.sqlite", shots, restart_after)
    write_truth(folder / "truth.jsonl", shots, restart_after)
    with LedgerReader.open_read_only(folder / "ledger.sqlite") as reader:
        evidence = read_evidence(reader)
    rules = DoseRules(DoseLaw(LawKind.VOLUME, 0.02, 1.5, 12.0), factors or RipenessFactors(), Hidden.MINIMUM)
    return judge(evidence, read_truth(folder / "truth.jsonl"), reachable, rules.dose_ml)


def test_fruits_are_counted_as_in_the_row_visible_seen_and_sprayed(tmp_path: Path) -> None:
    score = judged(tmp_path).score
    assert (score.fruits, score.visible, score.seen, score.sprayed) == (4, 3, 3, 2)
    assert (score.sprayed_of_wanted, score.wanted, score.wanted_percent) == (2, 3, pytest.approx(66.7, abs=0.1))


def test_only_reachable_visible_fruits_are_asked_for_when_reach_is_known(tmp_path: Path) -> None:
    score = judged(tmp_path, reachable=frozenset({1, 2, 4})).score
    assert (score.reachable, score.sprayed_of_wanted, score.wanted) == (3, 2, 2)


def test_a_shot_that_gave_no_fruit_a_quarter_is_a_phantom(tmp_path: Path) -> None:
    result = judged(tmp_path)
    assert (result.score.phantoms, result.score.targets_sprayed) == (1, 3)
    assert [dose.fruit_id for dose in result.doses] == [1, 2, None]


def test_a_fruit_hit_by_two_targets_was_sprayed_twice(tmp_path: Path) -> None:
    score = judged(tmp_path, (Sprayed(1, 5.0, {1: 5.0}), Sprayed(2, 5.0, {1: 3.0, 2: 2.0}))).score
    assert (score.sprayed, score.sprayed_twice) == (1, 1)


def test_two_pulses_for_one_target_are_one_dose(tmp_path: Path) -> None:
    result = judged(tmp_path, (Sprayed(1, 5.0, {1: 5.0}), Sprayed(1, 4.0, {1: 4.4})))
    assert result.score.sprayed_twice == 0
    assert [(d.commanded_ml, d.booked_ml, d.delivered_ml) for d in result.doses] == [(9.0, 9.0, pytest.approx(9.4))]


def test_overspray_of_a_neighbour_does_not_count_as_spraying_it(tmp_path: Path) -> None:
    assert judged(tmp_path, (Sprayed(1, 5.0, {1: 4.0, 2: 1.0}),)).score.sprayed == 1


def test_share_of_liquid_on_fruit_is_of_all_that_left_the_nozzle(tmp_path: Path) -> None:
    score = judged(tmp_path).score
    assert score.delivered_ml == pytest.approx(11.5)
    assert score.on_fruit_percent == pytest.approx(100 * 9.2 / 11.5)


def test_dose_errors_are_of_the_delivered_millilitres(tmp_path: Path) -> None:
    score = judged(tmp_path, (Sprayed(1, 5.0, {1: 5.1}), Sprayed(2, 4.0, {2: 4.4}))).score
    assert score.delivered_vs_commanded_median_percent == pytest.approx(6.0)
    assert score.delivered_vs_commanded_p95_percent == pytest.approx(9.6, abs=0.01)
    due_1, due_2 = 0.02 * 268.083, 0.02 * 179.594
    expected = 50.0 * (abs(5.1 / due_1 - 1) + abs(4.4 / due_2 - 1))
    assert score.delivered_vs_due_median_percent == pytest.approx(expected, rel=1e-3)


def test_position_error_is_the_distance_of_targets_from_true_centres(tmp_path: Path) -> None:
    score = judged(tmp_path).score
    assert score.position_error_median_mm == pytest.approx(5.0)
    assert score.position_error_p95_mm == pytest.approx(5.0)


def test_seconds_a_target_run_from_the_first_frame_to_the_last_shot(tmp_path: Path) -> None:
    assert judged(tmp_path).score.seconds_a_target == pytest.approx((18.6 - 5.0) / 3)


def test_reasons_that_differ_only_in_figures_count_together(tmp_path: Path) -> None:
    assert judged(tmp_path).score.skipped == {"unreachable: out of the arm's reach by mm": 1}


def test_shots_of_a_resumed_task_find_their_openings_in_the_second_process(tmp_path: Path) -> None:
    result = judged(tmp_path, restart_after=2)
    assert len(result.delivered_by_intent_ml) == 3
    assert [dose.delivered_ml for dose in result.doses] == [pytest.approx(shot.ml) for shot in USUAL]


def test_without_shots_the_figures_are_unknown_not_zero(tmp_path: Path) -> None:
    score = judged(tmp_path, ()).score
    assert (score.sprayed, score.phantoms) == (0, 0)
    assert score.on_fruit_percent is None
    assert score.seconds_a_target is None
    assert ("Liquid on the fruit", "–") in score_rows(score)


def test_rows_for_the_terminal_name_the_wanted_fruits(tmp_path: Path) -> None:
    rows = dict(score_rows(judged(tmp_path, reachable=frozenset({1, 2, 3})).score))
    assert rows["sprayed of those visible and reachable"] == "2 of 3 (67 %)"
    assert rows["reachable from a stop"] == "3"


RED_UNWANTED = RipenessFactors(treated=frozenset({Ripeness.GREEN, Ripeness.TURNING}))


def test_fruit_that_is_not_to_be_treated_is_not_asked_for_and_counts_when_sprayed(tmp_path: Path) -> None:
    """All fruits of the small row are red."""
    score = judged(tmp_path, factors=RED_UNWANTED).score
    assert (score.treated, score.wanted, score.wanted_percent, score.sprayed_untreated) == (0, 0, None, 2)
    assert score.delivered_vs_due_median_percent is None
    rows = dict(score_rows(score))
    assert rows["of a ripeness that is treated"] == "0"
    assert rows["sprayed though not to be treated"] == "2"


def test_the_due_of_a_true_fruit_follows_its_ripeness(tmp_path: Path) -> None:
    shots = (Sprayed(1, 2.7, {1: 2.7}),)
    score = judged(tmp_path, shots, factors=RipenessFactors(red=0.5)).score
    assert score.delivered_vs_due_median_percent == pytest.approx(100 * abs(2.7 / (0.01 * 268.083) - 1), rel=1e-3)
    assert (score.treated, score.sprayed_untreated) == (4, 0)
    assert "sprayed though not to be treated" not in dict(score_rows(score))


def test_a_ledger_without_tasks_has_no_report(tmp_path: Path) -> None:
    with Ledger.open(tmp_path / "empty.sqlite") as ledger, pytest.raises(UsageError, match="holds no task yet"):
        read_evidence(ledger)


def test_a_target_far_from_any_fruit_is_no_fruit(tmp_path: Path) -> None:
    result = judged(tmp_path)
    assert result.fruit_of == {1: 1, 2: 2, 3: 3}
    assert replace(result.score).seen == 3
