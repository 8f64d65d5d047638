"""What a modem says, whatever it says: lines by class, notices anywhere, transcripts of five clients."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.modem.at_channel import AtRefused
from drivers.modem.at_parser import LONGEST_LINE_BYTES, AtParser, Dialogue, Notice
from drivers.modem.at_words import signal_dbm

SHARED = Path(os.environ.get("SPRAYER_SHARED", Path(__file__).parents[4] / "shared"))
VECTORS = SHARED / "data" / "vectors"
needs_vectors = pytest.mark.skipif(not VECTORS.is_dir(), reason=f"no transcripts at {VECTORS} (SPRAYER_SHARED)")
TRANSCRIPTS = ("gammu", "smstools", "python-gsmmodem", "chat_gnokii")

PDU = "07917283010010F5040BC87238880900F10000993092516195800AE8329BFD4697D9EC37"
NOTICES = (
    '+CMTI: "SM",1', "RING", '+CLIP: "+491700000000",145,"",0,"",0', "+CREG: 2", '+CREG: 1,"1A2B","00C3"',
    "NO CARRIER", "Call Ready", "SMS Ready", "RDY", "+CFUN: 1", "UNDER-VOLTAGE WARNNING", "NORMAL POWER DOWN",
    f"+CMT: ,24\r\n{PDU}", f"+CDS: 25\r\n{PDU}",
)  # fmt: skip


def heard(
    *chunks: bytes, running: tuple[str, str | None, str | None] | None = None
) -> tuple[Dialogue | None, list[Notice]]:
    notices: list[Notice] = []
    parser = AtParser(notices.append)
    dialogue = parser.begin(*running) if running else None
    for chunk in chunks:
        parser.feed(chunk)
    return dialogue, notices


def test_an_answer_with_its_echo() -> None:
    dialogue, notices = heard(b"AT+CSQ\r\r\n+CSQ: 21,0\r\n\r\nOK\r\n", running=("AT+CSQ", "+CSQ", None))
    assert dialogue == Dialogue("AT+CSQ", "+CSQ", echoed=True, lines=["+CSQ: 21,0"], final="OK")
    assert not notices


def test_an_answer_without_a_prefix() -> None:
    dialogue, _ = heard(b"\r\nSIMCOM_SIM800L\r\n\r\nOK\r\n", running=("AT+CGMM", None, None))
    assert dialogue is not None
    assert dialogue.lines == ["SIMCOM_SIM800L"]


@pytest.mark.parametrize("notice", NOTICES)
def test_a_notice_between_echo_and_result_is_no_part_of_the_answer(notice: str) -> None:
    said = b"AT+CMGL=4\r\r\n" + notice.encode() + b"\r\n\r\n+CMGL: 1,0,,28\r\n" + PDU.encode() + b"\r\n\r\nOK\r\n"
    dialogue, notices = heard(said, running=("AT+CMGL=4", "+CMGL", None))
    assert dialogue is not None
    assert dialogue.final == "OK"
    assert dialogue.lines == ["+CMGL: 1,0,,28", PDU]
    assert ["\r\n".join(filter(None, (each.line, each.body))) for each in notices] == [notice]


@pytest.mark.parametrize("notice", NOTICES)
def test_a_notice_between_prompt_and_reference_is_no_part_of_the_answer(notice: str) -> None:
    running = ("AT+CMGS=36", "+CMGS", "0011FF")
    said = b"\r\n> \r\n" + notice.encode() + b"\r\n0011FF\x1a\r\n+CMGS: 11\r\n\r\nOK\r\n"
    dialogue, notices = heard(said, running=running)
    assert dialogue is not None
    assert dialogue.prompted
    assert (dialogue.lines, dialogue.final) == (["+CMGS: 11"], "OK")
    assert len(notices) == 1


def test_a_prompt_needs_no_end_of_line_and_may_come_in_two() -> None:
    dialogue, _ = heard(b"AT+CMGS=36\r\r\n>", b" ", running=("AT+CMGS=36", "+CMGS", "0011"))
    assert dialogue is not None
    assert dialogue.prompted
    assert dialogue.final is None


def test_a_registration_that_nobody_asked_for_does_not_answer_the_question() -> None:
    said = b'\r\n+CREG: 2\r\n\r\n+CREG: 1,"1A2B","00C3"\r\n\r\n+CREG: 2,1,"1A2B","00C3"\r\n\r\nOK\r\n'
    dialogue, notices = heard(said, running=("AT+CREG?", "+CREG", None))
    assert dialogue is not None
    assert dialogue.lines == ['+CREG: 2,1,"1A2B","00C3"']
    assert [notice.line for notice in notices] == ["+CREG: 2", '+CREG: 1,"1A2B","00C3"']


def test_the_end_of_somebody_elses_call_is_not_the_end_of_a_command() -> None:
    dialogue, notices = heard(b"\r\nNO CARRIER\r\n\r\n+CSQ: 9,0\r\n\r\nOK\r\n", running=("AT+CSQ", "+CSQ", None))
    assert dialogue is not None
    assert (dialogue.lines, dialogue.final) == (["+CSQ: 9,0"], "OK")
    assert [notice.line for notice in notices] == ["NO CARRIER"]


def test_a_notice_torn_from_its_pdu_is_told_without_it() -> None:
    _, notices = heard(b"\r\n+CDS: 25\r\n\r\nRING\r\n")
    assert notices == [Notice("+CDS: 25"), Notice("RING")]


@pytest.mark.parametrize(
    ("final", "code", "words"),
    [
        ("ERROR", None, "ERROR"),
        ("+CME ERROR: 10", 10, "SIM not inserted"),
        ("+CME ERROR: SIM PIN required", 11, "SIM PIN required"),
        ("+CMS ERROR: 331", 331, "no network service"),
        ("+CMS ERROR: 4711", 4711, "not in the standard"),
        ("+CME ERROR: whatever", None, "whatever"),
    ],
)
def test_errors_are_told_in_words(final: str, code: int | None, words: str) -> None:
    refused = AtRefused("AT+CPIN?", final)
    assert refused.code == code
    assert words in str(refused)


def test_a_pin_stands_in_no_error() -> None:
    assert "1234" not in str(AtRefused('AT+CPIN="1234"', "+CME ERROR: 16"))


@pytest.mark.parametrize(
    ("rssi", "dbm"), [(0, -113), (21, -71), (31, -51), (99, None), (100, -116), (191, -25), (199, None)]
)
def test_signal_strength(rssi: int, dbm: float | None) -> None:
    assert signal_dbm(rssi) == dbm


def answered_with(command: str) -> str | None:
    """The prefix of the answer; None for maker, model and numbers."""
    name = command[2:].partition("=")[0].partition(";")[0].rstrip("?")
    return None if name in ("+CGMI", "+CGMM", "+CGMR", "+CGSN", "+GMM", "+CIMI", "") else name


@needs_vectors
@pytest.mark.parametrize("client", TRANSCRIPTS)
def test_the_answers_of_a_recorded_session_end_each_command(client: str) -> None:
    parser = AtParser(lambda notice: None)
    commands = 0
    dialogue: Dialogue | None = None
    for text in (VECTORS / f"at_transcript_{client}_vs_scratch_modem.jsonl").read_text().splitlines():
        line = json.loads(text)
        if line["dir"] == "host" and line["s"].startswith("AT"):
            assert dialogue is None or dialogue.final is not None
            command = line["s"]
            dialogue = parser.begin(command, answered_with(command), "00" if "CMGS=" in command else None)
            commands += 1
        if line["dir"] != "modem":
            continue
        parser.feed(line["s"].encode("latin-1"))
        assert dialogue is not None
        if line["s"].endswith("> "):
            assert dialogue.prompted
            assert dialogue.final is None
        else:
            assert dialogue.final in ("OK", "ERROR")
            expected = [each for each in line["s"].split("\r\n") if each][:-1]
            assert dialogue.lines == expected
    assert commands > 10
    assert parser.strange_lines == 0


@needs_vectors
def test_the_published_notices_are_known() -> None:
    told = next(entry for entry in json.loads((VECTORS / "at_transcripts.json").read_text()) if entry["name"] == "URCs")
    notices: list[Notice] = []
    parser = AtParser(notices.append)
    parser.begin("AT+CSQ", "+CSQ")
    for line in told["lines"]:
        parser.feed(f"\r\n{line}\r\n".encode())
        if line.startswith(("+CMT", "+CDS")) and '"' not in line:
            parser.feed(PDU.encode() + b"\r\n")
    assert [notice.line for notice in notices] == told["lines"]
    assert parser.strange_lines == 0


GARBAGE = st.one_of(
    st.binary(max_size=60),
    st.sampled_from(
        [b"\r\n", b"> ", b"\r\nOK\r\n", b"\r\n+CDS: 25\r\n", b"+CMGL: 1,0,,28\r\n", PDU.encode(), b"\x1b\x1a"]
    ),
)


@given(st.lists(GARBAGE, max_size=20), st.lists(st.integers(1, 50), max_size=50), st.booleans())
def test_any_bytes_split_anyhow_are_taken_alike(pieces: list[bytes], cuts: list[int], prompts: bool) -> None:
    data = b"".join(pieces)
    running = ("AT+CMGL=4", "+CMGL", "0011" if prompts else None)
    chunks, at = [], 0
    for cut in cuts:
        chunks.append(data[at : at + cut])
        at += cut
    chunks.append(data[at:])
    assert heard(data, running=running) == heard(*chunks, running=running)


@given(st.lists(GARBAGE, max_size=20))
def test_an_answer_after_garbage_is_found(pieces: list[bytes]) -> None:
    data = b"".join(pieces)
    parser = AtParser(lambda notice: None)
    parser.begin("AT")
    parser.feed(data + b"\r\n")
    parser.end()
    dialogue = parser.begin("AT+CSQ", "+CSQ")
    parser.feed(b"\r\nRING\r\n\r\n+CSQ: 21,0\r\n\r\nOK\r\n")
    assert (dialogue.lines, dialogue.final) == (["+CSQ: 21,0"], "OK")


def test_memory_stays_bounded() -> None:
    parser = AtParser(lambda notice: None)
    dialogue = parser.begin("AT+CGMI")
    for _ in range(300):
        parser.feed(b"x" * 1000)
        assert len(parser.half_line) <= LONGEST_LINE_BYTES + 1000
    for _ in range(5000):
        parser.feed(b"\r\nline\r\n")
    assert len(dialogue.lines) <= 2048
    assert parser.strange_lines > 0
