"""Sentences of one moment, put together: an epoch begins where the receiver's time changes."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, time, timedelta
from typing import TypeVar

from drivers.gps.nmea_sentences import Sentence
from drivers.gps.values import FixQuality

T = TypeVar("T")

DAY_S = 86_400.0
MODE_KEEPS_S = 10.0  # some receivers send GSA every few seconds only
LEARNED_AFTER = 3  # cycles that end alike

POSITION_KINDS = ("GGA", "GNS", "RMC", "GLL")  # the one that says most first
SIGMA_M = {  # per axis at HDOP 1, where the receiver does not say (GST); cautious
    FixQuality.SINGLE: 2.5,
    FixQuality.DGPS: 0.8,
    FixQuality.RTK_FLOAT: 0.25,
    FixQuality.RTK_FIXED: 0.02,
}


@dataclass(frozen=True, slots=True)
class Epoch:
    """What a receiver said of one moment. Without a position (quality NONE) what depends on it is None.

    ``mode``: 1 no fix, 2 2-D, 3 3-D. ``accuracy_m`` is one-sigma per axis. Angles clockwise from true north.
    ``began_s`` is when its first sentence came in; ``whole`` tells that no sentence before that can be missing.
    ``day_s`` is the receiver's time of the day, ``utc`` needs a date as well and may be wrong by the receiver's fault.
    """

    began_s: float
    whole: bool
    day_s: float | None
    utc: datetime | None
    quality: FixQuality
    mode: int
    latitude_deg: float | None
    longitude_deg: float | None
    altitude_m: float | None
    accuracy_m: float | None
    satellites: int | None
    hdop: float | None
    speed_m_s: float | None
    course_deg: float | None
    heading_deg: float | None
    correction_age_s: float | None


@dataclass(slots=True)
class _Parts:
    """The sentences of an epoch that is not complete."""

    began_s: float
    whole: bool
    day_s: float | None = None
    sentences: list[Sentence] = field(default_factory=list)

    @property
    def tells_position(self) -> bool:
        return any(sentence.kind in POSITION_KINDS for sentence in self.sentences)

    def has(self, sentence: Sentence) -> bool:
        return any(s.kind == sentence.kind and s.talker == sentence.talker for s in self.sentences)

    def of(self, kind: str) -> Sentence | None:
        """The last sentence of a kind."""
        return next((s for s in reversed(self.sentences) if s.kind == kind), None)

    @property
    def ending(self) -> tuple[str, str, int]:
        """Talker and kind of the last sentence, and the how-manieth of these it is."""
        last = self.sentences[-1]
        alike = sum(s.kind == last.kind and s.talker == last.talker for s in self.sentences)
        return last.talker, last.kind, alike


class EpochAssembler:
    """Takes sentences in order; gives each epoch when the next begins, when the line falls quiet, or, with ``learn``,
    with the sentence that has ended the last few.
    """

    def __init__(self, learn: bool = False) -> None:
        self._learn = learn
        self._parts: _Parts | None = None
        self._clean = False  # whether what comes next is a beginning
        self._done_day_s: float | None = None
        self._ending: tuple[str, str, int] | None = None
        self._endings_alike = 0
        self._date: date | None = None
        self._day_s = 0.0  # of the last epoch
        self._mode: int | None = None
        self._mode_age_s = 0.0

    def add(self, sentence: Sentence, arrived_s: float = 0.0) -> list[Epoch]:
        """The epochs that are complete now."""
        done: list[Epoch] = []
        if self._parts is not None and self._begins_another(sentence, self._parts):
            done += self._close()
        elif self._parts is None and sentence.day_s is not None and sentence.day_s == self._done_day_s:
            self._endings_alike = 0  # the cycle goes on after what was taken for its end
            return done
        if self._parts is None:
            self._parts = _Parts(arrived_s, self._clean)
        self._parts.sentences.append(sentence)
        if self._parts.day_s is None:
            self._parts.day_s = sentence.day_s
        if self._learn and self._endings_alike >= LEARNED_AFTER and self._parts.ending == self._ending:
            day_s = self._parts.day_s
            done += self._close()
            self._done_day_s = day_s
        return done

    def quiet(self) -> list[Epoch]:
        """The line has been silent for longer than within an epoch, or ends here."""
        self._done_day_s = None
        if self._parts is None or not self._parts.tells_position:
            self._clean = True
            return []
        return self._close()

    @staticmethod
    def _begins_another(sentence: Sentence, parts: _Parts) -> bool:
        if sentence.day_s is not None and parts.day_s is not None and sentence.day_s != parts.day_s:
            return True
        # a receiver without a clock, or with one that stands
        return sentence.kind in POSITION_KINDS and parts.has(sentence)

    def _close(self) -> list[Epoch]:
        parts, self._parts, self._clean, self._done_day_s = self._parts, None, True, None
        if parts is None:
            return []
        if parts.whole:
            self._endings_alike = self._endings_alike + 1 if parts.ending == self._ending else 1
            self._ending = parts.ending
        return [self._epoch(parts)] if parts.tells_position else []

    # --- what the sentences say together

    def _epoch(self, parts: _Parts) -> Epoch:
        utc = self._utc(parts)
        if parts.day_s is not None:
            self._mode_age_s += max(0.0, parts.day_s - self._day_s)
            self._day_s = parts.day_s
        quality = _quality(parts)
        places = [s for kind in POSITION_KINDS if (s := parts.of(kind)) is not None and s.latitude_deg is not None]
        mode = self._mode_of(parts, quality)
        if not places or mode == 1:
            quality, mode = FixQuality.NONE, 1
        fixed = quality is not FixQuality.NONE
        gga, rmc, vtg, gst = (parts.of(kind) for kind in ("GGA", "RMC", "VTG", "GST"))
        main = [s for s in (gga, parts.of("GNS")) if s is not None]
        hdop = _first(s.hdop for s in [*main, *_all(parts, "GSA")])
        heading = _first(s.heading_deg for kind in ("THS", "HDT") for s in _all(parts, kind))
        return Epoch(
            began_s=parts.began_s,
            whole=parts.whole,
            day_s=parts.day_s,
            utc=utc,
            quality=quality,
            mode=mode,
            latitude_deg=places[0].latitude_deg if fixed else None,
            longitude_deg=places[0].longitude_deg if fixed else None,
            altitude_m=_first(s.altitude_m for s in main) if fixed else None,
            accuracy_m=_accuracy_m(gst, quality, hdop) if fixed else None,
            satellites=_first(s.satellites for s in main) if main else _satellites_used(parts),
            hdop=hdop,
            speed_m_s=_first(s.speed_m_s for s in (rmc, vtg) if s is not None) if fixed else None,
            course_deg=_first(s.course_deg for s in (rmc, vtg) if s is not None) if fixed else None,
            heading_deg=heading,
            correction_age_s=_first(s.correction_age_s for s in main),
        )

    def _utc(self, parts: _Parts) -> datetime | None:
        """The date of the epoch's own sentences, else the last one, carried over midnight."""
        dated = [s for s in parts.sentences if s.date_given]
        day_s = parts.day_s
        if dated:
            self._date = next((s.date for s in reversed(dated) if s.date is not None), None)
        elif self._date is not None and day_s is not None and day_s < self._day_s - DAY_S / 2.0:
            self._date = self._date + timedelta(days=1) if self._date < date.max else None
        if day_s is None or self._date is None:
            return None
        try:
            return datetime.combine(self._date, time(), UTC) + timedelta(microseconds=round(day_s * 1e6))
        except OverflowError:
            return None

    def _mode_of(self, parts: _Parts, quality: FixQuality) -> int:
        """As gpsd reckons: a height makes it 3-D, whatever GSA says; else GSA; else the last."""
        told = [s.mode for s in _all(parts, "GSA") if s.mode is not None]
        if quality is FixQuality.NONE or (told and max(told) == 1):
            self._mode = None
            return 1
        main = [s for kind in ("GGA", "GNS") for s in _all(parts, kind)]
        if any(s.altitude_m is not None for s in main):
            mode = 3
        elif told:
            mode = max(told)
        elif self._mode is not None and self._mode_age_s <= MODE_KEEPS_S:
            return self._mode
        else:
            mode = 2
        self._mode, self._mode_age_s = mode, 0.0
        return mode


def _quality(parts: _Parts) -> FixQuality:
    """NONE as soon as one of the sentences says so."""
    told = {kind: s.quality for kind in POSITION_KINDS if (s := parts.of(kind)) is not None}
    if any(quality in (None, FixQuality.NONE) for quality in told.values()):
        return FixQuality.NONE
    return next((quality for quality in told.values() if quality is not None), FixQuality.NONE)


def _accuracy_m(gst: Sentence | None, quality: FixQuality, hdop: float | None) -> float:
    if gst is not None and gst.north_sigma_m is not None and gst.east_sigma_m is not None:
        return math.hypot(gst.north_sigma_m, gst.east_sigma_m) / math.sqrt(2.0)
    return SIGMA_M[quality] * max(1.0, hdop or 1.0)


def _satellites_used(parts: _Parts) -> int | None:
    told = [s.satellites for s in _all(parts, "GSA") if s.satellites is not None]
    return sum(told) if told else None


def _all(parts: _Parts, kind: str) -> list[Sentence]:
    return [s for s in parts.sentences if s.kind == kind]


def _first(values: Iterable[T | None]) -> T | None:
    return next((value for value in values if value is not None), None)
