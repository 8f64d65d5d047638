"""What bytes look like that are no NMEA, for the person who has to find the mistake."""

from __future__ import annotations

import re

_MARKS: tuple[tuple[re.Pattern[bytes], str], ...] = (
    (re.compile(rb"\xff\xff\xfd\x00"), "Dynamixel packets (an arm)"),
    (re.compile(rb"\xb5\x62[\x01-\x29]"), "u-blox binary messages (UBX); switch NMEA output on for this port"),
    (re.compile(rb"\xd3[\x00-\x03][\x00-\xff]"), "RTCM corrections; this is not the port for positions"),
    (re.compile(rb"\$@[\x00-\xff]{4}"), "Septentrio binary blocks (SBF); switch NMEA output on for this port"),
    (re.compile(rb"\xa0\xa2[\x00-\x07]"), "SiRF binary messages; switch the receiver to NMEA"),
    (re.compile(rb"![A-Z]{5},"), "AIS messages of a ship's radio"),
    (re.compile(rb"(?m)^(\+C[A-Z]{2,4}: |OK\r|ERROR\r|RING\r|\^[A-Z]+:)"), "answers of a modem"),
    (re.compile(rb"\$[A-Z]{2}[A-Z]{3},[^\r\n*]*\r?\n"), "NMEA without checksums; switch checksums on"),
)


def looks_like(data: bytes) -> str:
    """A few words for a heap of bytes."""
    if not data:
        return "silence"
    return known(data) or f"{len(data)} bytes that make no sense ({data[:8].hex(' ')} ...)"


def known(data: bytes) -> str | None:
    """A few words for a heap of bytes, None for one that makes no sense, as at a wrong baud rate."""
    for mark, words in _MARKS:
        if mark.search(data):
            return words
    lines = [line.decode("ascii") for line in data.splitlines() if line.isascii() and line.decode().isprintable()]
    if sum(len(line) + 2 for line in lines) > 0.5 * len(data):
        return f"text: {max(lines, key=len)[:40]!r}"
    return None
