"""The emulated modem, by the bytes that go in and come out."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.emulation.bad_line import BadLine
from drivers.modem.emulated_sim import EmulatedSim, TextStore
from drivers.modem.emulator import ModemEmulator
from drivers.modem.pdu import Submit, decode_deliver, decode_status_report, encode_submit
from drivers.twin import Twin
from drivers.twin import commands as c
from robot.clock import run_virtual
from tests.drivers.twin import rig

WORKER = "+4915112345678"
OK = "\r\nOK\r\n"


class Host:
    """In virtual time, without a wire: what the modem says comes at once and in order."""

    def __init__(self, twin: Twin, **options: Any) -> None:
        loop = asyncio.get_running_loop()
        self.twin, self.clock = twin, loop.time
        self.modem = ModemEmulator(twin, loop.time, **options)
        self._said: list[str] = []
        self.modem.connect(BadLine("modem", twin, loop.time, self._hear, 0.0))
        self._serving = loop.create_task(self.modem.serve())

    def _hear(self, data: bytes, delay_s: float) -> None:
        self._said.append(data.decode("latin-1"))

    async def says(self, text: str, wait_s: float = 0.1) -> str:
        """What comes within ``wait_s`` of ``text`` and an end of line."""
        self._said.clear()
        self.modem.receive(text.encode("latin-1") + (b"" if text[-1:] in ("\x1a", "\x1b") else b"\r"))
        await asyncio.sleep(wait_s)
        return "".join(self._said)

    async def hears(self, wait_s: float) -> str:
        self._said.clear()
        await asyncio.sleep(wait_s)
        return "".join(self._said)

    async def end(self) -> None:
        self._serving.cancel()
        await asyncio.wait([self._serving])


def with_host(test: Callable[[Host], Awaitable[None]], *faults: str, echo: bool = False, **options: Any) -> Twin:
    twin = rig.twin(*faults)

    async def main() -> None:
        host = Host(twin, **options)
        if not echo:
            await host.says("ATE0")
        await test(host)
        await host.end()

    run_virtual(main())
    return twin


def test_characters_are_echoed_until_that_is_turned_off() -> None:
    async def test(host: Host) -> None:
        assert await host.says("AT") == "AT\r" + OK
        assert await host.says("ATE0") == "ATE0\r" + OK
        assert await host.says("AT") == OK
        assert await host.says("AT&F") == OK
        assert await host.says("at+csq") != ""
        assert (await host.says("AT")).startswith("AT\r")

    with_host(test, echo=True)


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("AT+CMEE=1;+CREG=2", OK),
        ("ATE0+CMEE=1;+CMEE?", "\r\n+CMEE: 1\r\n" + OK),
        ("AT+CPIN?", "\r\n+CPIN: READY\r\n" + OK),
        ("AT+CREG=2;+CREG?", '\r\n+CREG: 2,1,"1A2B","00C3"\r\n' + OK),
        ("AT+COPS=3,0;+COPS?", '\r\n+COPS: 0,0,"Demo Mobile"\r\n' + OK),
        ('AT+CPMS="SM","SM","SM"', "\r\n+CPMS: 0,30,0,30,0,30\r\n" + OK),
        ('AT+CPMS="ME";+CPMS?', '\r\n+CPMS: 0,50,0,30,0,30\r\n\r\n+CPMS: "ME",0,50,"SM",0,30,"SM",0,30\r\n' + OK),
        ("AT+CSCA?", '\r\n+CSCA: "+491710760000",145\r\n' + OK),
        ("AT+CNMI=2,1,0,1;+CNMI?", "\r\n+CNMI: 2,1,0,1,0\r\n" + OK),
        ("AT+CGMI;+CGMM;+CGSN", "\r\nSIMCOM_Ltd\r\n\r\nSIMCOM_SIM800L\r\n\r\n867856030000000\r\n" + OK),
        ("AT+NONSENSE", "\r\nERROR\r\n"),
        ("AT+CMGF=2", "\r\nERROR\r\n"),
        ("AT+CMEE=1;+CMGR=99", "\r\n+CMS ERROR: 321\r\n"),
        ("AT+CMEE=2;+CPIN=1234", "\r\n+CME ERROR: operation not allowed\r\n"),
        ("ATD110;", "\r\nERROR\r\n"),
        ("hello", ""),
    ],
)
def test_commands_are_answered_as_the_standard_says(command: str, answer: str) -> None:
    async def test(host: Host) -> None:
        assert await host.says(command) == answer

    with_host(test)


def test_a_pin_is_asked_for_and_three_wrong_ones_bar_the_sim() -> None:
    async def test(host: Host) -> None:
        await host.says("AT+CMEE=1")
        assert "SIM PIN" in await host.says("AT+CPIN?")
        assert await host.says("AT+CMGL=4") == "\r\n+CMS ERROR: 311\r\n"
        assert await host.says("AT+CIMI") == "\r\n+CME ERROR: 11\r\n"
        assert await host.says('AT+CPIN="1111"') == "\r\n+CME ERROR: 16\r\n"
        assert "+SPIC: 2,10," in await host.says("AT+SPIC")
        assert await host.says('AT+CPIN="1111"') == "\r\n+CME ERROR: 16\r\n"
        assert await host.says('AT+CPIN="1111"') == "\r\n+CME ERROR: 12\r\n"
        assert "SIM PUK" in await host.says("AT+CPIN?")
        assert await host.says('AT+CPIN="1234"') == "\r\n+CME ERROR: 12\r\n"
        assert OK in await host.says('AT+CPIN="87654321","4321"')
        assert "READY" in await host.says("AT+CPIN?")
        assert "+CREG: 0,2" in await host.says("AT+CREG?")
        await asyncio.sleep(3.0)
        assert "+CREG: 0,1" in await host.says("AT+CREG?")

    with_host(test, sim=EmulatedSim(pin="1234", puk="87654321"))


def test_a_reset_forgets_what_was_told_and_says_when_it_is_back() -> None:
    async def test(host: Host) -> None:
        await host.says("AT+CMEE=1;+CMGF=1;+CREG=1")
        assert await host.says("AT+CFUN=1,1") == OK
        assert await host.says("AT") == ""
        assert "RDY" in await host.hears(4.0)
        assert await host.says("AT+CMGF?;+CREG?") == "AT+CMGF?;+CREG?\r\r\n+CMGF: 0\r\n\r\n+CREG: 0,2\r\n" + OK

    with_host(test)


def test_the_network_going_and_coming_is_told() -> None:
    async def test(host: Host) -> None:
        await host.says("AT+CREG=2")
        host.twin.apply(host.clock(), c.WorldNetwork(False))
        assert await host.hears(1.0) == "\r\n+CREG: 2\r\n"
        host.twin.apply(host.clock(), c.WorldNetwork(True))
        assert await host.hears(1.0) == '\r\n+CREG: 1,"1A2B","00C3"\r\n'

    with_host(test)


def test_a_text_comes_with_its_notice_and_lies_in_a_slot() -> None:
    async def test(host: Host) -> None:
        await host.says("AT+CNMI=2,1")
        host.twin.apply(host.clock(), c.WorldText(WORKER, "STOP"))
        assert await host.hears(5.0) == '\r\n+CMTI: "SM",1\r\n'
        told = (await host.says("AT+CMGR=1")).split("\r\n")
        assert told[1].startswith("+CMGR: 0,,")
        deliver = decode_deliver(told[2])
        assert (deliver.sender, deliver.text) == (WORKER, "STOP")
        assert "+CMGL: 1,1,," in await host.says("AT+CMGL=4")
        assert await host.says("AT+CMGD=1") == OK
        assert await host.says("AT+CMGL=4") == OK
        assert host.twin.texts(host.clock()) == ()

    with_host(test)


def test_without_a_network_nothing_comes_and_nothing_goes() -> None:
    async def test(host: Host) -> None:
        host.twin.apply(host.clock(), c.WorldNetwork(False))
        host.twin.apply(host.clock(), c.WorldText(WORKER, "STOP"))
        await asyncio.sleep(10.0)
        assert await host.says("AT+CMGL=4") == OK
        await host.says("AT+CMEE=1")
        pdu, octets = encode_submit(Submit(WORKER, "hello"))
        assert (await host.says(f"AT+CMGS={octets}")).endswith("\r\n> ")
        assert await host.says(pdu + "\x1a", 5.0) == "\r\n+CMS ERROR: 331\r\n"
        assert not host.twin.outbox
        host.twin.apply(host.clock(), c.WorldNetwork(True))
        await asyncio.sleep(2.0)
        assert "+CMGL: 1,0" in await host.says("AT+CMGL=4")

    with_host(test)


def test_a_full_store_leaves_texts_with_the_network_until_there_is_room() -> None:
    async def test(host: Host) -> None:
        for number in range(5):
            host.twin.apply(host.clock(), c.WorldText(WORKER, f"text {number}"))
        await asyncio.sleep(5.0)
        assert (await host.says("AT+CMGL=4")).count("+CMGL:") == 3
        assert "+CPMS: 3,3," in await host.says('AT+CPMS="SM","SM","SM"')
        await host.says("AT+CMGD=1")
        told = await host.says("AT+CMGL=4")
        assert told.count("+CMGL:") == 3
        await host.says("AT+CMGD=1,4")
        assert (await host.says("AT+CMGL=4")).count("+CMGL:") == 1
        assert len(host.twin.texts(host.clock())) == 5  # the twin's are taken with the last
        await host.says("AT+CMGD=1,4")
        assert host.twin.texts(host.clock()) == ()

    with_host(test, sim=EmulatedSim(texts=TextStore(3)))


def test_a_wrong_length_or_a_broken_pdu_is_not_sent() -> None:
    async def test(host: Host) -> None:
        pdu, octets = encode_submit(Submit(WORKER, "hello"))
        for length, body in ((octets + 1, pdu), (octets, pdu[:-2]), (octets, "zz"), (octets, "")):
            await host.says(f"AT+CMGS={length}")
            assert await host.says(body + "\x1a", 5.0) == "\r\n+CMS ERROR: 304\r\n"
        assert not host.twin.outbox

    with_host(test)


def test_escape_leaves_the_prompt_and_nothing_is_sent() -> None:
    async def test(host: Host) -> None:
        await host.says("AT+CMGS=20")
        assert await host.says("0011\x1b") == OK
        assert await host.says("AT") == OK
        assert not host.twin.outbox

    with_host(test)


def test_sending_takes_its_time_and_a_report_follows() -> None:
    async def test(host: Host) -> None:
        await host.says("AT+CNMI=2,1,0,1")
        pdu, octets = encode_submit(Submit(WORKER, "hello", report=True))
        await host.says(f"AT+CMGS={octets}")
        assert await host.says(pdu + "\x1a", 2.0) == ""
        assert await host.says("AT") == ""  # it has no time for anything else
        assert await host.hears(0.6) == "\r\n+CMGS: 1\r\n" + OK + OK
        assert [(sent.number, sent.text) for sent in host.twin.outbox] == [(WORKER, "hello")]
        head, body = (await host.hears(4.0)).strip().split("\r\n")
        assert head == f"+CDS: {len(body) // 2 - 1 - int(body[:2], 16)}"
        report = decode_status_report(body)
        assert (report.reference, report.number, report.delivered) == (1, WORKER, True)

    with_host(test)


@pytest.mark.parametrize(
    ("charset", "written"), [("GSM", "a\x00b"), ("IRA", "a@b"), ("UCS2", "006100400062"), ("HEX", "610062")]
)
def test_text_mode_reads_and_sends_in_its_character_set(charset: str, written: str) -> None:
    async def test(host: Host) -> None:
        host.twin.apply(host.clock(), c.WorldText(WORKER, "a@b"))
        await asyncio.sleep(5.0)
        await host.says(f'AT+CMGF=1;+CSCS="{charset}"')
        told = await host.says('AT+CMGL="ALL"')
        assert f'+CMGL: 1,"REC UNREAD","{WORKER}","","26/06/15,' in told
        assert f"\r\n{written}\r\n" in told
        assert (await host.says(f'AT+CMGS="{WORKER}"')).endswith("\r\n> ")
        assert "+CMGS: 1" in await host.says(written + "\x1a", 5.0)
        assert [(sent.number, sent.text) for sent in host.twin.outbox] == [(WORKER, "a@b")]

    with_host(test)


def test_a_call_rings_and_shows_its_number_if_wanted() -> None:
    async def test(host: Host) -> None:
        host._said.clear()
        host.modem.ring(WORKER)
        assert "".join(host._said) == "\r\nRING\r\n"
        await host.says("AT+CLIP=1")
        host._said.clear()
        host.modem.ring(WORKER)
        assert "".join(host._said) == f'\r\nRING\r\n\r\n+CLIP: "{WORKER}",145,"",0,"",0\r\n'

    with_host(test)


def test_awkward_notices_wait_for_an_echo_or_a_prompt() -> None:
    async def test(host: Host) -> None:
        host.modem.ring(WORKER)
        assert await host.hears(5.0) == ""
        assert await host.says("AT") == "AT\r\r\nRING\r\n" + OK
        pdu, octets = encode_submit(Submit(WORKER, "hello"))
        await host.says(f"AT+CMGS={octets}")
        host.modem.ring(WORKER)
        told = await host.says(pdu + "\x1a", 5.0)
        assert told == f"{pdu}\x1a\r\nRING\r\n\r\n+CMGS: 1\r\n" + OK

    with_host(test, awkward=True, echo=True)


def test_a_silent_line_hears_nothing_and_a_garbled_one_still_obeys() -> None:
    async def silent(host: Host) -> None:
        assert await host.says("AT") == ""

    async def garbled(host: Host) -> None:
        assert OK not in await host.says("AT+CMGF=1")
        assert host.modem.state.format == 1

    with_host(silent, "modem:off")
    with_host(garbled, "modem:garbage")


NAMES = ("+CPMS", "+CMGL", "+CMGR", "+CMGD", "+CNMI", "+CSMP", "+CPIN", "+COPS", "+CFUN", "+CSCA", "+CREG", "+CSCS")
WHOLE = st.builds(
    lambda name, rest: f"AT{name}{rest}\r".encode(), st.sampled_from(NAMES), st.text('?=,"0123456789SME;', max_size=12)
)
PIECES = st.sampled_from(
    [
        b"AT+",
        b"AT+CMGS=",
        b"AT+CMGF=1\r",
        b'AT+CMGS="',
        b"\x1a",
        b"\x1b",
        b"\r",
        b"AT+CMGW=3\r",
        b"0011",
        b'AT+CMGS="1"\r',
    ]
)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.one_of(st.binary(max_size=40), WHOLE, PIECES), max_size=30))
def test_no_bytes_bring_it_down(pieces: list[bytes]) -> None:
    async def test(host: Host) -> None:
        for piece in pieces:
            host.modem.receive(piece)
        await asyncio.sleep(30.0)
        for rescue in (b"\r", b"\x1b\r"):
            host.modem.receive(rescue)
            await asyncio.sleep(10.0)
        assert OK in await host.says("AT", 5.0)

    with_host(test)


@pytest.mark.parametrize("sender", ["", "Vodafone", "a name that is far too long", "имя", "1" * 30])
def test_any_sender_comes_through_in_some_way(sender: str) -> None:
    async def test(host: Host) -> None:
        host.twin.apply(host.clock(), c.WorldText(sender, "hello \ud83d " + "x" * 20_000))
        await asyncio.sleep(5.0)
        assert "+CMGL: 30," in await host.says("AT+CMGL=4")

    with_host(test)
