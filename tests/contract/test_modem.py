"""What every modem keeps, judged by the texts in the twin's network."""

from __future__ import annotations

import asyncio

import pytest

from drivers.errors import DeviceFault, DeviceLost, DeviceMissing, DeviceTimeout
from drivers.modem.interface import Modem
from drivers.twin import Twin
from drivers.twin import commands as c
from tests.contract.conftest import Bench

WORKER = "+4915112345678"


def now() -> float:
    return asyncio.get_running_loop().time()


def test_status_tells_network_and_signal(modem: Bench[Modem]) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        status = await device.status()
        assert status.sim_ready
        assert status.registered
        assert status.operator == twin.nominal.modem_operator
        assert status.signal_dbm == pytest.approx(twin.nominal.modem_signal_dbm, abs=10.0)
        assert 0.0 <= now() - status.stamp_s < 0.2

    modem.run(test)


def test_without_a_network_there_is_no_operator(modem: Bench[Modem]) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        twin.apply(now(), c.WorldNetwork(registered=False))
        status = await device.status()
        assert not status.registered
        assert status.operator is None

    modem.run(test)


def test_a_sent_text_is_in_the_network_when_send_returns(modem: Bench[Modem]) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        await device.send(WORKER, "row 3 done: 41 fruit, 190 ml")
        assert [(text.number, text.text) for text in twin.outbox] == [(WORKER, "row 3 done: 41 fruit, 190 ml")]

    modem.run(test)


@pytest.mark.parametrize("text", ["hello", "ж" * 100], ids=["short", "long"])
def test_a_text_that_has_arrived_is_reported_once(modem: Bench[Modem], text: str) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        await device.send(WORKER, text)
        assert device.reports() == ()
        await asyncio.sleep(10.0)
        (report,) = device.reports()
        assert (report.number, report.text, report.delivered) == (WORKER, text, True)
        assert report.stamp_s <= now()
        assert device.reports() == ()
        assert device.rejected() == ()

    modem.run(test)


@pytest.mark.parametrize(
    "text", ["Grüße 😀, [3/4] fertig €", "row 3 done; " * 60, "ж" * 300], ids=["odd", "long", "ucs2"]
)
def test_any_text_goes_out_and_comes_in_whole(modem: Bench[Modem], text: str) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        twin.apply(now(), c.WorldText(WORKER, text))
        await device.send(WORKER, text)
        assert [sent.text for sent in twin.outbox] == [text]
        await asyncio.sleep(10.0)
        assert [sms.text for sms in await device.receive()] == [text]

    modem.run(test)


def test_a_text_that_the_network_does_not_take_is_a_fault(modem: Bench[Modem]) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        twin.apply(now(), c.WorldNetwork(registered=False))
        with pytest.raises(DeviceFault, match="network"):
            await device.send(WORKER, "hello")
        assert not twin.outbox

    modem.run(test)


def test_received_texts_come_once_and_oldest_first(modem: Bench[Modem]) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        twin.apply(now(), c.WorldText(WORKER, "STATUS?"))
        await asyncio.sleep(5.0)
        twin.apply(now(), c.WorldText(WORKER, "STOP"))
        await asyncio.sleep(5.0)
        texts = await device.receive()
        assert [(sms.sender, sms.text) for sms in texts] == [(WORKER, "STATUS?"), (WORKER, "STOP")]
        assert all(sms.received_s <= now() for sms in texts)
        assert texts[0].sent_utc < texts[1].sent_utc
        assert await device.receive() == ()

    modem.run(test)


def test_a_text_under_way_is_not_there_yet(modem: Bench[Modem]) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        twin.apply(now(), c.WorldText(WORKER, "STOP"))
        assert await device.receive() == ()
        await asyncio.sleep(10.0)
        assert len(await device.receive()) == 1

    modem.run(test)


def test_a_cancelled_receive_loses_no_text(modem: Bench[Modem]) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        twin.apply(now(), c.WorldText(WORKER, "STOP"))
        await asyncio.sleep(10.0)
        receiving = asyncio.ensure_future(device.receive())
        await asyncio.sleep(0.005)
        receiving.cancel()
        with pytest.raises(asyncio.CancelledError):
            await receiving
        assert [sms.text for sms in await device.receive()] == ["STOP"]

    modem.run(test)


def test_status_can_be_asked_while_a_text_is_sent(modem: Bench[Modem]) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        sending = asyncio.ensure_future(device.send(WORKER, "hello"))
        await asyncio.sleep(0.1)
        assert (await device.status()).registered
        await sending

    modem.run(test)


def test_an_absent_modem_is_missing(modem: Bench[Modem]) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        with pytest.raises(DeviceMissing):
            await device.open()

    modem.run(test, "modem:off", opened=False)


@pytest.mark.parametrize(("verb", "error"), [("off", DeviceTimeout), ("garbage", DeviceFault)])
def test_an_answer_that_does_not_come_is_an_error(modem: Bench[Modem], verb: str, error: type[Exception]) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        await asyncio.sleep(1.0)
        with pytest.raises(error):
            await device.status()
        with pytest.raises(error):
            await device.send(WORKER, "hello")

    modem.run(test, f"modem:{verb}@1s")


def test_a_closed_modem_is_lost(modem: Bench[Modem]) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        await device.close()
        with pytest.raises(DeviceLost):
            await device.status()

    modem.run(test)


def test_a_stuck_modem_shows_no_texts(modem: Bench[Modem]) -> None:
    async def test(device: Modem, twin: Twin) -> None:
        twin.apply(now(), c.WorldText(WORKER, "STOP"))
        await asyncio.sleep(10.0)
        assert await device.receive() == ()

    modem.run(test, "modem:stuck@1s")
