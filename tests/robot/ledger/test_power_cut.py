"""F37, P9, P10: power goes at any write. What was acknowledged is there, once; what may have flowed is booked, once."""

from __future__ import annotations

import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from robot.ledger import Leak, Ledger, LedgerReader, Outcome, Result
from robot.ledger.schema import SCHEMA_VERSION
from tests.robot.ledger.old_ledgers import check_rows, old_ledger, version
from tests.robot.ledger.power_cuts import Files, Moment, Watched, contents, cuts, play
from tests.robot.ledger.rows import CHECKPOINT, NOON, SPRAYED, STOP, TASK, intent, target

GIVES_ML = 4.9  # what the nozzle gives in a shot that is shut in time
FULL_ML = 6.3   # and at the most when the board shuts it
LEAK = Leak(0.2, 0.2, "flow past the shut valve", 20.0)
UNCERTAIN = Result(Outcome.UNCERTAIN, 6.3, 0.5, None, "close unconfirmed", 13.0)

Step = Callable[[Ledger], object]

# Task 1, intents numbered from 1. After each step: what has truly left the nozzle at the most, if power goes then.
SCRIPT: list[tuple[Step, float]] = [
    (lambda ledger: ledger.begin_task(TASK), 0.0),
    (lambda ledger: ledger.upsert_targets(1, [target(n, x_m=0.3 * n) for n in (1, 2, 3)]), 0.0),
    (lambda ledger: ledger.record_event("mode", "auto", 1.0), 0.0),
    (lambda ledger: ledger.write_intent(1, intent(1)), FULL_ML),
    (lambda ledger: ledger.write_result(1, SPRAYED), GIVES_ML),
    (lambda ledger: ledger.record_stop(1, STOP), GIVES_ML),
    (lambda ledger: ledger.checkpoint(1, CHECKPOINT), GIVES_ML),
    (lambda ledger: ledger.write_intent(1, intent(2)), GIVES_ML + FULL_ML),
    (lambda ledger: ledger.write_result(2, UNCERTAIN), GIVES_ML + FULL_ML),
    (lambda ledger: ledger.write_leak(1, LEAK), GIVES_ML + FULL_ML),
    (lambda ledger: ledger.acknowledge([1, 2]), GIVES_ML + FULL_ML),
    (lambda ledger: ledger.release_target(1, 2, "Ada", "dry"), GIVES_ML + FULL_ML),
    (lambda ledger: ledger.write_intent(1, intent(2, pulse=1)), GIVES_ML + 2 * FULL_ML),
]


@pytest.fixture
def quick() -> Iterator[Path]:
    """A folder in memory where there is one: what is tested are bytes, and there are many syncs."""
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as name:
        yield Path(name)


def begun(path: Path) -> Ledger:
    ledger = Ledger.open(path, utc=lambda: NOON, factory=Watched, reserve_bytes=0)
    ledger.begin_run("boot-1", NOON)
    return ledger


@pytest.mark.parametrize("checkpoint_pages", [1000, 6])
def test_whenever_power_goes_nothing_acknowledged_is_lost_doubled_or_given_unbooked(
    quick: Path, checkpoint_pages: int
) -> None:
    ledger = begun(quick / "run.ledger")
    ledger._connection.execute(f"PRAGMA wal_autocheckpoint = {checkpoint_pages}")
    safe = Files.of(ledger.path)
    moments, held = play(ledger.path, [step for step, _ in SCRIPT], ledger)
    ledger.close()
    assert len(moments) > 3 * len(SCRIPT)
    tried: set[Files] = set()
    done = 0
    for moment in moments:
        for files in cuts(safe, moment.files):
            if files in tried:
                continue
            tried.add(files)
            _check_after(files.lay(quick / f"cut{len(tried)}" / "run.ledger"), held, moment.done, _given_ml(moment))
        if moment.done > done:
            safe, done = moment.files, moment.done
    assert len(tried) > 60


def _given_ml(moment: Moment) -> float:
    """What left the nozzle at the most: an intent under way has not opened the valve, an outcome comes after it."""
    given_ml = [0.0, *(ml for _, ml in SCRIPT)]
    return min(given_ml[moment.done : moment.done + 2]) if moment.within else given_ml[moment.done]


def _check_after(path: Path, held: list[dict[str, list[tuple[object, ...]]]], done: int, given_ml: float) -> None:
    """The next start of the program, and the one after that."""
    for _ in range(2):
        with Ledger.open(path, utc=lambda: NOON, reserve_bytes=0) as ledger:
            found = contents(ledger)
            runs = len(found["run"])
            if runs == 1:  # nobody has written since the cut
                assert found in held[done : done + 2], f"after {done} steps"
            ledger.begin_run(f"boot-{runs + 1}", NOON)
            dangling = ledger.book_dangling(NOON)
            assert len(dangling) <= (1 if runs == 1 else 0)
            _check_books(ledger, given_ml)


def _check_books(ledger: Ledger, given_ml: float) -> None:
    assert ledger.dangling() == ()
    if ledger.latest_task() is None:
        return
    shots = ledger.shots(1)
    booked_ml = sum(shot.result.booked_ml for shot in shots if shot.result is not None)
    assert booked_ml >= given_ml - 1e-9
    assert all(shot.result is not None and shot.result.booked_ml <= FULL_ML for shot in shots)
    boxed = [(row.kind, row.row_id) for row in ledger.outbox(100)]
    assert len(set(boxed)) == len(boxed)
    assert len({row.seq for row in ledger.outbox(100)}) == len(boxed)


def test_whenever_power_goes_in_a_migration_the_ledger_is_the_old_or_the_new_one(quick: Path) -> None:
    for number in (1, 2):
        path = old_ledger(quick / f"version{number}", number)
        safe = Files.of(path)
        ledger = Ledger.open(path, factory=Watched, reserve_bytes=0)
        now = Files.of(path)
        ledger.close()
        seen = set()
        for n, files in enumerate(cuts(Files(safe.base, now.log[:32]), now)):
            cut = files.lay(quick / f"version{number}" / f"cut{n}" / "run.ledger")
            seen.add(version(cut))
            with LedgerReader.open_read_only(cut) as reader:
                check_rows(reader, number)
            with Ledger.open(cut, reserve_bytes=0) as after:
                check_rows(after, number)
            assert version(cut) == SCHEMA_VERSION
        assert seen == {number, SCHEMA_VERSION}


def test_a_torn_page_in_the_middle_of_the_log_ends_it_there(tmp_path: Path) -> None:
    """What lies behind a frame whose checksum fails does not count: no row of later date without the earlier ones."""
    ledger = begun(tmp_path / "run.ledger")
    _, held = play(ledger.path, [step for step, _ in SCRIPT], ledger)
    whole = Files.of(ledger.path)
    ledger.close()
    torn = bytearray(whole.log)
    torn[len(torn) // 2 : len(torn) // 2 + 50] = b"\xa5" * 50
    path = replace(whole, log=bytes(torn)).lay(tmp_path / "torn" / "run.ledger")
    with Ledger.open(path, reserve_bytes=0) as after:
        assert contents(after) in held
    with sqlite3.connect(path) as raw:
        assert raw.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    raw.close()
