"""The GSM driver on the wire: who answers, the SIM's lock, restarts, and the ladder when the network stays away."""

from __future__ import annotations

import asyncio
import os
import time
import tty
from collections.abc import Callable
from contextlib import suppress

import pytest

from drivers.emulation.wire import PtyWire
from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceMissing, DeviceTimeout, WrongDevice
from drivers.line import PortSettings
from drivers.modem.emulated_commands import Reply
from drivers.modem.emulated_sim import EmulatedSim
from drivers.modem.emulator import ModemEmulator
from drivers.modem.gsm import GsmModem
from drivers.modem.gsm_settings import GsmSettings
from tests.contract.leaping import LeapingLoop
from tests.drivers.modem.rigs import BAUD, WORKER, Rig, run

WITH_PIN = GsmSettings(pin="1234", answer_timeout_s=2.0)
NMEA = b"$GPGGA,100000.00,4739.6000,N,00910.5000,E,4,12,0.6,404.0,M,48.0,M,1.0,0000*5D\r\n"


def open_against(answer: Callable[[bytes], bytes], chatter: bytes = b"") -> tuple[DeviceError, float, bytes]:
    """Opens the driver on a port where something else is; the error, how long it took, and what was said to it."""
    heard = bytearray()

    async def main() -> tuple[DeviceError, float]:
        loop = asyncio.get_running_loop()

        def receive(data: bytes) -> None:
            heard.extend(data)
            if told := answer(data):
                wire.send(told, 0.01)

        async def talk() -> None:
            while chatter:
                wire.send(chatter)
                await asyncio.sleep(0.2)

        wire = PtyWire(BAUD, receive)
        wire.plug()
        device = GsmModem.on_port(GsmSettings(), PortSettings(wire.path, "modem", BAUD, "at"), loop.time)
        loop.busy = lambda: True  # type: ignore[attr-defined]
        talking = loop.create_task(talk())
        begun_s = time.monotonic()
        try:
            with pytest.raises(DeviceError) as caught:
                await device.open()
            return caught.value, time.monotonic() - begun_s
        finally:
            talking.cancel()
            with suppress(asyncio.CancelledError):
                await talking
            wire.unplug()

    with asyncio.Runner(loop_factory=LeapingLoop) as runner:
        error, took_s = runner.run(main())
    return error, took_s, bytes(heard)


# --- who answers


def test_silence_is_a_missing_modem_within_three_seconds() -> None:
    error, took_s, _ = open_against(lambda data: b"")
    assert isinstance(error, DeviceMissing)
    assert "AT port" in error.remedy
    assert took_s < 3.5


@pytest.mark.parametrize(
    ("answer", "chatter"),
    [
        (lambda data: b"", NMEA),
        (lambda data: data, b""),  # both wires of the plug joined
        (lambda data: b"\x01\x83\x01\x80\xf0", b""),
        (lambda data: bytes(octet ^ 0x5A for octet in data), b""),
    ],
    ids=["receiver", "loop", "modbus", "baud"],
)
def test_something_else_is_named_as_the_wrong_device(answer: Callable[[bytes], bytes], chatter: bytes) -> None:
    error, took_s, heard = open_against(answer, chatter)
    assert isinstance(error, WrongDevice)
    assert str(BAUD) in error.remedy
    assert took_s < 3.5
    assert set(heard) <= set(b"\x1bAT\r")


def test_a_device_with_at_commands_and_no_sim_is_the_wrong_device() -> None:
    def answer(data: bytes) -> bytes:
        if b"\r" not in data:
            return b""
        return b"\r\nERROR\r\n" if b"+" in data else b"\r\nOK\r\n"

    error, _, _ = open_against(answer)
    assert isinstance(error, WrongDevice)
    assert "SIM" in str(error)


def test_a_bare_at_may_be_answered_with_an_error() -> None:
    async def test(bench: Rig) -> None:
        assert (await bench.device.status()).registered

    def answers_error(emulator: ModemEmulator) -> None:
        execute = emulator.execute
        emulator.execute = (  # type: ignore[method-assign]
            lambda line: emulator.result("ERROR") if line == "AT" else execute(line)
        )

    run(test, prepare=answers_error)


