"""Ledgers as earlier programs left them."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from robot.ledger import LedgerReader
from robot.vision.values import Ripeness

_BOTH = """
INSERT INTO run VALUES (1, 'boot-0', '2026-05-01T08:00:00+00:00');
INSERT INTO task VALUES (1, 1, '2026-05-01T08:00:00+00:00', 'Water', '-', 0, 'Ada', 5000, 8000, 1, 'demo', 'abc', 7);
"""
_ROWS = {
    1: _BOTH + """
INSERT INTO target VALUES
  (1, 1, 0.3, 0.6, 0.9, '[1e-6, 0, 0, 1e-6, 0, 1e-6]', 0.08, 0.003, 'red', 0.9, 0.8, 0.5, 3, 11, 'sprayed', ''),
  (1, 2, 0.3, 0.6, 0.9, '[0, 0, 0, 0, 0, 0]', 0.001, 0, 'green', 0, 0, 0, 1, 11, 'open', 'by hand: no fruit');
INSERT INTO intent VALUES (1, 1, 1, '2026-05-01T08:01:00+00:00', 1, 1, 1, 5.4, 5.4, 0.4, 0.5, 6.3, 12);
INSERT INTO result VALUES (1, '2026-05-01T08:01:01+00:00', 'sprayed', 5.4, 0.4, 5.3, 'as told', 13);
""",
    2: _BOTH + """
INSERT INTO target VALUES
  (1, 1, 0.3, 0.6, 0.9, '[1e-6, 0, 0, 1e-6, 0, 1e-6]', 0.08, 0.003, 'red', 0.9, 0.8, 0.5, 3, 11, 'sprayed', '',
   1, 1.2),
  (1, 2, 0.3, 0.6, 0.9, '[0, 0, 0, 0, 0, 0]', 0.001, 0, 'green', 0, 0, 0, 1, 11, 'open', 'by hand: no fruit', 0, 0);
INSERT INTO intent VALUES (1, 1, 1, '2026-05-01T08:01:00+00:00', 1, 1, 1, 5.4, 5.4, 0.4, 0.5, 6.3, 12, 0.5, 'max');
INSERT INTO result VALUES (1, '2026-05-01T08:01:01+00:00', 'sprayed', 5.4, 0.4, 5.3, 'as told', 13);
""",
}  # fmt: skip


def old_ledger(folder: Path, number: int = 1) -> Path:
    """Of a program that knew schema ``number``."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "old.sqlite"
    schema = Path(__file__).with_name(f"schema_{number}.sql").read_text(encoding="utf-8")
    with sqlite3.connect(path) as raw:
        raw.execute("PRAGMA journal_mode = WAL")
        raw.executescript(schema + _ROWS[number])
    raw.close()
    return path


def check_rows(reader: LedgerReader, number: int = 1) -> None:
    """Nothing is lost, and what the earlier program did not know has the value that it acted by."""
    fruit, by_hand = reader.targets(1)
    assert (fruit.diameter_m, fruit.ripeness, fruit.ripeness_score) == (0.08, Ripeness.RED, 0.9)
    assert (fruit.measured, fruit.ripeness_weight) == (True, pytest.approx(1.2))
    assert (by_hand.measured, by_hand.ripeness_weight) == (False, 0.0)
    (shot,) = reader.shots(1)
    factor, reason = (1.0, "") if number == 1 else (0.5, "max")
    assert (shot.intent.factor, shot.intent.reason, shot.intent.stamp_s) == (factor, reason, 12.0)
    assert shot.intent.model_ml is None
    assert shot.result is not None
    assert (shot.result.booked_ml, shot.result.reason) == (5.4, "as told")


def check_nothing_newer(reader: LedgerReader) -> None:
    """What that program did not keep is empty."""
    assert (reader.leaks(), reader.releases(1), reader.outbox(10), reader.outbox_dropped()) == ((), (), (), 0)
    assert reader.flow_history(10) == ()
    assert reader.meter_mark() is None


def version(path: Path) -> int:
    with sqlite3.connect(path) as raw:
        (found,) = raw.execute("PRAGMA user_version").fetchone()
    raw.close()
    return int(found)
