"""What the uplink has to deliver: put there with the row, kept until acknowledged, bounded, never a dose lost."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from robot.ledger import Leak, Ledger, LedgerRuleError, OutboxRow, Outcome, Parcel, Result
from robot.ledger import outbox as boxes
from tests.robot.ledger.rows import INTENT, NOON, SPRAYED, intent, started

UNCERTAIN = Result(Outcome.UNCERTAIN, 6.3, 0.5, None, "close unconfirmed", 13.0)
LEAK = Leak(0.2, 0.2, "flow past the shut valve", 20.0)

Opened = tuple[Ledger, int]


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Opened]:
    ledger, task_id = started(tmp_path / "run.ledger")
    yield ledger, task_id
    ledger.close()


def test_every_row_that_is_drained_comes_once_in_order_with_a_key(opened: Opened) -> None:
    ledger, task_id = opened
    shot = ledger.write_intent(task_id, INTENT)
    assert ledger.outbox(10) == ()  # a shot is told of when it has an outcome
    ledger.write_result(shot, UNCERTAIN)
    leak = ledger.write_leak(task_id, LEAK)
    release = ledger.release_target(task_id, 1, "Ada", "dry")
    ledger.record_event("mode", "safe_stop", 1.0)
    ledger.record_event("state", "MOVE", 2.0)
    rows = ledger.outbox(10)
    assert rows == (
        OutboxRow(1, "boot-1", 1, Parcel.SHOT, shot),
        OutboxRow(2, "boot-1", 1, Parcel.LEAK, leak),
        OutboxRow(3, "boot-1", 1, Parcel.RELEASE, release),
        OutboxRow(4, "boot-1", 1, Parcel.FAULT, 1),
        OutboxRow(5, "boot-1", 1, Parcel.EVENT, 2),
    )
    assert [row.key("rover-7") for row in rows[:2]] == [("rover-7", "boot-1", 1), ("rover-7", "boot-1", 2)]
    assert [row.seq for row in ledger.outbox(2, after=2)] == [3, 4]


def test_what_is_acknowledged_is_gone_for_good_and_its_number_is_never_used_again(opened: Opened) -> None:
    ledger, task_id = opened
    for n in range(3):
        ledger.write_result(ledger.write_intent(task_id, intent(1, pulse=n)), SPRAYED)
    ledger.acknowledge([2, 3])
    ledger.acknowledge([3, 77])
    assert [row.seq for row in ledger.outbox(10)] == [1]
    ledger.acknowledge([1])
    assert ledger.outbox_waiting() == 0
    ledger.close()
    with Ledger.open(ledger.path) as after:
        after.begin_run("boot-2", NOON)
        after.write_result(after.write_intent(task_id, INTENT), SPRAYED)
        assert [(row.boot_id, row.seq) for row in after.outbox(10)] == [("boot-2", 4)]


def test_a_row_that_is_refused_leaves_nothing_to_deliver(opened: Opened) -> None:
    ledger, task_id = opened
    number = ledger.write_intent(task_id, INTENT)
    ledger.write_result(number, SPRAYED)
    with pytest.raises(LedgerRuleError):
        ledger.write_result(number, SPRAYED)
    assert ledger.outbox_waiting() == 1


def test_a_booked_dangling_intent_is_delivered_once(opened: Opened) -> None:
    ledger, task_id = opened
    ledger.write_intent(task_id, INTENT)
    ledger.book_dangling(NOON)
    ledger.book_dangling(NOON)
    assert [(row.kind, row.row_id) for row in ledger.outbox(10)] == [(Parcel.SHOT, 1)]


def test_old_events_make_room_and_are_counted_but_doses_and_faults_stay(
    opened: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    ledger, task_id = opened
    monkeypatch.setattr(boxes.put, "__defaults__", (5,))
    ledger.write_result(ledger.write_intent(task_id, INTENT), SPRAYED)
    ledger.write_leak(task_id, LEAK)
    ledger.record_event("fault", "relay: silent", 1.0)
    for n in range(12):
        ledger.record_event("state", f"state {n}", float(n))
    rows = ledger.outbox(100)
    assert [row.kind for row in rows] == [Parcel.SHOT, Parcel.LEAK, Parcel.FAULT] + 5 * [Parcel.EVENT]
    assert [row.seq for row in rows[3:]] == [11, 12, 13, 14, 15]
    assert ledger.outbox_dropped() == 7
    assert len(ledger.events("state")) == 12  # the ledger itself keeps all
