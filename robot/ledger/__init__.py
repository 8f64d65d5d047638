"""Every millilitre, written ahead."""

from robot.ledger.latency import SLOW_S, WriteLatency
from robot.ledger.ledger import Ledger
from robot.ledger.outbox import OutboxRow, Parcel
from robot.ledger.reader import LedgerReader
from robot.ledger.records import (
    EventRow,
    LeakRow,
    MeterMark,
    ReleaseRow,
    ShotRow,
    StopLight,
    StopRecord,
    StopRow,
    TaskRow,
    Totals,
)
from robot.ledger.refills import Refill
from robot.ledger.sums import Recent, Sums, cell_of
from robot.ledger.values import Checkpoint, Dangling, Intent, Leak, Outcome, Result, Task
from robot.ledger.writing import LedgerRuleError, wall_clock

__all__ = [
    "SLOW_S",
    "Checkpoint",
    "Dangling",
    "EventRow",
    "Intent",
    "Leak",
    "LeakRow",
    "Ledger",
    "LedgerReader",
    "LedgerRuleError",
    "MeterMark",
    "OutboxRow",
    "Outcome",
    "Parcel",
    "Recent",
    "Refill",
    "ReleaseRow",
    "Result",
    "ShotRow",
    "StopLight",
    "StopRecord",
    "StopRow",
    "Sums",
    "Task",
    "TaskRow",
    "Totals",
    "WriteLatency",
    "cell_of",
    "wall_clock",
]
