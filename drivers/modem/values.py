"""What a GSM modem takes and gives."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime


@dataclass(frozen=True, slots=True)
class Sms:
    """A received text, whole (concatenated parts joined). ``sent_utc`` is the service centre's stamp.

    A text without a readable stamp counts as sent on 1 January 1970.
    """

    sender: str
    text: str
    sent_utc: datetime
    received_s: float


@dataclass(frozen=True, slots=True)
class ModemStatus:
    """Registration and signal at ``stamp_s`` (loop time); ``signal_dbm`` is None when the modem does not know."""

    stamp_s: float
    sim_ready: bool
    registered: bool
    operator: str | None
    signal_dbm: float | None


@dataclass(frozen=True, slots=True)
class DeliveryReport:
    """What became of a sent text: whether all of its parts reached the phone of ``number``, known at ``stamp_s``."""

    number: str
    text: str
    delivered: bool
    stamp_s: float


@dataclass(frozen=True, slots=True)
class RejectedText:
    """What came in and is no text for anybody, as it came, and why: ``code`` for counting, ``reason`` for reading."""

    pdu: str
    code: str
    reason: str
    stamp_s: float
