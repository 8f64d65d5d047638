"""The file: one process at a time, readable meanwhile, never damaged by a crash, honest about what is wrong."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from robot.errors import BusyError, FileError
from robot.ledger import Ledger, LedgerReader, Outcome, wall_clock
from robot.ledger.database import readable_errors
from robot.ledger.schema import SCHEMA_VERSION
from tests.robot.ledger.rows import INTENT, LIGHT, NOON, SPRAYED, STOP, TASK, intent, started

REPOSITORY = Path(__file__).parents[3]

CHILD = """
import sys
from pathlib import Path
from tests.robot.ledger.rows import SPRAYED, intent, started

ledger, task_id = started(Path(sys.argv[1]))
for n in range(int(sys.argv[2])):
    number = ledger.write_intent(task_id, intent(1 + n % 3, pulse=n))
    print(f"opened {number}", flush=True)
    ledger.write_result(number, SPRAYED)
    print(f"closed {number}", flush=True)
ledger.write_intent(task_id, intent(2, pulse=1000))
print("opened last", flush=True)
sys.stdin.read()
"""


def child(path: Path, shots: int) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path), str(shots)],
        cwd=REPOSITORY,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def kill_after(process: subprocess.Popen[str], line: str) -> list[str]:
    """Read the child's words until ``line``, SIGKILL it, and give all that it said."""
    assert process.stdout is not None
    said = []
    for word in process.stdout:
        said.append(word.strip())
        if said[-1] == line:
            break
    return said + kill(process)


def kill(process: subprocess.Popen[str]) -> list[str]:
    """SIGKILL the child, and give what it had said and nobody had read."""
    assert process.stdout is not None
    assert process.stdin is not None
    process.send_signal(signal.SIGKILL)
    said = [word.strip() for word in process.stdout]
    process.wait(timeout=10)
    process.stdin.close()
    process.stdout.close()
    return said


def test_kill_between_intent_and_result_leaves_a_dangling_intent_that_is_booked_in_full(tmp_path: Path) -> None:
    path = tmp_path / "run.ledger"
    kill_after(child(path, 2), "opened last")
    with Ledger.open(path) as ledger:
        task_id = ledger.latest_task()
        assert task_id is not None
        assert [item.intent.pulse for item in ledger.dangling()] == [1000]
        before = ledger.totals(task_id)
        assert (before.booked_ml, before.pending_ml) == (10.0, 6.3)
        ledger.begin_run("boot-2", NOON)
        ledger.book_dangling(NOON)
        after = ledger.totals(task_id)
        assert (after.booked_ml, after.pending_ml) == pytest.approx((16.3, 0.0))
        assert after.pulses[Outcome.UNCERTAIN] == 1


@pytest.mark.parametrize("line", ["opened 1", "closed 1", "opened 20", "closed 33"])
def test_no_line_that_a_killed_process_spoke_of_is_lost(tmp_path: Path, line: str) -> None:
    path = tmp_path / "run.ledger"
    said = kill_after(child(path, 400), line)
    opened = [int(word.split()[1]) for word in said if word.startswith("opened") and "last" not in word]
    closed = [int(word.split()[1]) for word in said if word.startswith("closed")]
    with Ledger.open(path) as ledger:
        shots = ledger.shots(1)
        assert {shot.intent_id for shot in shots} >= set(opened)
        assert {shot.intent_id for shot in shots if shot.result is not None} >= set(closed)
        totals = ledger.totals(1)
        assert totals.booked_ml + totals.pending_ml >= SPRAYED.booked_ml * len(opened)
        assert len(ledger.dangling()) <= 1


def test_files_copied_while_a_process_writes_make_a_sound_ledger(tmp_path: Path) -> None:
    path, copy = tmp_path / "run.ledger", tmp_path / "copy"
    process = child(path, 3)
    copy.mkdir()
    assert process.stdout is not None
    while process.stdout.readline().strip() != "opened last":
        pass
    for name in (path.name, path.name + "-wal"):
        shutil.copy(tmp_path / name, copy / name)
    kill(process)
    with Ledger.open(copy / path.name) as ledger:
        totals = ledger.totals(1)
        assert (totals.booked_ml, totals.pending_ml) == (15.0, 6.3)


