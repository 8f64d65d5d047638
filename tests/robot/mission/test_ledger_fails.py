"""The disk fails in the middle of a mission: no ledger, no spray; and a stop goes on past it."""

import sqlite3
from pathlib import Path

import pytest

from drivers.twin.aftermath import run_on
from robot.commands.run import single_error
from robot.errors import SprayerError
from robot.ledger import LedgerReader
from robot.mission import State
from robot.runtime import ledger_path
from robot.safety import Mode

from .conftest import SHORT
from .rover import Meddler, World, spray_row
from .truths import last_process, motions_asked_after, openings, openings_asked_after


def filling(folder: Path, table: str) -> Meddler:
    """From the first AIM on the ledger takes no more rows of that table."""

    async def fill_the_disk(world: World) -> None:
        await world.until(State.AIM)
        with sqlite3.connect(ledger_path(folder / "run")) as db:
            db.execute(f"CREATE TRIGGER full BEFORE INSERT ON {table} BEGIN SELECT RAISE(ABORT, 'disk full'); END")
        db.close()

    return fill_the_disk


@pytest.mark.parametrize("table", ["intent", "result", "target", "checkpoint"])
def test_a_ledger_that_takes_no_more_rows_ends_in_a_safe_stop(table, tmp_path):
    run = spray_row(tmp_path, meddler=filling(tmp_path, table), **SHORT)
    assert run.result.state is State.IDLE
    assert run.result.mode is Mode.SAFE_STOP
    assert "disk full" in run.said
    process = last_process(run)
    assert openings_asked_after(process, run.latched_s) == []
    assert motions_asked_after(process, run.latched_s) == []
    after = run.run_on()
    assert not any(after.coils(after.now_s).values())
    assert len(openings(process)) == len(run.shots)
    assert run.totals.booked_ml + run.totals.pending_ml >= after.dispensed_ml


def test_a_ledger_that_takes_no_more_events_ends_the_run_with_its_error_and_all_outputs_off(tmp_path):
    with pytest.raises(ExceptionGroup) as caught:
        spray_row(tmp_path, meddler=filling(tmp_path, "event"), **SHORT)
    assert isinstance(single_error(caught.value), SprayerError)
    assert "disk full" in str(single_error(caught.value))
    after = run_on(tmp_path / "truth.jsonl")
    assert not any(after.coils.values())
    assert after.after_ml == 0.0
    with LedgerReader.open_read_only(ledger_path(tmp_path / "run")) as ledger:
        totals = ledger.totals(1)
    assert totals.booked_ml + totals.pending_ml >= after.total_ml
