"""Every millilitre, written ahead."""

from robot.ledger.ledger import Ledger, LedgerRuleError, wall_clock
from robot.ledger.reader import LedgerReader
from robot.ledger.records import EventRow, ShotRow, StopLight, StopRecord, StopRow, TaskRow, Totals
from robot.ledger.values import Checkpoint, Dangling, Intent, Outcome, Result, Task

__all__ = [
    "Checkpoint",
    "Dangling",
    "EventRow",
    "Intent",
    "Ledger",
    "LedgerReader",
    "LedgerRuleError",
    "Outcome",
    "Result",
    "ShotRow",
    "StopLight",
    "StopRecord",
    "StopRow",
    "Task",
    "TaskRow",
    "Totals",
    "wall_clock",
]