def test_a_second_process_is_refused_with_the_first_ones_number(tmp_path: Path) -> None:
    path = tmp_path / "run.ledger"
    process = child(path, 0)
    assert process.stdout is not None
    process.stdout.readline()
    with pytest.raises(BusyError, match=f"in use by process {process.pid}"):
        Ledger.open(path)
    kill(process)
    Ledger.open(path).close()


def test_the_lock_is_free_again_after_close(tmp_path: Path) -> None:
    first, _ = started(tmp_path / "run.ledger")
    with pytest.raises(BusyError, match=str(os.getpid())):
        Ledger.open(first.path)
    first.close()
    Ledger.open(first.path).close()


def test_a_report_reads_while_the_robot_writes_and_cannot_write(tmp_path: Path) -> None:
    ledger, task_id = started(tmp_path / "run.ledger")
    with LedgerReader.open_read_only(ledger.path) as reader:
        for n in range(3):
            ledger.write_result(ledger.write_intent(task_id, intent(1, pulse=n)), SPRAYED)
            assert reader.totals(task_id).booked_ml == 5.0 * (n + 1)
        with pytest.raises(sqlite3.OperationalError, match="readonly"):
            reader._connection.execute("DELETE FROM event")
    ledger.close()
    with LedgerReader.open_read_only(ledger.path) as reader:
        assert reader.totals(task_id).booked_ml == 15.0


