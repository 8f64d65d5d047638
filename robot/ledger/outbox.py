"""Rows that the uplink has not delivered yet, each put here in the transaction that wrote it.

Shots, leaks, releases and faults wait until they are acknowledged. Other events are dropped, oldest first, when more
than ``KEPT_EVENTS`` rows came after them; how many were dropped is kept.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

KEPT_EVENTS = 20_000
FAULT_KINDS = frozenset({"fault", "mode", "security", "leak"})  # events that are never dropped


class Parcel(StrEnum):
    """What a row of the outbox speaks of; ``row_id`` is the intent's, the leak's, the release's or the event's id."""

    SHOT = "shot"
    LEAK = "leak"
    RELEASE = "release"
    FAULT = "fault"
    EVENT = "event"


@dataclass(frozen=True, slots=True)
class OutboxRow:
    """One row to deliver. ``seq`` only rises in one ledger, ``boot_id`` is that of the run which wrote the row."""

    seq: int
    boot_id: str
    run_id: int
    kind: Parcel
    row_id: int

    def key(self, robot: str) -> tuple[str, str, int]:
        """What a receiver tells duplicates by: (robot, boot, seq)."""
        return robot, self.boot_id, self.seq


def parcel_of_event(kind: str) -> Parcel:
    return Parcel.FAULT if kind in FAULT_KINDS else Parcel.EVENT


def put(db: sqlite3.Connection, run_id: int, kind: Parcel, row_id: int, kept_events: int = KEPT_EVENTS) -> None:
    """Within the transaction that writes the row."""
    added = db.execute("INSERT INTO outbox (run_id, kind, row_id) VALUES (?, ?, ?)", (run_id, kind.value, row_id))
    newest = added.lastrowid or 0
    gone = db.execute("DELETE FROM outbox WHERE kind = 'event' AND seq <= ?", (newest - kept_events,)).rowcount
    if gone:
        db.execute(
            "INSERT INTO outbox_loss (kind, dropped) VALUES ('event', ?)"
            " ON CONFLICT DO UPDATE SET dropped = dropped + excluded.dropped",
            (gone,),
        )


def remove(db: sqlite3.Connection, seqs: Sequence[int]) -> None:
    db.executemany("DELETE FROM outbox WHERE seq = ?", [(seq,) for seq in seqs])


PENDING = (
    "SELECT seq, boot_id, run_id, kind, row_id FROM outbox JOIN run ON run.id = outbox.run_id WHERE seq > ?"
    " ORDER BY seq LIMIT ?"
)
WAITING = "SELECT count(*) FROM outbox"
DROPPED = "SELECT coalesce(sum(dropped), 0) FROM outbox_loss"
