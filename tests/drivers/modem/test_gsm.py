"""The GSM driver on the wire: texts."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from drivers.errors import DeviceFault, DeviceLost, DeviceRefused
from drivers.modem.emulated_sim import DRAFT, RECEIVED_READ, EmulatedSim, StoredPdu, TextStore
from drivers.modem.gsm_settings import GsmSettings
from drivers.modem.inbox import UNKNOWN_SENT_UTC
from drivers.modem.pdu import Deliver, Submit, encode_deliver, encode_submit
from drivers.modem.user_data import Alphabet, Part
from tests.drivers.modem.rigs import QUICK, WORKER, Rig, run

LONG = "row 7: 41 fruit [1 refused], 190 ml, 12 €. " * 10
UCS2 = "Tank leer: 5 °C ж 😀 " * 12
SENT = datetime(2026, 6, 15, 8, 0, tzinfo=UTC)


def stored(deliver: Deliver) -> StoredPdu:
    return StoredPdu(RECEIVED_READ, *encode_deliver(deliver))


def sim_with(*entries: StoredPdu, capacity: int = 30) -> EmulatedSim:
    return EmulatedSim(texts=TextStore(capacity, dict(enumerate(entries, start=1))))


@pytest.mark.parametrize("text", ["", "hello", LONG, UCS2, "NUL \0 and \u202e right to left"])
def test_any_text_arrives_in_the_network_as_one(text: str) -> None:
    async def test(bench: Rig) -> None:
        await bench.device.send(WORKER, text)
        assert [(sent.number, sent.text) for sent in bench.twin.outbox] == [(WORKER, text)]

    run(test)


@pytest.mark.parametrize("text", ["STOP", LONG, UCS2])
def test_any_text_from_the_network_arrives_as_one(text: str) -> None:
    async def test(bench: Rig) -> None:
        bench.text(text)
        await asyncio.sleep(10.0)
        (sms,) = await bench.device.receive()
        assert (sms.sender, sms.text) == (WORKER, text)
        assert abs(sms.sent_utc - bench.twin.nominal.start_utc) < timedelta(seconds=2.0)

    run(test)


def test_a_text_leaves_the_store_only_once_it_is_handed_over() -> None:
    async def test(bench: Rig) -> None:
        bench.text("STOP")
        await asyncio.sleep(30.0)  # polled twice
        assert len(bench.emulator.sim.texts.slots) == 1
        assert [sms.text for sms in await bench.device.receive()] == ["STOP"]
        await bench.until(lambda: not bench.emulator.sim.texts.slots)
        assert bench.twin.texts(bench.clock()) == ()

    run(test)


def test_a_full_store_is_emptied_and_nothing_is_lost() -> None:
    async def test(bench: Rig) -> None:
        for number in range(45):
            bench.text(f"text {number}")
        assert await bench.received(45) == [f"text {number}" for number in range(45)]

    run(test)


def test_texts_longer_than_the_store_come_through_in_parts() -> None:
    async def test(bench: Rig) -> None:
        bench.text("ж" * 1500)
        bench.text("STOP")
        assert sorted(await bench.received(2)) == ["STOP", "ж" * 1500]

    run(test, sim=sim_with(capacity=10))


def test_drafts_give_way_when_the_store_is_full() -> None:
    async def test(bench: Rig) -> None:
        bench.text("STOP")
        assert await bench.received(1) == ["STOP"]

    draft = StoredPdu(DRAFT, *encode_submit(Submit(WORKER, "old")))
    run(test, sim=sim_with(draft, draft, draft, capacity=3))


def test_old_texts_of_the_store_come_with_their_own_stamp() -> None:
    async def test(bench: Rig) -> None:
        texts = await bench.device.receive()
        assert [(sms.text, sms.sent_utc) for sms in texts] == [("later", UNKNOWN_SENT_UTC), ("STOP", SENT)]

    odd = stored(Deliver(WORKER, "later", SENT))
    odd.pdu = odd.pdu.replace("62605180000000", "FF605180000000")
    run(test, sim=sim_with(stored(Deliver(WORKER, "STOP", SENT)), odd))


def test_what_is_no_text_is_told_with_its_reason_and_leaves_the_store() -> None:
    async def test(bench: Rig) -> None:
        assert [sms.text for sms in await bench.device.receive()] == ["STOP"]
        rejected = bench.device.rejected()
        assert {text.code for text in rejected} == {"undecodable", "data", "oversize"}
        assert all(text.pdu and text.reason for text in rejected)
        await bench.until(lambda: not bench.emulator.sim.texts.slots)
        assert bench.device.rejected() == ()

    oversize = [stored(Deliver(WORKER, "x" * 153, SENT, Alphabet.GSM7, Part(9, 11, number))) for number in range(1, 12)]
    run(
        test,
        sim=sim_with(
            StoredPdu(RECEIVED_READ, "0004FF9171", 5),
            stored(Deliver(WORKER, "\x01\x02", SENT, Alphabet.DATA)),
            *oversize,
            stored(Deliver(WORKER, "STOP", SENT)),
        ),
    )


def test_parts_without_the_others_are_given_up_in_time() -> None:
    async def test(bench: Rig) -> None:
        assert await bench.device.receive() == ()
        assert bench.device.rejected() == ()
        await asyncio.sleep(130.0)
        (rejected,) = bench.device.rejected()
        assert rejected.code == "parts_missing"
        await bench.until(lambda: not bench.emulator.sim.texts.slots)

    half = stored(Deliver(WORKER, "first half", SENT, Alphabet.GSM7, Part(9, 2, 1)))
    run(test, sim=sim_with(half), settings=GsmSettings(answer_timeout_s=2.0, parts_keep_s=120.0))


def test_unsolicited_codes_at_awkward_moments_disturb_nothing() -> None:
    async def test(bench: Rig) -> None:
        for number in range(3):
            bench.text(f"text {number} {LONG}")
            bench.emulator.ring("+491709999999")
            await asyncio.sleep(3.0)
            bench.emulator.look_around()  # notices are held back for the next awkward moment
            assert (await bench.device.status()).registered
            await bench.device.send(WORKER, f"answer {number}")
        assert [sent.text for sent in bench.twin.outbox] == ["answer 0", "answer 1", "answer 2"]
        assert await bench.received(3) == [f"text {number} {LONG}" for number in range(3)]

    run(test, awkward=True)


def test_a_delivery_report_tells_that_a_long_text_has_arrived() -> None:
    async def test(bench: Rig) -> None:
        await bench.device.send(WORKER, LONG)
        assert bench.device.reports() == ()
        await asyncio.sleep(30.0)
        (report,) = bench.device.reports()
        assert (report.number, report.text, report.delivered) == (WORKER, LONG, True)
        assert bench.device.reports() == ()

    run(test, settings=GsmSettings(answer_timeout_s=2.0, delivery_reports=True), awkward=True)


def test_a_text_that_cannot_be_sent_is_refused_before_anything_is_said() -> None:
    async def test(bench: Rig) -> None:
        await asyncio.sleep(5.0)
        before = bytes(bench.heard)
        for text in ("x" * 1531, "\ud800"):
            with pytest.raises(DeviceRefused, match="text"):
                await bench.device.send(WORKER, text)
        for number in ("call me", "+49\r\nATD110;", "", "1" * 21):
            with pytest.raises(DeviceRefused, match="number"):
                await bench.device.send(number, "x")
        assert bytes(bench.heard) == before

    run(test)


def test_a_network_that_is_lost_while_the_text_is_taken_is_named() -> None:
    async def test(bench: Rig) -> None:
        sending = asyncio.ensure_future(bench.device.send(WORKER, "hello"))
        await bench.until(lambda: b"\x1a" in bench.heard)
        bench.network(False)
        with pytest.raises(DeviceFault, match=r"network that takes the text, found \+CMS ERROR 331 \(no network"):
            await sending
        assert not bench.twin.outbox

    run(test)


def test_a_cancelled_sender_does_not_tear_a_long_text_apart() -> None:
    async def test(bench: Rig) -> None:
        sending = asyncio.ensure_future(bench.device.send(WORKER, LONG))
        await asyncio.sleep(1.0)
        sending.cancel()
        with pytest.raises(asyncio.CancelledError):
            await sending
        await bench.until(lambda: bool(bench.twin.outbox))
        assert bench.twin.outbox[0].text == LONG

    run(test)


def test_closing_while_the_network_takes_its_time_ends_the_sending() -> None:
    async def test(bench: Rig) -> None:
        sending = asyncio.ensure_future(bench.device.send(WORKER, LONG))
        await bench.until(lambda: b"\x1a" in bench.heard)
        await bench.device.close()
        with pytest.raises((DeviceLost, asyncio.CancelledError)):
            await sending
        with pytest.raises(DeviceLost, match="closed"):
            await bench.device.receive()
        await bench.device.open()  # the modem finishes with the part it has, and hears again
        assert (await bench.device.status()).registered

    run(test)


@pytest.mark.long
def test_a_status_while_a_text_is_sent_bears_its_own_stamp() -> None:
    async def test(bench: Rig) -> None:
        await bench.device.status()
        sending = asyncio.ensure_future(bench.device.send(WORKER, LONG))
        stamps = []
        for _ in range(6):
            await asyncio.sleep(0.5)
            status = await bench.device.status()
            stamps.append(bench.clock() - status.stamp_s)
        assert max(stamps) > 0.3  # not made up for the asker
        await sending
        assert bench.clock() - (await bench.device.status()).stamp_s < min(1.0, max(stamps))

    run(test, sending_s=2.5)


def test_an_unplugged_modem_is_lost_and_comes_back_set_up(tmp_path: Path) -> None:
    async def test(bench: Rig) -> None:
        bench.wire.unplug()
        with pytest.raises(DeviceLost):
            await bench.device.status()
        bench.emulator.restart()
        await asyncio.sleep(5.0)
        bench.wire.plug()
        await bench.until(lambda: bench.device.port.connected)
        await asyncio.sleep(30.0)
        assert bench.emulator.state.echo is False
        assert bench.emulator.state.notices[1] == 1
        bench.text("STOP")
        assert await bench.received(1) == ["STOP"]

    run(test, link=tmp_path / "modem", settings=QUICK)
