"""Texts on their way from the modem's store to the one who receives them; none leaves the store before it got there."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime

from drivers.modem.concatenation import LONGEST_CHARACTERS, Joiner
from drivers.modem.pdu import Deliver, decode_deliver
from drivers.modem.user_data import Alphabet, joined_text
from drivers.modem.values import RejectedText, Sms

UNKNOWN_SENT_UTC = datetime(1970, 1, 1, tzinfo=UTC)  # a text without a stamp is as old as can be
MOST_DIRECT = 100
MOST_REJECTED = 100
SPARE_SLOTS = 2
_RECEIVED = (0, 1)  # unread and read; the others are drafts


@dataclass(frozen=True, slots=True)
class Stored:
    """One slot of the modem's store. ``state`` as ``+CMGL`` tells it: 0, 1 received; 2, 3 drafts."""

    slot: int
    state: int
    pdu: str


class Inbox:
    """Known by their PDUs, so that a slot that is used again or a store that is listed twice does no harm."""

    def __init__(self, parts_keep_s: float) -> None:
        self._joiner: Joiner[str] = Joiner(parts_keep_s)
        self._ready: list[tuple[Sms, tuple[str, ...]]] = []
        self._known: set[str] = set()
        self._done: set[str] = set()
        self._direct: deque[str] = deque(maxlen=MOST_DIRECT)
        self._rejected: deque[RejectedText] = deque(maxlen=MOST_REJECTED)

    @property
    def deletable(self) -> frozenset[str]:
        """PDUs that may leave the store."""
        return frozenset(self._done)

    def update(self, stored: Iterable[Stored], capacity: int | None, now_s: float) -> None:
        """The whole store as it is. When it is full, parts are kept in memory alone and drafts go, for new texts."""
        slots = tuple(stored)
        present = {entry.pdu for entry in slots}
        self._known &= present
        self._done &= present
        for entry in slots:
            if entry.state in _RECEIVED and entry.pdu not in self._known:
                self._known.add(entry.pdu)
                self._read(entry.pdu, now_s)
        for late in self._joiner.expire(now_s):
            for pdu in late:
                self._reject(pdu, "parts_missing", "the other parts of the text did not come", now_s)
        if capacity is not None and len(slots) > capacity - SPARE_SLOTS:
            self._done |= {pdu for pdu in self._joiner.waiting if pdu in present}
            self._done |= {entry.pdu for entry in slots if entry.state not in _RECEIVED}

    def add_direct(self, pdu: str, now_s: float) -> None:
        """A text that the modem gave out at once and did not store."""
        if pdu not in self._direct:
            self._direct.append(pdu)
            self._read(pdu, now_s)

    def take(self) -> tuple[Sms, ...]:
        """Hand over what is whole, oldest first; from here on it may leave the store."""
        ready, self._ready = self._ready, []
        for _, pdus in ready:
            self._done |= self._known.intersection(pdus)
        return tuple(sorted((sms for sms, _ in ready), key=lambda sms: sms.sent_utc))

    def take_rejected(self) -> tuple[RejectedText, ...]:
        rejected = tuple(self._rejected)
        self._rejected.clear()
        return rejected

    @property
    def has_ready(self) -> bool:
        return bool(self._ready)

    def _read(self, pdu: str, now_s: float) -> None:
        try:
            deliver = decode_deliver(pdu)
        except ValueError as error:
            self._reject(pdu, "undecodable", str(error), now_s)
            return
        if deliver.alphabet is Alphabet.DATA:
            self._reject(pdu, "data", "octets for a machine, no text", now_s)
        elif deliver.part is None:
            self._finish(deliver.sender, joined_text([deliver.text]), deliver.sent_utc, (pdu,), now_s)
        else:
            self._join(deliver, pdu, now_s)

    def _join(self, deliver: Deliver, pdu: str, now_s: float) -> None:
        whole, dropped = self._joiner.add(deliver, pdu, now_s)
        for old in dropped:
            self._reject(old, "parts_dropped", "parts came twice, or those of too many texts", now_s)
        if whole is not None:
            self._finish(whole.sender, whole.text, whole.sent_utc, whole.sources, now_s)

    def _finish(self, sender: str, text: str, sent_utc: datetime | None, pdus: tuple[str, ...], now_s: float) -> None:
        if len(text) > LONGEST_CHARACTERS:
            for pdu in pdus:
                self._reject(pdu, "oversize", f"{len(text)} characters, more than {LONGEST_CHARACTERS}", now_s)
            return
        self._ready.append((Sms(sender, text, sent_utc or UNKNOWN_SENT_UTC, now_s), pdus))

    def _reject(self, pdu: str, code: str, reason: str, now_s: float) -> None:
        self._rejected.append(RejectedText(pdu, code, reason, now_s))
        if pdu in self._known:
            self._done.add(pdu)
