"""Between the emulated modem and the twin's network: texts in as PDUs, PDUs out as texts."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone

from drivers.modem.concatenation import Joiner, split
from drivers.modem.pdu import Deliver, StatusReport, Submit, encode_deliver, encode_status_report
from drivers.modem.pdu_fields import encode_address
from drivers.modem.user_data import Part, joined_text
from drivers.twin.commands import ModemSend, ModemTake
from drivers.twin.machine import Twin
from drivers.twin.network import DELIVERY_S

PARTS_KEEP_S = 3600.0
LONGEST_FROM_PHONES = 10_000  # more than the robot takes, less than 255 parts hold
DELIVERED = 0x00


@dataclass(frozen=True, slots=True)
class IncomingPdu:
    """A PDU that waits for the modem; ``text`` numbers the text that it is of."""

    pdu: str
    octets: int
    text: int


@dataclass(frozen=True, slots=True)
class DueReport:
    due_s: float
    pdu: str
    octets: int


class EmulatedPost:
    """The twin's texts stay in the twin until the host has deleted all of them: a new process finds the others again.

    ``zone`` is the service centre's own; ``clock`` gives loop time.
    """

    def __init__(
        self, twin: Twin, clock: Callable[[], float], smsc: str, zone: timezone = timezone(timedelta(hours=2))
    ) -> None:
        self._twin, self._clock, self._smsc, self._zone = twin, clock, smsc, zone
        self.waiting: deque[IncomingPdu] = deque()
        self.reports: deque[DueReport] = deque()
        self._seen = 0
        self._present: set[int] = set()
        self._texts = 0
        self._reference = 0
        self._joiner: Joiner[int] = Joiner(PARTS_KEEP_S)

    def fetch(self) -> None:
        """Texts that have come since the last time join those that wait."""
        texts = self._twin.texts(self._clock())
        for sms in texts[self._seen :]:
            self._texts += 1
            self._present.add(self._texts)
            for deliver in self.parts(sms.sender, sms.text, sms.sent_utc):
                self.waiting.append(IncomingPdu(*encode_deliver(deliver), self._texts))
        self._seen = len(texts)

    def parts(self, sender: str, text: str, sent_utc: datetime) -> list[Deliver]:
        """As a service centre hands a text to a modem."""
        alphabet, pieces = split(joined_text([text])[:LONGEST_FROM_PHONES], longest=LONGEST_FROM_PHONES)
        self._reference = (self._reference + 1) % 256
        stamp = sent_utc.astimezone(self._zone)
        return [
            Deliver(
                _presented(sender), piece, stamp, alphabet,
                Part(self._reference, len(pieces), place) if len(pieces) > 1 else None, self._smsc,
            )
            for place, piece in enumerate(pieces, start=1)
        ]  # fmt: skip

    def gone(self, still_there: set[int]) -> None:
        """The host has deleted all texts but these from the store."""
        waiting = {pdu.text for pdu in self.waiting}
        if not self._present:
            return
        self._present &= still_there | waiting
        if not self._present and len(self._twin.texts(self._clock())) == self._seen:
            self._twin.apply(self._clock(), ModemTake())
            self._seen = 0

    def take_out(self, submit: Submit, reference: int) -> None:
        """The network has taken a PDU; with the last part of its text the text is in the twin's outbox."""
        now_s = self._clock()
        if submit.part is None:
            self._twin.apply(now_s, ModemSend(submit.number, submit.text))
        else:
            as_received = Deliver(submit.number, submit.text, None, submit.alphabet, submit.part)
            whole, _ = self._joiner.add(as_received, reference, now_s)
            if whole is not None:
                self._twin.apply(now_s, ModemSend(submit.number, whole.text))
        self._joiner.expire(now_s)
        if submit.report:
            sent = (self._twin.nominal.start_utc + timedelta(seconds=now_s)).astimezone(UTC)
            done = sent + timedelta(seconds=DELIVERY_S)
            pdu, octets = encode_status_report(
                StatusReport(reference, submit.number, DELIVERED, sent, done, self._smsc)
            )
            self.reports.append(DueReport(now_s + DELIVERY_S, pdu, octets))


def _presented(sender: str) -> str:
    """The sender as a network shows him: what is neither a number nor a short name is withheld."""
    try:
        encode_address(sender)
    except ValueError:
        return "unknown"
    return sender
