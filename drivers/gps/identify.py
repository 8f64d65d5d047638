"""Whether a receiver of positions is at the other end. Only listens: whatever is there, it is not written to."""

from __future__ import annotations

import time
from collections.abc import Callable

from drivers.errors import DeviceError, DeviceMissing, WrongDevice
from drivers.gps.epochs import POSITION_KINDS
from drivers.gps.looks import known, looks_like
from drivers.gps.sentence_reader import SentenceReader
from drivers.line import Line

FIRST_BYTE_S = 1.4  # a receiver at 1 Hz, and its burst
LISTEN_S = 1.6
WHOLE_S = 2.7
DOUBTED_BYTES = 300  # that make no sense: rather another baud rate
ENOUGH_BYTES = 160  # among which a sentence would be
KEPT_BYTES = 1024
BAUDS = (9600, 115_200, 38_400, 460_800, 57_600, 4800, 230_400, 19_200, 921_600)


def identify(line: Line, hear: Callable[[bytes], None]) -> None:
    """Return as soon as a sentence with a position kind has come; everything read goes to ``hear``.

    ``DeviceMissing``: silence. ``WrongDevice``: something else speaks here, or NMEA at another baud rate.
    """
    began_s = time.monotonic()
    reader = SentenceReader(line.settings.byte_s, capped=False)
    heard = b""
    while (spent_s := time.monotonic() - began_s) < LISTEN_S and (heard or spent_s < FIRST_BYTE_S):
        data = line.read_some((LISTEN_S if heard else FIRST_BYTE_S) - spent_s)
        hear(data)
        heard = (heard + data)[-KEPT_BYTES:]
        if any(sentence.kind in POSITION_KINDS for _, sentence in reader.feed(data, 0.0)):
            return
        if len(heard) >= DOUBTED_BYTES and not reader.statistics.sentences and known(heard) is None:
            break
    raise _error(line, reader, heard, began_s)


def _error(line: Line, reader: SentenceReader, heard: bytes, began_s: float) -> DeviceError:
    device, baud = line.settings.device, line.settings.baud
    expected = f"NMEA sentences with positions at {baud} baud"
    if not heard:
        return DeviceMissing(
            device, expected, "silence", "check power and cable, and that NMEA output is on for this port"
        )
    if reader.statistics.sentences:
        kinds = " ".join(sorted(reader.statistics.kinds))
        return WrongDevice(device, expected, f"sentences {kinds} only", "switch GGA and RMC on, or correct the port")
    right = _search(line, began_s)
    if right is not None:
        return WrongDevice(
            device,
            expected,
            f"NMEA at {right} baud",
            f"set baud to {right} in the configuration, or change the receiver's",
        )
    return WrongDevice(device, expected, looks_like(heard), "check which device is at this port, and its baud rate")


def _search(line: Line, began_s: float) -> int | None:
    """The baud rate at which NMEA is read here, None when it was not found in time. Sets the rate back."""
    try:
        for baud in BAUDS:
            if baud != line.settings.baud and _reads(line, baud, began_s + WHOLE_S):
                return baud
        return None
    finally:
        line.set_baud(line.settings.baud)


def _reads(line: Line, baud: int, deadline_s: float) -> bool:
    """Whether a sentence is among the next bytes at another rate; between bursts it waits for them."""
    if time.monotonic() >= deadline_s:
        return False
    line.set_baud(baud)
    line.drain()
    reader = SentenceReader(10.0 / baud, capped=False)
    while (left_s := deadline_s - time.monotonic()) > 0.0 and reader.statistics.bytes < ENOUGH_BYTES:
        reader.feed(line.read_some(left_s), 0.0)
        if reader.statistics.sentences:
            return True
    return False
