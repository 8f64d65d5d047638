"""What a GSM modem takes and gives."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime


@dataclass(frozen=True, slots=True)
class Sms:
    """A received text, whole (concatenated parts joined). ``sent_utc`` is the service centre's stamp."""

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
