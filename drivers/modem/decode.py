"""The bytes of a modem's port as text: a line for each command, answer and notice, and what PDUs hold."""

from __future__ import annotations

import re
from collections.abc import Callable

from drivers.byte_trace import Direction
from drivers.modem.at_channel import AtRefused, without_secrets
from drivers.modem.at_words import ERROR_TABLES
from drivers.modem.pdu import decode_deliver, decode_status_report, decode_submit
from drivers.modem.user_data import Part
from drivers.trace_decoder import Wrong

LONGEST_LINE_BYTES = 4096
SHOWN_BYTES = 16
_WITH_BODY = ("+CMGL:", "+CMGR:", "+CMT:", "+CDS:")
_ENDS_OUT = re.compile(rb"[\r\x1a\x1b]")
_HEX = re.compile(r"([0-9A-Fa-f]{2}){8,}")
_PRINTABLE = re.compile(rb"[\x20-\x7e\x80-\xff]*")


class AtDecoder:
    """Fed with the chunks of a trace in order. What a chunk leaves incomplete is shown with a later one."""

    def __init__(self) -> None:
        self._held: dict[Direction, bytearray] = {"out": bytearray(), "in": bytearray()}
        self._wants_body = False

    def feed(self, direction: Direction, data: bytes) -> list[str]:
        """The lines for what is complete now; "out" is from the host, "in" to it."""
        held = self._held[direction]
        held += data
        lines = self._from_host(held) if direction == "out" else self._to_host(held)
        if len(held) > LONGEST_LINE_BYTES:
            lines.append(_no_line(bytes(held)))
            held.clear()
        return lines

    def rest(self) -> list[str]:
        """What never was completed."""
        return [Wrong(f"incomplete: {_shown(bytes(held))}") for held in self._held.values() if held.strip()]

    def _from_host(self, held: bytearray) -> list[str]:
        lines: list[str] = []
        while match := _ENDS_OUT.search(held):
            text, end = bytes(held[: match.start()]), match[0]
            del held[: match.end()]
            if end == b"\x1b":
                lines += [f"{_shown(text)}, given up (ESC)" if text.strip() else "ESC"]
            elif end == b"\x1a":
                lines.append(_pdu(_shown(text), decode_submit_text))
            elif text.strip():
                lines.append(without_secrets(_shown(text.strip())))
        return lines

    def _to_host(self, held: bytearray) -> list[str]:
        lines: list[str] = []
        while (end := held.find(b"\n")) >= 0:
            raw = bytes(held[:end])
            del held[: end + 1]
            if text := raw.strip(b"\r\0 "):
                lines.append(self._said(text))
        if held.lstrip(b"\r\0") == b"> ":
            held.clear()
            lines.append("> (waits for a text)")
        return lines

    def _said(self, raw: bytes) -> str:
        if not _PRINTABLE.fullmatch(raw.rstrip(b"\x1a")):
            return _no_line(raw)
        text = without_secrets(_shown(raw.rstrip(b"\x1a")))
        wants_body, self._wants_body = self._wants_body, text.startswith(_WITH_BODY)
        if wants_body and _HEX.fullmatch(text):
            return _pdu(text, decode_received_text)
        if text == "ERROR":
            return Wrong(text)
        if text.partition(":")[0] in ERROR_TABLES:
            return Wrong(f"{text}   {AtRefused('', text).found}")
        return text


def decode_submit_text(pdu: str) -> str:
    """A text to the network, in words."""
    submit = decode_submit(pdu)
    more = ", report wanted" if submit.report else ""
    return f"SUBMIT to {submit.number}{_of(submit.part)}, {submit.alphabet.value}{more}: {submit.text!r}"


def decode_received_text(pdu: str) -> str:
    """What a modem gives out: a text from the network, a report, or a draft. ``ValueError`` when it is none."""
    try:
        deliver = decode_deliver(pdu)
    except ValueError as error:
        for decode in (_report_text, decode_submit_text):
            try:
                return decode(pdu)
            except ValueError:
                continue
        raise error
    sent = "without a stamp" if deliver.sent_utc is None else f"sent {deliver.sent_utc:%Y-%m-%dT%H:%M:%SZ}"
    return f"DELIVER from {deliver.sender}{_of(deliver.part)}, {deliver.alphabet.value}, {sent}: {deliver.text!r}"


def _report_text(pdu: str) -> str:
    report = decode_status_report(pdu)
    fate = "delivered" if report.delivered else "not delivered" if report.final else "still tried"
    return f"STATUS-REPORT {report.reference} for {report.number}: {fate} (0x{report.status:02x})"


def _of(part: Part | None) -> str:
    return "" if part is None else f", part {part.number} of {part.total} (reference {part.reference})"


def _pdu(text: str, decode: Callable[[str], str]) -> str:
    try:
        return f"{decode(text.strip())}   {text}"
    except ValueError as error:
        return Wrong(f"BAD PDU ({error})   {text}")


def _no_line(raw: bytes) -> str:
    more = " ..." if len(raw) > SHOWN_BYTES else ""
    return Wrong(f"{len(raw)} bytes that are no line: {raw[:SHOWN_BYTES].hex(' ')}{more}")


def _shown(raw: bytes) -> str:
    """Printable on one line, whatever it holds."""
    text = raw.decode("latin-1")
    return text if text.isprintable() else repr(text)[1:-1]
