"""Bytes of a receiver into sentences, each with the moment at which its first bit was sent."""

from __future__ import annotations

from dataclasses import dataclass, field

from drivers.gps.framing import Framer
from drivers.gps.nmea_sentences import BadSentence, Sentence, parse

MOST_A_SECOND = 1500.0  # what fits through 1 Mbaud
MOST_AT_ONCE = 300.0


@dataclass(slots=True)
class ReaderStatistics:
    """``refused`` frames came faster than any receiver sends; they were not looked at."""

    bytes: int = 0
    sentences: int = 0
    bad_sentences: int = 0
    refused: int = 0
    kinds: set[str] = field(default_factory=set)
    last_bad: str = ""


class SentenceReader:
    """``byte_s`` is the time of a byte on the wire. ``capped``: takes no more than a receiver can send in the time, so
    that it costs bounded time whatever comes; memory is bounded in any case.
    """

    def __init__(self, byte_s: float, capped: bool = True) -> None:
        self.statistics = ReaderStatistics()
        self.last_gga = b""  # as it came, with a position
        self._byte_s, self._capped = byte_s, capped
        self._framer = Framer()
        self._held_since_s = 0.0
        self._allowed = MOST_AT_ONCE
        self._allowed_at_s = 0.0

    def feed(self, data: bytes, arrived_s: float) -> list[tuple[float, Sentence]]:
        """Sentences whose checksum is right, with the moments of their beginnings; ``data`` is there since now."""
        self.statistics.bytes += len(data)
        found = []
        for place, frame in self._framer.feed(data):
            if self._capped and not self._allows(arrived_s):
                self.statistics.refused += 1
                continue
            try:
                sentence = parse(frame)
            except BadSentence as error:
                self.statistics.bad_sentences += 1
                self.statistics.last_bad = str(error)
                continue
            began_s = self._held_since_s if place < 0 else arrived_s - (len(data) - place) * self._byte_s
            found.append((began_s, sentence))
            if sentence.kind == "GGA" and sentence.latitude_deg is not None:
                self.last_gga = frame
            if len(self.statistics.kinds) < 50:
                self.statistics.kinds.add(sentence.talker + sentence.kind)
        self.statistics.sentences += len(found)
        held = len(self._framer.held)
        if 0 < held <= len(data):
            self._held_since_s = arrived_s - held * self._byte_s
        return found

    def _allows(self, now_s: float) -> bool:
        gained = max(0.0, now_s - self._allowed_at_s) * MOST_A_SECOND
        self._allowed, self._allowed_at_s = min(MOST_AT_ONCE, self._allowed + gained), now_s
        if self._allowed < 1.0:
            return False
        self._allowed -= 1.0
        return True