def test_a_modem_that_still_waits_for_a_text_gives_up_on_it() -> None:
    async def test(bench: Rig) -> None:
        descriptor = os.open(bench.wire.path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(descriptor)
        os.write(descriptor, b"AT+CMGF=0\rAT+CMGS=36\r0011000C")
        await bench.until(lambda: b"0011000C" in bench.heard)
        os.close(descriptor)
        await bench.device.open()
        await bench.device.send(WORKER, "hello")
        assert [sent.text for sent in bench.twin.outbox] == ["hello"]

    run(test, opened=False)


def test_the_modem_is_known_by_maker_and_model() -> None:
    async def test(bench: Rig) -> None:
        assert bench.device.model == "SIMCOM_Ltd SIMCOM_SIM800L"

    run(test)


# --- the SIM


def test_a_sim_is_unlocked_with_its_pin() -> None:
    async def test(bench: Rig) -> None:
        await bench.until(lambda: bench.emulator.registered)
        assert (await bench.device.status()).registered
        bench.text("STOP")
        assert await bench.received(1) == ["STOP"]

    run(test, sim=EmulatedSim(pin="1234"), settings=WITH_PIN)


@pytest.mark.parametrize(
    ("sim", "settings", "words"),
    [
        (EmulatedSim(pin="1234"), GsmSettings(), ["SIM locked", "its PIN", "attempts left: 3", "set modem.pin"]),
        (EmulatedSim(pin="9999"), WITH_PIN, ["SIM locked", "refused its PIN", "attempts left: 2", "correct modem.pin"]),
        (EmulatedSim(pin="1234", pin_tries=2), WITH_PIN, ["SIM locked", "refused a PIN before", "attempts left: 2"]),
        (EmulatedSim(pin="1234", pin_tries=0), WITH_PIN, ["SIM locked", "PUK", "attempts left: 10", "phone"]),
        (EmulatedSim(inserted=False), GsmSettings(), ["SIM not inserted", "put a SIM in"]),
    ],
    ids=["no pin given", "wrong pin", "tried before", "puk", "absent"],
)
def test_a_sim_that_does_not_open_is_named_with_what_to_do(
    sim: EmulatedSim, settings: GsmSettings, words: list[str]
) -> None:
    async def test(bench: Rig) -> None:
        begun_s = time.monotonic()
        with pytest.raises(DeviceFault) as caught:
            await bench.device.open()
        assert time.monotonic() - begun_s < 3.5
        for word in words:
            assert word in str(caught.value)
        assert "1234" not in str(caught.value)

    run(test, sim=sim, settings=settings, opened=False)


def test_a_refused_pin_is_never_tried_again() -> None:
    sim = EmulatedSim(pin="9999")

    async def test(bench: Rig) -> None:
        for _ in range(3):
            with pytest.raises(DeviceFault, match="SIM locked"):
                await bench.device.open()
        assert sim.pin_tries == 2
        assert bench.heard.count(b'AT+CPIN="1234"') == 1

    run(test, sim=sim, settings=WITH_PIN, opened=False)


def test_the_pin_is_in_no_representation_of_the_settings() -> None:
    assert "1234" not in repr(WITH_PIN)


@pytest.mark.parametrize("pin", ["12", "12ab", "123456789", "12\r\n"])
def test_a_pin_that_cannot_be_is_refused(pin: str) -> None:
    with pytest.raises(ValueError, match="pin"):
        GsmSettings(pin=pin)


# --- restarts


@pytest.mark.long
def test_a_modem_that_restarts_by_itself_is_set_up_again() -> None:
    async def test(bench: Rig) -> None:
        bench.emulator.restart()
        await asyncio.sleep(40.0)
        assert bench.emulator.state.echo is False
        assert bench.emulator.state.notices[1] == 1
        assert (await bench.device.status()).registered
        bench.text("STOP")
        assert await bench.received(1) == ["STOP"]

    run(test, sim=EmulatedSim(pin="1234"), settings=WITH_PIN)


def test_a_restart_without_a_word_shows_by_its_echo() -> None:
    async def test(bench: Rig) -> None:
        bench.emulator.restart()
        bench.emulator.result = lambda *lines: None  # type: ignore[method-assign]  # its baud rate is automatic
        await asyncio.sleep(60.0)
        assert bench.emulator.state.echo is False
        assert bench.emulator.state.notices[1] == 1

    run(test)


@pytest.mark.long
def test_a_network_that_stays_away_leads_up_the_ladder() -> None:
    async def test(bench: Rig) -> None:
        bench.network(False)
        begun_s = bench.clock()
        setting_up = bench.heard.count(b"AT+CNMI=")
        await bench.until(lambda: bench.heard.count(b"AT+CNMI=") > setting_up, 200.0, 2.0)
        assert 60.0 <= bench.clock() - begun_s < 120.0
        assert bench.emulator.restarts == 0
        await bench.until(lambda: bench.emulator.restarts == 1, 400.0, 2.0)
        assert 300.0 <= bench.clock() - begun_s < 360.0
        assert b"AT+CFUN=1,1" in bench.heard
        assert not bench.power_cycles
        await bench.until(lambda: len(bench.power_cycles) == 1, 900.0, 5.0)
        assert 900.0 <= bench.power_cycles[0] - begun_s < 960.0
        bench.network(True)
        await asyncio.sleep(60.0)
        assert (await bench.device.status()).registered

    run(test, settings=GsmSettings(poll_s=30.0, answer_timeout_s=2.0))


@pytest.mark.long
def test_a_radio_that_has_lost_itself_is_found_by_the_reset() -> None:
    async def test(bench: Rig) -> None:
        bench.emulator.radio_lost = True
        await asyncio.sleep(5.0)
        assert not (await bench.device.status()).registered
        await asyncio.sleep(350.0)
        assert (await bench.device.status()).registered
        assert not bench.power_cycles

    run(test)


@pytest.mark.long
def test_a_hung_modem_is_switched_off_and_on() -> None:
    async def test(bench: Rig) -> None:
        bench.emulator.hung = True
        with pytest.raises(DeviceTimeout):
            await bench.device.status()
        await bench.until(lambda: bool(bench.power_cycles), 2000.0, 5.0)
        await asyncio.sleep(60.0)
        assert (await bench.device.status()).registered
        assert bench.device.trouble is None

    run(test, settings=GsmSettings(poll_s=290.0, answer_timeout_s=0.3))


def test_a_lost_answer_does_not_shift_the_answers_after_it() -> None:
    async def test(bench: Rig) -> None:
        seen = 0
        for _ in range(30):
            try:
                status = await bench.device.status()
            except (DeviceTimeout, DeviceFault):
                continue
            seen += 1
            assert status.registered
            assert status.operator == bench.twin.nominal.modem_operator
            assert status.signal_dbm == pytest.approx(bench.twin.nominal.modem_signal_dbm, abs=10.0)
        assert seen > 0

    run(test, "modem:intermittent@2s", settings=GsmSettings(answer_timeout_s=0.2, poll_s=1000.0))


@pytest.mark.long
def test_a_slow_modem_is_waited_for() -> None:
    async def test(bench: Rig) -> None:
        assert (await bench.device.status()).registered
        await bench.device.send(WORKER, "hello")
        assert [sent.text for sent in bench.twin.outbox] == ["hello"]

    run(test, "modem:slow")


def test_a_wrong_reading_shows_in_the_signal() -> None:
    async def test(bench: Rig) -> None:
        assert (await bench.device.status()).signal_dbm == -113.0

    run(test, "modem:wrong")


def test_a_modem_for_lte_alone_counts_as_registered() -> None:
    async def test(bench: Rig) -> None:
        assert (await bench.device.status()).registered

    def without_calls(emulator: ModemEmulator) -> None:
        emulator._handlers["+CREG"] = lambda radio, form: Reply(["+CREG: 1,0"] if form == "?" else [])

    run(test, lte=True, prepare=without_calls)


def test_a_closed_modem_can_be_opened_again() -> None:
    async def test(bench: Rig) -> None:
        for _ in range(3):
            await bench.device.close()
            with pytest.raises(DeviceLost):
                await bench.device.send(WORKER, "hello")
            await bench.device.open()
        assert (await bench.device.status()).registered

    run(test)


def test_a_background_task_that_fails_is_told_to_the_next_caller(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(bench: Rig) -> None:
        await asyncio.sleep(1.0)

        def broken(*arguments: object) -> None:
            raise ZeroDivisionError("a defect")

        monkeypatch.setattr(bench.device._inbox, "update", broken)
        await asyncio.sleep(30.0)
        with pytest.raises(ZeroDivisionError):
            await bench.device.status()

    run(test)
