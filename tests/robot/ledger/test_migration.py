"""Ledgers of the program before: nothing is lost, and what it did not know has the value that it acted by."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from robot.errors import FileError
from robot.ledger import Ledger, LedgerReader
from robot.ledger.schema import SCHEMA_VERSION
from robot.targets import TargetState
from robot.vision.values import Ripeness
from tests.robot.ledger.rows import INTENT, NOON, SPRAYED, TASK, started, target

OLD = Path(__file__).with_name("schema_1.sql").read_text(encoding="utf-8")
ROWS = """
INSERT INTO run VALUES (1, 'boot-0', '2026-05-01T08:00:00+00:00');
INSERT INTO task VALUES (1, 1, '2026-05-01T08:00:00+00:00', 'Water', '-', 0, 'Ada', 5000, 8000, 1, 'demo', 'abc', 7);
INSERT INTO target VALUES
  (1, 1, 0.3, 0.6, 0.9, '[1e-6, 0, 0, 1e-6, 0, 1e-6]', 0.08, 0.003, 'red', 0.9, 0.8, 0.5, 3, 11, 'sprayed', ''),
  (1, 2, 0.3, 0.6, 0.9, '[0, 0, 0, 0, 0, 0]', 0.001, 0, 'green', 0, 0, 0, 1, 11, 'open', 'by hand: no fruit');
INSERT INTO intent VALUES (1, 1, 1, '2026-05-01T08:01:00+00:00', 1, 1, 1, 5.4, 5.4, 0.4, 0.5, 6.3, 12);
INSERT INTO result VALUES (1, '2026-05-01T08:01:01+00:00', 'sprayed', 5.4, 0.4, 5.3, 'as told', 13);
"""


def old_ledger(folder: Path) -> Path:
    path = folder / "old.sqlite"
    with sqlite3.connect(path) as raw:
        raw.execute("PRAGMA journal_mode = WAL")
        raw.executescript(OLD + ROWS)
    raw.close()
    return path


def check_rows(reader: LedgerReader) -> None:
    fruit, by_hand = reader.targets(1)
    assert (fruit.diameter_m, fruit.ripeness, fruit.ripeness_score) == (0.08, Ripeness.RED, 0.9)
    assert (fruit.measured, fruit.ripeness_weight) == (True, pytest.approx(3 * 0.8 * 0.5))
    assert (by_hand.measured, by_hand.ripeness_weight) == (False, 0.0)
    (shot,) = reader.shots(1)
    assert (shot.intent.factor, shot.intent.reason, shot.intent.stamp_s) == (1.0, "", 12.0)
    assert shot.result is not None
    assert (shot.result.booked_ml, shot.result.reason) == (5.4, "as told")


def columns(path: Path) -> dict[str, list[tuple[object, ...]]]:
    with sqlite3.connect(path) as raw:
        tables = [name for (name,) in raw.execute("SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name")]
        found = {table: raw.execute(f"PRAGMA table_info({table})").fetchall() for table in tables}
    raw.close()
    return found


def version(path: Path) -> int:
    with sqlite3.connect(path) as raw:
        (found,) = raw.execute("PRAGMA user_version").fetchone()
    raw.close()
    return int(found)


def test_opened_for_writing_it_becomes_a_ledger_of_today(tmp_path: Path) -> None:
    path = old_ledger(tmp_path)
    with Ledger.open(path) as ledger:
        check_rows(ledger)
    assert version(path) == SCHEMA_VERSION == 3
    new, _ = started(tmp_path / "new.sqlite")
    new.close()
    assert columns(path) == columns(new.path)


def test_work_goes_on_in_it(tmp_path: Path) -> None:
    path = old_ledger(tmp_path)
    for _ in range(2):  # opened again, nothing is done twice
        with Ledger.open(path, utc=lambda: NOON) as ledger:
            ledger.begin_run("boot-1", NOON)
            task_id = ledger.begin_task(TASK)
            ledger.upsert_targets(task_id, [target(1, TargetState.SPRAYED)])
            ledger.write_result(ledger.write_intent(task_id, INTENT), SPRAYED)
            assert ledger.shots(task_id)[0].intent == INTENT
            check_rows(ledger)


def test_history_stays_final_after_it(tmp_path: Path) -> None:
    path = old_ledger(tmp_path)
    Ledger.open(path).close()
    with sqlite3.connect(path) as raw, pytest.raises(sqlite3.IntegrityError, match="final"):
        raw.execute("UPDATE intent SET factor = 0.5")
    raw.close()


def test_a_report_reads_it_as_it_is_and_does_not_change_it(tmp_path: Path) -> None:
    path = old_ledger(tmp_path)
    before = path.read_bytes()
    with LedgerReader.open_read_only(path) as reader:
        check_rows(reader)
    assert path.read_bytes() == before
    assert version(path) == 1


def test_a_report_that_is_open_while_a_robot_brings_it_up_to_date_reads_on(tmp_path: Path) -> None:
    path = old_ledger(tmp_path)
    with LedgerReader.open_read_only(path) as reader:
        with Ledger.open(path) as ledger:
            check_rows(ledger)
        check_rows(reader)


def test_a_ledger_that_cannot_be_brought_up_to_date_stays_whole(tmp_path: Path) -> None:
    path = old_ledger(tmp_path)
    with sqlite3.connect(path) as raw:
        raw.execute("ALTER TABLE intent ADD COLUMN reason TEXT")  # somebody was here
    raw.close()
    with pytest.raises(FileError, match="duplicate column name: reason"):
        Ledger.open(path)
    assert version(path) == 1
    assert "measured" not in [column[1] for column in columns(path)["target"]]
