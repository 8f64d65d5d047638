"""A GPS receiver behind its wire: the fixes of the twin as NMEA sentences, corrections as they come in."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import timedelta
from typing import Literal

from drivers.emulation.bad_line import BadLine
from drivers.gps import sentence_text as text
from drivers.gps.rtcm import RtcmFramer, RtcmStatistics
from drivers.gps.values import Fix, FixQuality
from drivers.twin import commands as c
from drivers.twin.bus import STALE_S
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin
from drivers.twin.receiver import OUTPUT_DELAY_S

Kind = Literal["RMC", "GGA", "VTG", "GSA", "GST", "HDT"]

FIXED_FOR_S = 10.0  # after the last correction
FLOAT_FOR_S = 60.0


@dataclass(frozen=True, slots=True)
class EmulatedReceiver:
    """What the receiver sends of each epoch, in order. ``needs_corrections``: its RTK lives on RTCM that comes in.

    Epochs for which ``baud`` leaves no time are dropped, as receivers do.
    """

    talker: str = "GN"
    kinds: tuple[Kind, ...] = ("RMC", "GGA", "VTG", "GSA", "GST")
    needs_corrections: bool = False
    baud: int = 115_200


class GpsEmulator:
    """On the event loop; ``serve`` sends until it is cancelled. ``clock`` gives loop time."""

    def __init__(self, twin: Twin, clock: Callable[[], float], settings: EmulatedReceiver | None = None) -> None:
        self._twin, self._clock = twin, clock
        self._settings = settings or EmulatedReceiver()
        self._line: BadLine | None = None
        self._rtcm = RtcmFramer()
        self._corrected_s: float | None = None
        self._quality = twin.nominal.gps_quality
        self._frozen: Fix | None = None
        self._free_s = 0.0  # when the last burst is through
        self.dropped_epochs = 0

    @property
    def corrections(self) -> RtcmStatistics:
        """What came in."""
        return self._rtcm.statistics

    def connect(self, line: BadLine) -> None:
        self._line = line

    def receive(self, data: bytes) -> None:
        if self._line is not None and self._line.hears and self._rtcm.feed(data):
            self._corrected_s = self._clock()

    async def serve(self) -> None:
        while True:
            epoch_s = self._twin.next_epoch_s(self._clock())
            await asyncio.sleep(epoch_s - self._clock())
            if self._line is not None:
                self._send(self._line, self._read(epoch_s), epoch_s)

    def _read(self, epoch_s: float) -> Fix:
        """The fix of an epoch; its time is the epoch's to the microsecond, as in a receiver."""
        now_s = self._clock()
        self._live_on_corrections(now_s)
        fix = self._twin.fix(now_s)
        utc = None if fix.utc is None else fix.utc - timedelta(seconds=now_s - epoch_s)
        if self._twin.verb("gps", now_s) is not Verb.STUCK:
            self._frozen = None
            return replace(fix, utc=utc)
        self._frozen = self._frozen or fix
        return replace(self._frozen, utc=utc)

    def _live_on_corrections(self, now_s: float) -> None:
        if not self._settings.needs_corrections:
            return
        age_s = self._correction_age_s(now_s)
        best = self._twin.nominal.gps_quality
        if age_s is None or age_s > FLOAT_FOR_S:
            quality = min(best, FixQuality.SINGLE)
        else:
            quality = best if age_s <= FIXED_FOR_S else min(best, FixQuality.RTK_FLOAT)
        if quality is not self._quality or age_s is None:
            self._quality = quality
            self._twin.apply(now_s, c.WorldGpsQuality(int(quality)))

    def _correction_age_s(self, now_s: float) -> float | None:
        return None if self._corrected_s is None else now_s - self._corrected_s

    def _send(self, line: BadLine, fix: Fix, epoch_s: float) -> None:
        begin_s = epoch_s + OUTPUT_DELAY_S + (STALE_S if line.verb is Verb.DELAYED else 0.0)
        if self._free_s > begin_s + 1.0 / self._twin.nominal.gps_rate_hz:
            self.dropped_epochs += 1
            return
        sentences = self._sentences(fix)
        self._free_s = max(begin_s, self._free_s) + sum(map(len, sentences)) * 10.0 / self._settings.baud
        for sentence in sentences:
            line.say(sentence, max(0.0, begin_s - self._clock()))

    def _sentences(self, fix: Fix) -> list[bytes]:
        talker, age_s = self._settings.talker, self._correction_age_s(self._clock())
        write: dict[Kind, Callable[[], bytes]] = {
            "RMC": lambda: text.rmc(talker, fix),
            "GGA": lambda: text.gga(talker, fix, age_s),
            "VTG": lambda: text.vtg(talker, fix),
            "GSA": lambda: text.gsa(talker, fix),
            "GST": lambda: text.gst(talker, fix),
            "HDT": lambda: text.hdt(talker, fix),
        }
        return [write[kind]() for kind in self._settings.kinds]
