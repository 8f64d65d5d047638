"""Which of the texts sent have reached their phones, from the network's status reports."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from drivers.modem.pdu import StatusReport, decode_status_report
from drivers.modem.values import DeliveryReport

MOST_EXPECTED = 64
MOST_REPORTS = 100


@dataclass(slots=True, eq=False)
class Expected:
    """A text under way; ``unsent`` of its parts have no reference yet, ``missing`` references no report."""

    number: str
    text: str
    unsent: int
    missing: set[int] = field(default_factory=set)
    failed: bool = False


class Delivery:
    """References are of one octet and come round again: a report belongs to the newest text that waits for it."""

    def __init__(self) -> None:
        self._expected: deque[Expected] = deque(maxlen=MOST_EXPECTED)
        self._early: deque[StatusReport] = deque(maxlen=MOST_EXPECTED)
        self._reports: deque[DeliveryReport] = deque(maxlen=MOST_REPORTS)
        self.unreadable = 0

    def expect(self, number: str, text: str, parts: int) -> Expected:
        """A text begins to be sent."""
        expected = Expected(number, text, parts)
        self._expected.append(expected)
        return expected

    def sent(self, expected: Expected, reference: int, now_s: float) -> None:
        """The network took one of its parts; the report may have been faster."""
        expected.unsent -= 1
        expected.missing.add(reference)
        for report in tuple(self._early):
            if report.reference == reference and _same(report.number, expected.number):
                self._early.remove(report)
                self._settle(report, now_s)

    def report(self, pdu: str, now_s: float) -> None:
        """A status report as the modem gives it."""
        try:
            report = decode_status_report(pdu)
        except ValueError:
            self.unreadable += 1
            return
        if report.final and not self._settle(report, now_s):
            self._early.append(report)

    def take(self) -> tuple[DeliveryReport, ...]:
        reports = tuple(self._reports)
        self._reports.clear()
        return reports

    def _settle(self, report: StatusReport, now_s: float) -> bool:
        """Whether a text waited for this report."""
        for text in reversed(self._expected):
            if report.reference in text.missing and _same(report.number, text.number):
                text.missing.discard(report.reference)
                text.failed = text.failed or not report.delivered
                if not text.missing and not text.unsent:
                    self._expected.remove(text)
                    self._reports.append(DeliveryReport(text.number, text.text, not text.failed, now_s))
                return True
        return False


def _same(one: str, other: str) -> bool:
    """Numbers of one phone, with and without the country's prefix."""
    return one[-7:] == other[-7:]
