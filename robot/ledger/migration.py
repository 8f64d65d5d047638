"""Ledgers of earlier programs: brought up to date when they are written, seen as if they were when they are read.

Rows stay as they are. What an earlier program did not know gets the value that it acted by.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence

from robot.ledger.schema import APPLICATION_ID, COLUMNS_2, COLUMNS_3, SCHEMA, SCHEMA_VERSION, TABLES_3

# Version 1 took every fruit for measured (a dose by hand has none) and gave no weights to its looks.
_MEASURED = "confidence > 0"
_WEIGHT = "sightings * confidence * visible_fraction"


def _added(columns: Mapping[str, Sequence[str]]) -> str:
    pairs = [(table, column) for table, added in columns.items() for column in added]
    return "".join(f"ALTER TABLE {table} ADD COLUMN {column};\n" for table, column in pairs)


# From each version to the next.
_STEPS = {
    1: _added(COLUMNS_2) + f"UPDATE target SET measured = {_MEASURED}, ripeness_weight = {_WEIGHT};\n",
    2: _added(COLUMNS_3) + TABLES_3,
}

# What a reader sees instead of each older version's tables.
_COLUMNS_OF_1 = {
    "target": f"{_MEASURED} AS measured, {_WEIGHT} AS ripeness_weight",
    "intent": "1.0 AS factor, '' AS reason, NULL AS model_ml",
    "stop": ", ".join(f"NULL AS {column.split()[0]}" for column in COLUMNS_2["stop"]),
}
_COLUMNS_OF_2 = {"intent": "NULL AS model_ml"}
_SEEN = {1: _COLUMNS_OF_1, 2: _COLUMNS_OF_2}
_EMPTY = {
    "leak": ("id", "task_id", "run_id", "utc", "booked_ml", "measured_ml", "reason", "stamp_s"),
    "release": ("id", "task_id", "target_id", "run_id", "utc", "operator", "reason", "last_intent_id"),
    "meter": ("only", "run_id", "task_id", "count_ml", "last_intent_id"),
    "outbox": ("seq", "run_id", "kind", "row_id"),
    "outbox_loss": ("kind", "dropped"),
}


def bring_up_to_date(connection: sqlite3.Connection, version: int) -> None:
    """Make an empty file a ledger, or an older ledger one of this program: all of it or nothing."""
    if version < SCHEMA_VERSION:
        steps = SCHEMA if version == 0 else "".join(_STEPS[step] for step in range(version, SCHEMA_VERSION))
        connection.executescript(
            f"BEGIN IMMEDIATE; PRAGMA application_id = {APPLICATION_ID};\n{steps}"
            f"PRAGMA user_version = {SCHEMA_VERSION}; COMMIT;"
        )


def see_as_up_to_date(connection: sqlite3.Connection, version: int) -> None:
    """For a connection that may not write: views of this connection alone stand before the older tables."""
    if version < SCHEMA_VERSION:
        for table, values in _SEEN[version].items():
            connection.execute(f"CREATE TEMP VIEW {table} AS SELECT *, {values} FROM main.{table}")
        for table, columns in _EMPTY.items():
            nothing = ", ".join(f"NULL AS {column}" for column in columns)
            connection.execute(f"CREATE TEMP VIEW {table} AS SELECT {nothing} WHERE 0")
