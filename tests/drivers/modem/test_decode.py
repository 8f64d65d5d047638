"""A modem's trace in words."""

from __future__ import annotations

from datetime import UTC, datetime

from hypothesis import given
from hypothesis import strategies as st

from drivers.modem.decode import AtDecoder
from drivers.modem.pdu import Deliver, StatusReport, Submit, encode_deliver, encode_status_report, encode_submit
from drivers.modem.user_data import Alphabet, Part
from drivers.trace_decoder import Wrong

SENT = datetime(2026, 6, 15, 10, 0, tzinfo=UTC)


def test_a_sent_text_is_shown_with_its_number_and_part() -> None:
    decoder = AtDecoder()
    pdu, octets = encode_submit(Submit("+4917012345", "Tank leer €", Alphabet.UCS2, Part(7, 3, 2), report=True))
    assert decoder.feed("out", f"AT+CMGS={octets}\r".encode()) == [f"AT+CMGS={octets}"]
    assert decoder.feed("in", b"\r\n> ") == ["> (waits for a text)"]
    (line,) = decoder.feed("out", pdu.encode() + b"\x1a")
    assert line.startswith(
        "SUBMIT to +4917012345, part 2 of 3 (reference 7), ucs2, report wanted: 'Tank leer €'   " + pdu
    )
    assert decoder.feed("in", b"\r\n+CMGS: 11\r\n\r\nOK\r\n") == ["+CMGS: 11", "OK"]
    assert decoder.rest() == []


def test_received_texts_and_reports_are_shown() -> None:
    decoder = AtDecoder()
    pdu, octets = encode_deliver(Deliver("+4917012345", "STOP", SENT))
    head, line = decoder.feed("in", f"\r\n+CMT: ,{octets}\r\n{pdu}\r\n".encode())
    assert head == f"+CMT: ,{octets}"
    assert line.startswith("DELIVER from +4917012345, gsm7, sent 2026-06-15T10:00:00Z: 'STOP'")
    report, octets = encode_status_report(StatusReport(11, "+4917012345", 0, SENT, SENT))
    _, line = decoder.feed("in", f"\r\n+CDS: {octets}\r\n{report}\r\n".encode())
    assert line.startswith("STATUS-REPORT 11 for +4917012345: delivered (0x00)")


def test_refusals_and_broken_pdus_are_wrong() -> None:
    decoder = AtDecoder()
    lines = decoder.feed("in", b"\r\n+CMS ERROR: 331\r\n\r\nERROR\r\n\r\n+CMGR: 0,,28\r\n0004FF91710000000000\r\n")
    assert [isinstance(line, Wrong) for line in lines] == [True, True, False, True]
    assert "no network service" in lines[0]
    assert "BAD PDU" in lines[3]
    (line,) = decoder.feed("in", b"\x01\x02\xff\r\n")
    assert isinstance(line, Wrong)
    assert "01 02 ff" in line


def test_a_pin_is_not_shown_neither_as_command_nor_as_echo() -> None:
    decoder = AtDecoder()
    shown = [*decoder.feed("out", b'AT+CPIN="1234"\r'), *decoder.feed("in", b'AT+CPIN="1234"\r\r\nOK\r\n')]
    assert shown == ["AT+CPIN=...", "AT+CPIN=...", "OK"]


def test_what_is_left_over_is_told() -> None:
    decoder = AtDecoder()
    assert decoder.feed("out", b"AT+C") == []
    assert decoder.feed("in", b"\r\n+CS") == []
    assert decoder.rest() == [Wrong("incomplete: AT+C"), Wrong("incomplete: +CS")]


CHUNKS = st.one_of(st.binary(max_size=80), st.binary(max_size=20).map(lambda data: data + b"\r\n"))


@given(st.lists(st.tuples(st.sampled_from(["out", "in"]), CHUNKS), max_size=30))
def test_any_bytes_give_printable_lines(chunks: list[tuple[str, bytes]]) -> None:
    decoder = AtDecoder()
    for direction, data in chunks:
        for line in decoder.feed(direction, data):  # type: ignore[arg-type]
            assert line.isprintable()
    assert all(line.isprintable() for line in decoder.rest())


@given(st.binary(max_size=200), st.lists(st.integers(1, 20), max_size=30))
def test_bytes_split_anyhow_give_the_same_lines(data: bytes, cuts: list[int]) -> None:
    whole, pieces = AtDecoder(), AtDecoder()
    lines: list[str] = []
    at = 0
    for cut in cuts:
        lines += pieces.feed("out", data[at : at + cut])
        at += cut
    lines += pieces.feed("out", data[at:])
    assert lines == whole.feed("out", data)
