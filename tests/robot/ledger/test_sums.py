"""What caps begin with: every shot and leak of earlier runs, pending intents in full, nothing twice."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.ledger import Leak, Ledger, Recent, cell_of
from robot.ledger.sums import Given, add_up, day_of
from tests.robot.ledger.rows import NOON, SPRAYED, TASK, intent, target

LEAK = Leak(0.5, 0.4, "flow past the shut valve", 20.0)


class Clock:
    """A wall clock that the test sets."""

    def __init__(self) -> None:
        self.now = NOON

    def __call__(self) -> datetime:
        return self.now


def shoot(ledger: Ledger, task_id: int, target_id: int, ml: float) -> None:
    ledger.write_result(ledger.write_intent(task_id, intent(target_id)), replace(SPRAYED, booked_ml=ml))


def test_sums_over_tasks_days_squares_and_the_last_minute(tmp_path: Path) -> None:
    clock = Clock()
    ledger = Ledger.open(tmp_path / "run.ledger", utc=clock)
    ledger.begin_run("boot-1", NOON)
    places = [target(1, x_m=0.2), target(2, x_m=0.8), target(3, x_m=1.1)]
    tasks = []
    for route in ("A", "A", "B"):
        tasks.append(ledger.begin_task(replace(TASK, route=route)))
        ledger.upsert_targets(tasks[-1], places)
    ours, same_row, other_row = tasks
    clock.now = NOON - timedelta(days=1)
    shoot(ledger, ours, 1, 1.0)      # yesterday, of our task
    shoot(ledger, same_row, 1, 2.0)  # yesterday, of another
    clock.now = NOON
    shoot(ledger, same_row, 1, 4.0)
    shoot(ledger, other_row, 1, 8.0)
    ledger.write_leak(ours, LEAK)
    ledger.write_leak(None, LEAK)
    clock.now = NOON + timedelta(seconds=50)
    shoot(ledger, ours, 2, 16.0)
    ledger.write_intent(ours, intent(3))  # pending: 6.3 ml
    ledger.close()

    with Ledger.open(ledger.path) as after:
        sums = after.sums(ours, NOON + timedelta(seconds=70))
    assert sums.task_ml == pytest.approx(1.0 + 0.5 + 16.0 + 6.3)
    assert sums.day_ml == pytest.approx(4.0 + 8.0 + 1.0 + 16.0 + 6.3)
    assert sums.target_ml == {1: 1.0, 2: 16.0, 3: pytest.approx(6.3)}
    assert sums.cell_ml == {(0, 0): pytest.approx(1.0 + 4.0 + 16.0), (1, 0): pytest.approx(6.3)}
    assert sums.minute == (Recent(20.0, 16.0), Recent(20.0, pytest.approx(6.3)))


def test_a_new_task_on_the_same_row_begins_with_what_its_squares_got_today(tmp_path: Path) -> None:
    with Ledger.open(tmp_path / "run.ledger", utc=lambda: NOON) as ledger:
        ledger.begin_run("boot-1", NOON)
        first, second = ledger.begin_task(TASK), ledger.begin_task(TASK)
        ledger.upsert_targets(first, [target(1, x_m=0.5)])
        shoot(ledger, first, 1, 7.0)
        sums = ledger.sums(second, NOON + timedelta(hours=1))
    assert (sums.task_ml, sums.day_ml, sums.target_ml, sums.cell_ml, sums.minute) == (0.0, 7.0, {}, {(0, 0): 7.0}, ())


def test_the_minute_reaches_over_midnight_and_the_day_does_not(tmp_path: Path) -> None:
    clock = Clock()
    clock.now = datetime(2026, 6, 1, 23, 59, 50, tzinfo=UTC)
    with Ledger.open(tmp_path / "run.ledger", utc=clock) as ledger:
        ledger.begin_run("boot-1", NOON)
        before, task_id = ledger.begin_task(TASK), ledger.begin_task(TASK)
        ledger.upsert_targets(before, [target(1)])
        shoot(ledger, before, 1, 7.0)
        sums = ledger.sums(task_id, clock.now + timedelta(seconds=20))
    assert (sums.day_ml, sums.minute) == (0.0, (Recent(20.0, 7.0),))


def test_a_clock_that_was_set_back_frees_nothing() -> None:
    later = Given(1, "A", 1, 0.5, 0.5, NOON + timedelta(hours=2), 9.0)
    sums = add_up([later], 1, "A", NOON)
    assert (sums.task_ml, sums.day_ml, sums.minute) == (9.0, 9.0, (Recent(0.0, 9.0),))


def test_squares_are_counted_from_minus_infinity() -> None:
    assert cell_of(-0.1, 0.0) == (-1, 0)
    assert cell_of(1.0, 2.99) == (1, 2)
    assert day_of(NOON) == datetime(2026, 6, 1, tzinfo=UTC)


SHOTS = st.lists(
    st.builds(
        Given,
        task_id=st.sampled_from([1, 2, None]),
        route=st.just("A"),
        target_id=st.integers(1, 4),
        x_m=st.floats(-3, 3),
        y_m=st.floats(-1, 1),
        utc=st.datetimes(datetime(2026, 5, 31), datetime(2026, 6, 3)).map(lambda t: t.replace(tzinfo=UTC)),  # noqa: DTZ001
        ml=st.floats(0, 50),
    )
)


@given(SHOTS)
def test_every_sum_is_made_of_whole_shots_and_none_is_counted_twice(shots: list[Given]) -> None:
    sums = add_up(shots, 1, "A", NOON)
    ours = sum(shot.ml for shot in shots if shot.task_id == 1)
    today = sum(shot.ml for shot in shots if shot.utc >= day_of(NOON))
    assert sums.task_ml == pytest.approx(ours)
    assert sum(sums.target_ml.values()) == pytest.approx(ours)
    assert sums.day_ml == pytest.approx(today)
    either = sum(shot.ml for shot in shots if shot.task_id == 1 or shot.utc >= day_of(NOON))
    assert sum(sums.cell_ml.values()) == pytest.approx(either)
    assert sum(entry.ml for entry in sums.minute) <= sum(shot.ml for shot in shots) + 1e-9
    assert all(0.0 <= entry.age_s < 60.0 for entry in sums.minute)
