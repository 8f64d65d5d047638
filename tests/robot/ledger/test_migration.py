"""Ledgers of the program before: nothing is lost, and what it did not know has the value that it acted by."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from robot.errors import FileError
from robot.ledger import Ledger, LedgerReader, database
from robot.ledger.schema import SCHEMA_VERSION
from robot.targets import TargetState
from tests.robot.ledger.old_ledgers import check_nothing_newer, check_rows, old_ledger, version
from tests.robot.ledger.rows import INTENT, NOON, SPRAYED, TASK, started, target

VERSIONS = pytest.mark.parametrize("number", [1, 2])


def columns(path: Path) -> dict[str, list[tuple[object, ...]]]:
    with sqlite3.connect(path) as raw:
        tables = [name for (name,) in raw.execute("SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name")]
        found = {table: raw.execute(f"PRAGMA table_info({table})").fetchall() for table in tables}
    raw.close()
    return found


@VERSIONS
def test_opened_for_writing_it_becomes_a_ledger_of_today(tmp_path: Path, number: int) -> None:
    path = old_ledger(tmp_path, number)
    with Ledger.open(path) as ledger:
        check_rows(ledger, number)
        check_nothing_newer(ledger)
    assert version(path) == SCHEMA_VERSION == 3
    new, _ = started(tmp_path / "new.sqlite")
    new.close()
    assert columns(path) == columns(new.path)


@VERSIONS
def test_work_goes_on_in_it(tmp_path: Path, number: int) -> None:
    path = old_ledger(tmp_path, number)
    for _ in range(2):  # opened again, nothing is done twice
        with Ledger.open(path, utc=lambda: NOON) as ledger:
            ledger.begin_run("boot-1", NOON)
            task_id = ledger.begin_task(TASK)
            ledger.upsert_targets(task_id, [target(1, TargetState.SPRAYED)])
            ledger.write_result(ledger.write_intent(task_id, INTENT), SPRAYED)
            assert ledger.shots(task_id)[0].intent == INTENT
            check_rows(ledger, number)


@VERSIONS
def test_history_stays_final_after_it(tmp_path: Path, number: int) -> None:
    path = old_ledger(tmp_path, number)
    Ledger.open(path).close()
    with sqlite3.connect(path) as raw, pytest.raises(sqlite3.IntegrityError, match="final"):
        raw.execute("UPDATE intent SET factor = 0.5")
    raw.close()


@VERSIONS
def test_a_report_reads_it_as_it_is_and_does_not_change_it(tmp_path: Path, number: int) -> None:
    path = old_ledger(tmp_path, number)
    before = path.read_bytes()
    with LedgerReader.open_read_only(path) as reader:
        check_rows(reader, number)
        check_nothing_newer(reader)
    assert path.read_bytes() == before
    assert version(path) == number


@VERSIONS
def test_a_report_that_is_open_while_a_robot_brings_it_up_to_date_reads_on(tmp_path: Path, number: int) -> None:
    path = old_ledger(tmp_path, number)
    with LedgerReader.open_read_only(path) as reader:
        with Ledger.open(path) as ledger:
            check_rows(ledger, number)
        check_rows(reader, number)


def test_a_ledger_that_cannot_be_brought_up_to_date_stays_whole(tmp_path: Path) -> None:
    path = old_ledger(tmp_path)
    with sqlite3.connect(path) as raw:
        raw.execute("ALTER TABLE intent ADD COLUMN reason TEXT")  # somebody was here
    raw.close()
    with pytest.raises(FileError, match="duplicate column name: reason"):
        Ledger.open(path)
    assert version(path) == 1
    assert "measured" not in [column[1] for column in columns(path)["target"]]


@VERSIONS
def test_a_program_of_before_is_told_that_the_ledger_is_newer_than_itself(
    tmp_path: Path, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = old_ledger(tmp_path, number)
    Ledger.open(path).close()
    monkeypatch.setattr(database, "SCHEMA_VERSION", number)  # the check that both versions made already
    for door in (Ledger.open, LedgerReader.open_read_only):
        with pytest.raises(FileError, match=rf"schema 3, this one knows {number}\); update the program"):
            door(path)
    assert version(path) == SCHEMA_VERSION


def test_an_old_ledger_whose_rows_break_the_rules_of_today_stays_as_it_is(tmp_path: Path) -> None:
    path = old_ledger(tmp_path)
    with sqlite3.connect(path) as raw:
        raw.execute("UPDATE target SET sightings = 10000000")  # its weight would be beyond all measure
    raw.close()
    with pytest.raises(FileError, match=r"CHECK constraint failed: ripeness_weight.*keep the file for the records"):
        Ledger.open(path)
    assert version(path) == 1
