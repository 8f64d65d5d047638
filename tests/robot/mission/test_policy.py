"""What the grower, the label and the tank allow."""

import pytest

from robot.mission import State
from robot.targets import TargetState

from .conftest import SHORT
from .rover import Run, spray_row
from .truths import sightings

DENSE = {"stops_m": SHORT["stops_m"], "length_m": SHORT["length_m"]}
ONE_STOP = {"stops_m": (0.35,), "length_m": 0.9}


def test_only_the_ripeness_that_is_wanted_is_sprayed(tmp_path):
    run = spray_row(tmp_path, targets={"ripeness": ["red"]}, **DENSE)
    ripeness = {fruit.id: fruit.ripeness for fruit in run.truth.fruits}
    kinds = {target: ripeness[fruit] for fruit, target in sightings(run)}
    left = [target for target in run.targets if target.state is TargetState.NOT_WANTED]
    assert {kinds[shot.intent.target_id] for shot in run.shots} == {"red"}
    assert {kinds[target.id] for target in left} == {"turning", "green"}
    assert {target.reason for target in left} == {"turning fruit is not treated", "green fruit is not treated"}
    assert set(kinds.values()) == {"red", "turning", "green"}


def test_the_fixed_law_gives_every_fruit_the_same(tmp_path):
    run = spray_row(tmp_path, dosing={"law": "fixed", "coefficient": 3.0}, **SHORT)
    given = [opening.ml for opening in run.truth.delivered]
    assert len(given) >= 3
    assert {shot.intent.dose_ml for shot in run.shots} == {3.0}
    assert given == pytest.approx([3.0] * len(given), rel=0.1)


def test_a_dose_follows_from_the_size_of_the_fruit(undisturbed):
    """Twice the diameter, eight times the dose, inside minimum and maximum."""
    law, diameters = undisturbed.config.dosing, {target.id: target.diameter_m for target in undisturbed.targets}
    for shot in undisturbed.shots:
        due_ml = law.coefficient * 0.5235987756 * (100.0 * diameters[shot.intent.target_id]) ** 3
        assert shot.intent.dose_ml == pytest.approx(min(max(due_ml, law.min_ml), law.max_ml), rel=0.1)


def refused_reasons(run: Run) -> set[str]:
    sprayed = {shot.intent.target_id for shot in run.shots}
    return {t.reason for t in run.targets if t.id not in sprayed and t.state is TargetState.UNREACHABLE}


def test_a_tank_that_is_nearly_empty_keeps_its_reserve_and_says_so(tmp_path):
    run = spray_row(tmp_path, task={"tank_fill_ml": 215.0}, **ONE_STOP)
    assert run.result.state is State.DONE
    assert 1 <= len(run.shots) < 6
    assert run.twin.physics.tank_ml >= run.config.fluid.tank_reserve_ml
    assert any("the tank holds" in reason for reason in refused_reasons(run))


def test_the_labels_cap_is_never_passed_and_the_refusal_says_so(tmp_path):
    run = spray_row(tmp_path, task={"label_cap_ml": 20.0}, **ONE_STOP)
    assert run.result.state is State.DONE
    assert len(run.shots) >= 1
    assert run.twin.dispensed_ml <= run.totals.booked_ml <= 20.0
    assert any("task:" in reason and "over the cap of 20.00" in reason for reason in refused_reasons(run))


def test_the_cap_of_a_rolling_minute_is_kept_in_truth(tmp_path):
    run = spray_row(tmp_path, safety={"max_minute_ml": 20.0}, **ONE_STOP)
    given = [(opening.closed_t, opening.ml) for opening in run.truth.delivered]
    assert len(given) >= 2
    for end_s, _ in given:
        assert sum(ml for t, ml in given if end_s - 60.0 < t <= end_s) <= 20.0
