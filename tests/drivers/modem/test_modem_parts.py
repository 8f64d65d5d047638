"""The ladder, the inbox and the delivery reports, without a wire."""

from __future__ import annotations

from datetime import UTC, datetime

from hypothesis import given
from hypothesis import strategies as st

from drivers.modem.concatenation import split
from drivers.modem.delivery import Delivery
from drivers.modem.inbox import Inbox, Stored
from drivers.modem.pdu import Deliver, StatusReport, encode_deliver, encode_status_report
from drivers.modem.restart_ladder import RestartLadder, Rung
from drivers.modem.user_data import Part

SENT = datetime(2026, 6, 15, 10, 0, tzinfo=UTC)
WORKER = "+4915112345678"


def pdus(text: str, reference: int = 1) -> list[str]:
    alphabet, pieces = split(text)
    return [
        encode_deliver(
            Deliver(WORKER, piece, SENT, alphabet, Part(reference, len(pieces), at) if len(pieces) > 1 else None)
        )[0]
        for at, piece in enumerate(pieces, start=1)
    ]


def report(reference: int, number: str = WORKER, status: int = 0) -> str:
    return encode_status_report(StatusReport(reference, number, status, SENT, SENT))[0]


def test_the_ladder_is_climbed_once_in_the_course_of_one_trouble() -> None:
    ladder = RestartLadder()
    rungs = {t: rung for t in range(0, 1000, 10) if (rung := ladder.due(float(t), healthy=False))}
    assert rungs == {60: Rung.SET_UP, 300: Rung.RESET, 900: Rung.POWER, 960: Rung.SET_UP}


def test_health_puts_the_ladder_back() -> None:
    ladder = RestartLadder()
    assert ladder.due(0.0, healthy=False) is None
    assert ladder.due(60.0, healthy=False) is Rung.SET_UP
    assert ladder.due(290.0, healthy=True) is None
    assert ladder.due(300.0, healthy=False) is None
    assert ladder.due(359.0, healthy=False) is None
    assert ladder.due(360.0, healthy=False) is Rung.SET_UP


@given(st.lists(st.sampled_from(["list", "take", "delete", "arrive"]), max_size=40), st.integers(4, 12))
def test_every_text_is_handed_over_once_and_none_is_deleted_before(steps: list[str], capacity: int) -> None:
    inbox = Inbox(1e9)
    network = [(f"text {number} " + "x" * (150 * (number % 3)), number) for number in range(12)]
    waiting = [(pdu, text) for text, number in network for pdu in pdus(text, number)]
    slots: dict[int, str] = {}
    whose = dict(waiting)
    handed: list[str] = []

    def arrive() -> None:
        while waiting and len(slots) < capacity:
            slots[min(set(range(1, capacity + 1)) - set(slots))] = waiting.pop(0)[0]

    def look() -> None:
        inbox.update((Stored(slot, 1, pdu) for slot, pdu in sorted(slots.items())), capacity, 0.0)

    def delete() -> None:
        for slot in [slot for slot, pdu in slots.items() if pdu in inbox.deletable]:
            text = whose[slots.pop(slot)]
            assert text in handed or len(text) > 160, "a whole text left the store before it was handed over"
        look()

    def take() -> None:
        handed.extend(sms.text for sms in inbox.take())

    doing = {"list": look, "take": take, "delete": delete, "arrive": arrive}
    for step in (*steps, *(["arrive", "list", "take", "delete"] * 40)):
        doing[step]()
    assert sorted(handed) == sorted(text for text, _ in network)


def test_the_same_pdu_in_two_slots_is_one_text() -> None:
    inbox = Inbox(60.0)
    (pdu,) = pdus("STOP")
    inbox.update([Stored(1, 1, pdu), Stored(2, 1, pdu)], 30, 0.0)
    assert [sms.text for sms in inbox.take()] == ["STOP"]
    assert inbox.deletable == {pdu}


def test_a_text_that_was_shown_at_once_comes_once() -> None:
    inbox = Inbox(60.0)
    (pdu,) = pdus("STOP")
    inbox.add_direct(pdu, 1.0)
    inbox.add_direct(pdu, 1.0)
    assert [sms.text for sms in inbox.take()] == ["STOP"]
    assert inbox.take() == ()


def test_rejected_texts_are_kept_in_bounds() -> None:
    inbox = Inbox(60.0)
    for number in range(500):
        inbox.add_direct(f"{number:04d}", 0.0)
    assert len(inbox.take_rejected()) == 100


def test_a_text_has_arrived_when_all_its_parts_have() -> None:
    delivery = Delivery()
    text = delivery.expect(WORKER, "long", 2)
    delivery.sent(text, 255, 0.0)
    delivery.report(report(255), 1.0)
    delivery.sent(text, 0, 2.0)
    assert delivery.take() == ()
    delivery.report(report(0), 3.0)
    (told,) = delivery.take()
    assert (told.number, told.text, told.delivered, told.stamp_s) == (WORKER, "long", True, 3.0)


def test_one_part_that_was_not_delivered_fails_the_text() -> None:
    delivery = Delivery()
    text = delivery.expect(WORKER, "long", 2)
    delivery.sent(text, 1, 0.0)
    delivery.sent(text, 2, 0.0)
    delivery.report(report(1, status=0x46), 1.0)
    delivery.report(report(2, status=0x21), 1.0)  # still trying
    assert delivery.take() == ()
    delivery.report(report(2), 2.0)
    assert [told.delivered for told in delivery.take()] == [False]


def test_a_report_that_is_faster_than_its_reference_counts() -> None:
    delivery = Delivery()
    text = delivery.expect(WORKER, "x", 1)
    delivery.report(report(7), 1.0)
    delivery.sent(text, 7, 2.0)
    assert [told.delivered for told in delivery.take()] == [True]


def test_a_report_of_another_phone_is_not_ours() -> None:
    delivery = Delivery()
    delivery.sent(delivery.expect(WORKER, "x", 1), 7, 0.0)
    delivery.report(report(7, "+4999999999999"), 1.0)
    delivery.report("00FF", 1.0)
    assert delivery.take() == ()
    assert delivery.unreadable == 1
    delivery.report(report(7, "015112345678"), 2.0)
    assert len(delivery.take()) == 1
