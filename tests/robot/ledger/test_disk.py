"""F36, F38, F39: a disk that is full, read-only or slow. No ledger, no spray; what was sprayed is still written."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot.errors import FileError
from robot.ledger import SLOW_S, Leak, Ledger, WriteLatency
from robot.ledger.latency import BOUNDS_S
from robot.ledger.reserve import RESERVE_BYTES, Reserve
from tests.robot.ledger.disk import FailingConnection, failing, file_size_limit, fill, tiny_disk
from tests.robot.ledger.rows import INTENT, NOON, SPRAYED, TASK, intent, target

LEAK = Leak(0.2, 0.2, "flow past the shut valve", 20.0)


def begun(path: Path, **options: object) -> tuple[Ledger, int]:
    ledger = Ledger.open(path, utc=lambda: NOON, **options)  # type: ignore[arg-type]
    ledger.begin_run("boot-1", NOON)
    task_id = ledger.begin_task(TASK)
    ledger.upsert_targets(task_id, [target(n) for n in (1, 2, 3)])
    return ledger, task_id


def fill_up(ledger: Ledger, task_id: int) -> Path:
    """The disk full to the last block, and the write-ahead log to its last byte of it."""
    stuffing = fill(ledger.path.parent)
    for n in range(100):
        try:
            ledger.upsert_targets(task_id, [target(2, x_m=0.01 * n)])
        except FileError:
            return stuffing
    raise AssertionError("the disk does not fill up")


def write_events(ledger: Ledger, count: int) -> None:
    for n in range(count):
        ledger.record_event("state", f"event {n}", 1.0)


def test_the_outcome_of_a_shot_finds_room_on_a_full_disk_and_the_next_intent_does_not() -> None:
    with tiny_disk() as disk:
        ledger, task_id = begun(disk / "run.ledger", reserve_bytes=200_000)
        number = ledger.write_intent(task_id, INTENT)
        stuffing = fill_up(ledger, task_id)
        assert "full" in ledger.problem
        ledger.write_result(number, SPRAYED)
        ledger.write_leak(task_id, LEAK)
        ledger.record_event("mode", "safe_stop", 3.0)
        for _ in range(2):
            with pytest.raises(FileError, match=r"cannot be kept free.*free space on the disk; no ledger, no spray"):
                ledger.write_intent(task_id, intent(2))
        assert "no ledger, no spray" in ledger.problem
        assert ledger.totals(task_id).booked_ml == pytest.approx(5.2)

        stuffing.unlink()  # somebody made room
        ledger.write_result(ledger.write_intent(task_id, intent(2)), SPRAYED)
        assert ledger.problem == ""
        ledger.close()
        with Ledger.open(ledger.path, reserve_bytes=0) as after:
            assert after.dangling() == ()
            assert after.totals(task_id).booked_ml == pytest.approx(10.2)


def test_the_reserve_is_given_up_at_the_end_so_that_a_full_disk_can_be_left_in_order() -> None:
    with tiny_disk() as disk:
        ledger, task_id = begun(disk / "run.ledger", reserve_bytes=200_000)
        number = ledger.write_intent(task_id, INTENT)
        fill_up(ledger, task_id)
        ledger.write_result(number, SPRAYED)
        ledger.close()
        assert sorted(item.name for item in disk.iterdir()) == ["run.ledger", "run.ledger.lock", "stuffing"]
        with Ledger.open(ledger.path, reserve_bytes=200_000) as after:
            assert after.totals(task_id).booked_ml == pytest.approx(5.0)


def test_an_outcome_that_finds_no_room_at_all_leaves_its_intent_to_be_booked_in_full_once(tmp_path: Path) -> None:
    ledger, task_id = begun(tmp_path / "run.ledger", reserve_bytes=4096)
    number = ledger.write_intent(task_id, INTENT)
    used = max(item.stat().st_size for item in tmp_path.iterdir())
    with file_size_limit(used):
        with pytest.raises(FileError, match="no ledger, no spray"):
            write_events(ledger, 2000)
        with pytest.raises(FileError, match="no ledger, no spray"):
            ledger.write_result(number, SPRAYED)
    ledger.close()
    for _ in range(2):
        with Ledger.open(ledger.path) as after:
            after.begin_run("boot-2", NOON)
            after.book_dangling(NOON)
            totals = after.totals(task_id)
            assert (totals.booked_ml, totals.pending_ml) == pytest.approx((6.3, 0.0))


def test_a_disk_without_room_for_the_reserve_takes_no_intent_but_opens_and_books(tmp_path: Path) -> None:
    ledger, task_id = begun(tmp_path / "run.ledger", reserve_bytes=0)
    ledger.write_intent(task_id, INTENT)
    ledger.close()
    with file_size_limit(1_000_000):
        again = Ledger.open(ledger.path)
        assert f"{RESERVE_BYTES} bytes cannot be kept free" in again.problem
        again.begin_run("boot-2", NOON)
        assert len(again.book_dangling(NOON)) == 1
        with pytest.raises(FileError, match="no ledger, no spray"):
            again.write_intent(task_id, intent(2))
    assert again.write_intent(task_id, intent(2)) == 2
    again.close()


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("SQLITE_READONLY", "file and folder can be written"),
        ("SQLITE_IOERR_FSYNC", "full or failing"),
        ("SQLITE_FULL", "no ledger, no spray"),
    ],
)
def test_a_disk_that_takes_nothing_more_refuses_intents_with_the_reason_and_keeps_what_it_has(
    tmp_path: Path, name: str, remedy: str
) -> None:
    ledger, task_id = begun(tmp_path / "run.ledger", factory=FailingConnection)
    ledger.write_result(ledger.write_intent(task_id, INTENT), SPRAYED)
    with failing(name):
        for write in (
            lambda: ledger.write_intent(task_id, intent(2)),
            lambda: ledger.write_leak(task_id, LEAK),
            lambda: ledger.record_event("mode", "safe_stop", 1.0),
        ):
            with pytest.raises(FileError, match=remedy):
                write()
        assert remedy in ledger.problem
        assert ledger.totals(task_id).booked_ml == 5.0
    ledger.write_intent(task_id, intent(2))
    assert ledger.problem == ""
    ledger.close()


def test_a_reserve_that_cannot_be_removed_is_no_error(tmp_path: Path) -> None:
    reserve = Reserve(tmp_path / "run.ledger", 4096)
    (tmp_path / "run.ledger.reserve").mkdir()
    assert not reserve.hold()
    assert "Is a directory" in reserve.problem
    assert not reserve.give_up()


def test_the_reserve_has_its_room_on_the_disk(tmp_path: Path) -> None:
    ledger, _ = begun(tmp_path / "run.ledger")
    kept = tmp_path / "run.ledger.reserve"
    assert kept.stat().st_blocks * 512 >= RESERVE_BYTES
    ledger.close()
    assert not kept.exists()


class Stopwatch:
    """A clock that goes ``step_s`` on whenever somebody looks."""

    def __init__(self) -> None:
        self.step_s = 0.001
        self.now_s = 0.0

    def __call__(self) -> float:
        self.now_s += self.step_s
        return self.now_s


def test_every_write_is_timed_and_a_slow_disk_is_named(tmp_path: Path) -> None:
    clock = Stopwatch()
    ledger, _ = begun(tmp_path / "run.ledger", clock=clock)
    assert (ledger.latency.writes, ledger.latency.warning) == (3, "")
    clock.step_s = 0.3
    ledger.record_event("state", "MOVE", 1.0)
    assert ledger.latency.longest_s == pytest.approx(0.3)
    assert ledger.latency.warning.startswith(
        "the ledger's disk is slow: 1 of 4 writes took over 50 ms, the longest 300 ms"
    )
    ledger.close()


def test_the_histogram_holds_every_write_once() -> None:
    latency = WriteLatency()
    for duration_s in (0.0005, 0.001, 0.03, SLOW_S, 0.06, 10.0):
        latency = latency.with_write(duration_s)
    assert latency.counts == (2, 0, 0, 0, 0, 2, 1, 0, 0, 0, 0, 1)
    assert len(latency.counts) == len(BOUNDS_S) + 1
    assert (latency.writes, latency.slow, latency.longest_s) == (6, 2, 10.0)
    assert latency.total_s == pytest.approx(10.1415)
