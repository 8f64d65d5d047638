"""The bytes of a receiver's port as text: a line for each sentence or correction, and for what is neither."""

from __future__ import annotations

from dataclasses import fields
from typing import Literal

from drivers.gps.framing import Framer
from drivers.gps.nmea_sentences import BadSentence, Sentence, parse
from drivers.gps.rtcm import RtcmFramer, message_number
from drivers.gps.values import FixQuality
from drivers.trace_decoder import Wrong

SHOWN_BYTES = 16


class NmeaDecoder:
    """Fed with the chunks of a trace in order. What a chunk leaves incomplete is shown with a later one."""

    def __init__(self) -> None:
        self._in, self._out = Framer(), RtcmFramer()

    def feed(self, direction: Literal["out", "in"], data: bytes) -> list[str]:
        """The lines for what is complete now; "in" is from the receiver, "out" are corrections to it."""
        return self._from_receiver(data) if direction == "in" else self._to_receiver(data)

    def rest(self) -> list[str]:
        """What never was completed."""
        held = self._in.held
        return [Wrong(f"incomplete: {held.decode('ascii')}")] if held else []

    def _from_receiver(self, data: bytes) -> list[str]:
        whole = self._in.held + data
        earlier = len(self._in.held)
        lines, end = [], 0
        for place, frame in self._in.feed(data):
            begin = place + earlier
            lines += _stray(whole[end:begin])
            end = begin + len(frame)
            try:
                lines.append(f"{_said(parse(frame))}   {frame.decode('ascii')}")
            except BadSentence as error:
                lines.append(Wrong(f"BAD {error}"))
        return lines + _stray(whole[end : len(whole) - len(self._in.held)])

    def _to_receiver(self, data: bytes) -> list[str]:
        before = self._out.statistics.stray_bytes
        lines: list[str] = [f"RTCM {message_number(frame)}, {len(frame)} bytes" for frame in self._out.feed(data)]
        stray = self._out.statistics.stray_bytes - before
        return lines + ([Wrong(f"{stray} bytes that are no RTCM frame")] if stray else [])


def _stray(data: bytes) -> list[str]:
    data = data.strip(b"\r\n")
    if not data:
        return []
    more = " ..." if len(data) > SHOWN_BYTES else ""
    return [Wrong(f"{len(data)} bytes that are no sentence: {data[:SHOWN_BYTES].hex(' ')}{more}")]


def _said(sentence: Sentence) -> str:
    """Kind, and the fields that are told."""
    told = []
    for field in fields(sentence):
        value = getattr(sentence, field.name)
        if field.name in ("talker", "kind", "date_given") or value is None:
            continue
        if isinstance(value, FixQuality):
            value = value.name.lower()
        told.append(f"{field.name}={value:.9g}" if isinstance(value, float) else f"{field.name}={value}")
    return " ".join([sentence.talker + sentence.kind, *told])