def test_several_threads_may_write_one_after_the_other(tmp_path: Path) -> None:
    ledger, task_id = started(tmp_path / "run.ledger")

    def spray(target_id: int) -> None:
        for n in range(10):
            ledger.write_result(ledger.write_intent(task_id, intent(target_id, pulse=n)), SPRAYED)

    threads = [threading.Thread(target=spray, args=(n,)) for n in (1, 2, 3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(ledger.shots(task_id)) == 30
    assert ledger.dangling() == ()
    ledger.close()


def test_a_ledger_of_a_newer_program_is_refused(tmp_path: Path) -> None:
    ledger, _ = started(tmp_path / "run.ledger")
    ledger.close()
    with sqlite3.connect(ledger.path) as raw:
        raw.execute("PRAGMA user_version = 99")
    raw.close()
    for door in (Ledger.open, LedgerReader.open_read_only):
        with pytest.raises(FileError, match=rf"schema 99, this one knows {SCHEMA_VERSION}\); update the program"):
            door(ledger.path)


def test_the_light_of_a_stop_is_kept_with_it(tmp_path: Path) -> None:
    lit = replace(STOP, stop=3, light=LIGHT)
    with Ledger.open(tmp_path / "run.ledger", utc=lambda: NOON) as ledger:
        ledger.begin_run("boot-1", NOON)
        task = ledger.begin_task(TASK)
        ledger.record_stop(task, STOP)
        ledger.record_stop(task, lit)
        assert [row.record for row in ledger.stops(task)] == [STOP, lit]


def test_a_file_that_is_no_database_is_refused_and_kept(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("tomatoes, basil, mozzarella\n" * 100)
    with pytest.raises(FileError, match=r"notes.txt: file is not a database; not a sound ledger"):
        Ledger.open(path)
    assert path.read_text().startswith("tomatoes")


def test_another_programs_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.db"
    with sqlite3.connect(path) as raw:
        raw.execute("CREATE TABLE song (title TEXT)")
    raw.close()
    with pytest.raises(FileError, match="not a ledger of this program"):
        Ledger.open(path)


def test_a_damaged_ledger_is_refused_before_anything_is_sprayed(tmp_path: Path) -> None:
    ledger, task_id = started(tmp_path / "run.ledger")
    for n in range(60):
        ledger.write_result(ledger.write_intent(task_id, intent(1, pulse=n)), SPRAYED)
    ledger.close()
    content = bytearray(ledger.path.read_bytes())
    page = 4096
    for start in range(2 * page, len(content), page):
        content[start : start + 400] = b"\xa5" * 400
    ledger.path.write_bytes(content)
    with pytest.raises(FileError, match="keep the file for the records, move it away"):
        Ledger.open(ledger.path)


def test_a_ledger_with_rows_that_no_program_writes_is_refused(tmp_path: Path) -> None:
    ledger, _ = started(tmp_path / "run.ledger")
    ledger.record_event("state", "MOVE", 1.0)
    ledger.close()
    with sqlite3.connect(ledger.path) as raw:
        raw.execute("PRAGMA ignore_check_constraints = ON")
        raw.execute("UPDATE event SET kind = ''")
    raw.close()
    with pytest.raises(FileError, match=r"damaged \(CHECK constraint failed in event\); keep the file"):
        Ledger.open(ledger.path)


class WithoutLog(sqlite3.Connection):
    """On a file system that cannot share memory."""

    def execute(self, sql: str, *values: Any) -> sqlite3.Cursor:
        return super().execute("SELECT 'delete'" if sql.startswith("PRAGMA journal_mode") else sql, *values)


def test_a_file_system_without_a_write_ahead_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"cannot hold a write-ahead log \(mode delete\); use a local disk"):
        Ledger.open(tmp_path / "run.ledger", factory=WithoutLog)
    Ledger.open(tmp_path / "run.ledger").close()


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none/run.ledger.lock: cannot be created"):
        Ledger.open(tmp_path / "none" / "run.ledger")


def test_a_report_of_a_missing_ledger_makes_no_file(tmp_path: Path) -> None:
    path = tmp_path / "none.ledger"
    with pytest.raises(FileError, match="there is no ledger here"):
        LedgerReader.open_read_only(path)
    assert not path.exists()


def test_an_empty_file_is_not_a_ledger_to_report_on(tmp_path: Path) -> None:
    path = tmp_path / "empty.ledger"
    path.touch()
    with pytest.raises(FileError, match="not a ledger"):
        LedgerReader.open_read_only(path)


def test_a_path_that_is_a_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(FileError, match="unable to open database file; check that the folder exists"):
        Ledger.open(tmp_path / "folder")


def spray_until_full(ledger: Ledger, task_id: int) -> None:
    for n in range(2000):
        ledger.write_result(ledger.write_intent(task_id, intent(1, pulse=n)), SPRAYED)


def test_a_full_disk_refuses_the_intent_and_keeps_what_was_written(tmp_path: Path) -> None:
    ledger, task_id = started(tmp_path / "run.ledger")
    ledger.write_result(ledger.write_intent(task_id, INTENT), SPRAYED)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    old_handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    used = max(item.stat().st_size for item in tmp_path.iterdir() if item.suffix != ".reserve")
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (used, hard))
        with pytest.raises(FileError, match="no ledger, no spray"):
            spray_until_full(ledger, task_id)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, old_handler)
    assert ledger.totals(task_id).booked_ml >= 5.0
    ledger.write_intent(task_id, intent(2))
    ledger.close()
    with Ledger.open(ledger.path) as again:
        assert len(again.dangling()) in (1, 2)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("SQLITE_FULL", "free space on the disk; no ledger, no spray"),
        ("SQLITE_IOERR_WRITE", "full or failing"),
        ("SQLITE_CORRUPT", "keep the file for the records"),
        ("SQLITE_READONLY", "can be written"),
        ("SQLITE_BUSY", "another program keeps the file locked"),
        ("SQLITE_INTERNAL", "check the file and the disk"),
    ],
)
def test_every_failure_of_the_file_names_its_remedy(tmp_path: Path, name: str, remedy: str) -> None:
    error = sqlite3.OperationalError("it failed")
    error.sqlite_errorname = name
    with pytest.raises(FileError, match=f"run.ledger: it failed; .*{remedy}"), readable_errors(tmp_path / "run.ledger"):
        raise error


def test_rows_bear_the_wall_clocks_time(tmp_path: Path) -> None:
    with Ledger.open(tmp_path / "run.ledger") as ledger:
        before = wall_clock()
        ledger.begin_run("boot", before)
        ledger.record_event("state", "idle", 0.0)
        (event,) = ledger.events()
    assert abs((event.utc - before).total_seconds()) < 60.0
    assert event.utc.utcoffset() == timedelta(0)


def test_a_disk_too_full_for_the_lock_is_named(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    old_handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
        with pytest.raises(FileError, match="lock: cannot be written"):
            Ledger.open(tmp_path / "run.ledger")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, old_handler)
    Ledger.open(tmp_path / "run.ledger").close()
