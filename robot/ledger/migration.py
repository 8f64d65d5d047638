"""Ledgers of earlier programs: brought up to date when they are written, seen as if they were when they are read.

Rows stay as they are. What an earlier program did not know gets the value that it acted by.
"""

from __future__ import annotations

import sqlite3

from robot.ledger.schema import APPLICATION_ID, COLUMNS_2, SCHEMA, SCHEMA_VERSION

# Version 1 took every fruit for measured (a dose by hand has none) and gave no weights to its looks.
_MEASURED = "confidence > 0"
_WEIGHT = "sightings * confidence * visible_fraction"
_TO_2 = (
    "".join(f"ALTER TABLE {table} ADD COLUMN {column};\n" for table, added in COLUMNS_2.items() for column in added)
    + f"UPDATE target SET measured = {_MEASURED}, ripeness_weight = {_WEIGHT};\n"
)
_AS_2 = {
    "target": f"{_MEASURED} AS measured, {_WEIGHT} AS ripeness_weight",
    "intent": "1.0 AS factor, '' AS reason",
    "stop": ", ".join(f"NULL AS {column.split()[0]}" for column in COLUMNS_2["stop"]),
}


def bring_up_to_date(connection: sqlite3.Connection, version: int) -> None:
    """Make an empty file a ledger, or an older ledger one of this program: all of it or nothing."""
    if version < SCHEMA_VERSION:
        steps = SCHEMA if version == 0 else _TO_2
        connection.executescript(
            f"BEGIN IMMEDIATE; PRAGMA application_id = {APPLICATION_ID};\n{steps}"
            f"PRAGMA user_version = {SCHEMA_VERSION}; COMMIT;"
        )


def see_as_up_to_date(connection: sqlite3.Connection, version: int) -> None:
    """For a connection that may not write: views of this connection alone stand before the older tables."""
    if version < SCHEMA_VERSION:
        for table, values in _AS_2.items():
            connection.execute(f"CREATE TEMP VIEW {table} AS SELECT *, {values} FROM main.{table}")
