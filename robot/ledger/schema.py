"""The ledger's tables. STRICT, with checks, so that no program can book nonsense."""

from __future__ import annotations

APPLICATION_ID = 0x53505259  # "SPRY"
SCHEMA_VERSION = 3

_FINITE = "BETWEEN -1e9 AND 1e9"
_AMOUNT = "BETWEEN 0 AND 1e6"

# Columns that came with version 2, in the order in which a file of version 1 gets them.
COLUMNS_2 = {
    "target": (
        "measured INTEGER NOT NULL DEFAULT 1 CHECK (measured IN (0, 1))",
        f"ripeness_weight REAL NOT NULL DEFAULT 0 CHECK (ripeness_weight {_AMOUNT})",
    ),
    "intent": (
        "factor REAL NOT NULL DEFAULT 1 CHECK (factor BETWEEN 0 AND 2)",
        "reason TEXT NOT NULL DEFAULT ''",
    ),
    "stop": (
        "light_state TEXT CHECK (light_state IN ('good', 'dim', 'dark', 'bright'))",
        "plant_level REAL CHECK (plant_level BETWEEN 0 AND 1)",
        "burnt_share REAL CHECK (burnt_share BETWEEN 0 AND 1)",
        f"illumination_1_s REAL CHECK (illumination_1_s {_AMOUNT})",
        "exposure_s REAL CHECK (exposure_s > 0 AND exposure_s <= 3600)",
        "gain REAL CHECK (gain >= 1 AND gain <= 1e6)",
        "lamp INTEGER CHECK (lamp IN (0, 1))",
        "light_remark TEXT",
    ),
}
_TARGET_2, _INTENT_2, _STOP_2 = (",\n    ".join(columns) for columns in COLUMNS_2.values())

# What came with version 3.
COLUMNS_3 = {"intent": (f"model_ml REAL CHECK (model_ml {_AMOUNT})",)}
(_INTENT_3,) = (",\n    ".join(columns) for columns in COLUMNS_3.values())
TABLES_3 = f"""
CREATE TABLE leak (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    task_id INTEGER REFERENCES task (id),
    run_id INTEGER NOT NULL REFERENCES run (id),
    utc TEXT NOT NULL,
    booked_ml REAL NOT NULL CHECK (booked_ml {_AMOUNT}),
    measured_ml REAL NOT NULL CHECK (measured_ml {_AMOUNT}),
    reason TEXT NOT NULL CHECK (reason <> ''),
    stamp_s REAL NOT NULL CHECK (stamp_s {_FINITE})
) STRICT;

CREATE TABLE release (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    task_id INTEGER NOT NULL,
    target_id INTEGER NOT NULL,
    run_id INTEGER NOT NULL REFERENCES run (id),
    utc TEXT NOT NULL,
    operator TEXT NOT NULL CHECK (operator <> ''),
    reason TEXT NOT NULL CHECK (reason <> ''),
    last_intent_id INTEGER NOT NULL REFERENCES intent (id),
    FOREIGN KEY (task_id, target_id) REFERENCES target (task_id, id)
) STRICT;

CREATE TABLE meter (
    only INTEGER PRIMARY KEY CHECK (only = 1),
    run_id INTEGER NOT NULL REFERENCES run (id),
    task_id INTEGER REFERENCES task (id),
    count_ml REAL NOT NULL CHECK (count_ml {_FINITE}),
    last_intent_id INTEGER NOT NULL
) STRICT;

CREATE TABLE outbox (
    seq INTEGER PRIMARY KEY AUTOINCREMENT,
    run_id INTEGER NOT NULL REFERENCES run (id),
    kind TEXT NOT NULL CHECK (kind IN ('shot', 'leak', 'release', 'fault', 'event')),
    row_id INTEGER NOT NULL,
    UNIQUE (kind, row_id)
) STRICT;

CREATE TABLE outbox_loss (
    kind TEXT PRIMARY KEY,
    dropped INTEGER NOT NULL CHECK (dropped >= 0)
) STRICT, WITHOUT ROWID;

CREATE INDEX leak_by_task ON leak (task_id);
CREATE INDEX release_by_target ON release (task_id, target_id);

CREATE TRIGGER leak_is_final BEFORE UPDATE ON leak BEGIN SELECT RAISE(ABORT, 'a leak is final'); END;
CREATE TRIGGER leak_stays BEFORE DELETE ON leak BEGIN SELECT RAISE(ABORT, 'a leak stays'); END;
CREATE TRIGGER release_is_final BEFORE UPDATE ON release BEGIN SELECT RAISE(ABORT, 'a release is final'); END;
CREATE TRIGGER release_stays BEFORE DELETE ON release BEGIN SELECT RAISE(ABORT, 'a release stays'); END;
"""

SCHEMA = f"""
CREATE TABLE run (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    boot_id TEXT NOT NULL CHECK (boot_id <> ''),
    started_utc TEXT NOT NULL
) STRICT;

CREATE TABLE task (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    run_id INTEGER NOT NULL REFERENCES run (id),
    utc TEXT NOT NULL,
    product TEXT NOT NULL CHECK (product <> ''),
    registration_number TEXT NOT NULL,
    dilution_percent REAL NOT NULL CHECK (dilution_percent BETWEEN 0 AND 100),
    operator TEXT NOT NULL CHECK (operator <> ''),
    label_cap_ml REAL NOT NULL CHECK (label_cap_ml {_AMOUNT}),
    tank_fill_ml REAL NOT NULL CHECK (tank_fill_ml {_AMOUNT}),
    water INTEGER NOT NULL CHECK (water IN (0, 1)),
    route TEXT NOT NULL,
    config_hash TEXT NOT NULL,
    seed INTEGER
) STRICT;

CREATE TABLE target (
    task_id INTEGER NOT NULL REFERENCES task (id),
    id INTEGER NOT NULL,
    x_m REAL NOT NULL CHECK (x_m {_FINITE}),
    y_m REAL NOT NULL CHECK (y_m {_FINITE}),
    z_m REAL NOT NULL CHECK (z_m {_FINITE}),
    covariance_m2 TEXT NOT NULL,  -- JSON: xx xy xz yy yz zz
    diameter_m REAL NOT NULL CHECK (diameter_m > 0 AND diameter_m < 1),
    diameter_sigma_m REAL NOT NULL CHECK (diameter_sigma_m {_AMOUNT}),
    ripeness TEXT NOT NULL CHECK (ripeness IN ('red', 'turning', 'green')),
    ripeness_score REAL NOT NULL CHECK (ripeness_score {_FINITE}),
    confidence REAL NOT NULL CHECK (confidence BETWEEN 0 AND 1),
    visible_fraction REAL NOT NULL CHECK (visible_fraction BETWEEN 0 AND 1),
    sightings INTEGER NOT NULL CHECK (sightings >= 1),
    last_seen_s REAL NOT NULL CHECK (last_seen_s {_FINITE}),
    state TEXT NOT NULL CHECK (
        state IN ('open', 'sprayed', 'uncertain', 'unreachable', 'doubtful', 'not_wanted')
    ),
    reason TEXT NOT NULL,
    {_TARGET_2},
    PRIMARY KEY (task_id, id)
) STRICT, WITHOUT ROWID;

CREATE TABLE intent (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    task_id INTEGER NOT NULL,
    run_id INTEGER NOT NULL REFERENCES run (id),
    utc TEXT NOT NULL,
    target_id INTEGER NOT NULL,
    stop INTEGER NOT NULL CHECK (stop >= 0),
    pulse INTEGER NOT NULL CHECK (pulse >= 0),
    due_ml REAL NOT NULL CHECK (due_ml {_AMOUNT}),
    dose_ml REAL NOT NULL CHECK (dose_ml {_AMOUNT}),
    open_s REAL NOT NULL CHECK (open_s > 0 AND open_s <= 3600),
    pulse_s REAL NOT NULL CHECK (pulse_s > 0 AND pulse_s <= 3600),
    full_ml REAL NOT NULL CHECK (full_ml {_AMOUNT}),
    stamp_s REAL NOT NULL CHECK (stamp_s {_FINITE}),
    {_INTENT_2},
    {_INTENT_3},
    FOREIGN KEY (task_id, target_id) REFERENCES target (task_id, id)
) STRICT;

CREATE TABLE result (
    intent_id INTEGER PRIMARY KEY REFERENCES intent (id),
    utc TEXT NOT NULL,
    outcome TEXT NOT NULL CHECK (outcome IN ('sprayed', 'shortened', 'uncertain', 'not_opened')),
    booked_ml REAL NOT NULL CHECK (booked_ml {_AMOUNT}),
    open_s REAL NOT NULL CHECK (open_s >= 0 AND open_s <= 3600),
    measured_ml REAL CHECK (measured_ml {_AMOUNT}),
    reason TEXT NOT NULL,
    stamp_s REAL NOT NULL CHECK (stamp_s {_FINITE}),
    CHECK (outcome <> 'not_opened' OR booked_ml = 0)
) STRICT;

CREATE TABLE checkpoint (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    task_id INTEGER NOT NULL REFERENCES task (id),
    run_id INTEGER NOT NULL REFERENCES run (id),
    utc TEXT NOT NULL,
    stop INTEGER NOT NULL CHECK (stop >= 0),
    x_m REAL NOT NULL CHECK (x_m {_FINITE}),
    y_m REAL NOT NULL CHECK (y_m {_FINITE}),
    heading_rad REAL NOT NULL CHECK (heading_rad {_FINITE}),
    left_m REAL NOT NULL CHECK (left_m {_FINITE}),
    right_m REAL NOT NULL CHECK (right_m {_FINITE}),
    stamp_s REAL NOT NULL CHECK (stamp_s {_FINITE})
) STRICT;

CREATE TABLE stop (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    task_id INTEGER NOT NULL REFERENCES task (id),
    run_id INTEGER NOT NULL REFERENCES run (id),
    utc TEXT NOT NULL,
    row TEXT NOT NULL,
    stop INTEGER NOT NULL CHECK (stop >= 0),
    planned_x_m REAL NOT NULL CHECK (planned_x_m {_FINITE}),
    x_m REAL NOT NULL CHECK (x_m {_FINITE}),
    y_m REAL NOT NULL CHECK (y_m {_FINITE}),
    heading_rad REAL NOT NULL CHECK (heading_rad {_FINITE}),
    stamp_s REAL NOT NULL CHECK (stamp_s {_FINITE}),
    frame_file TEXT NOT NULL,
    light_level REAL NOT NULL CHECK (light_level BETWEEN 0 AND 255),
    fruits_seen INTEGER NOT NULL CHECK (fruits_seen >= 0),
    {_STOP_2}
) STRICT;

CREATE TABLE event (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    run_id INTEGER NOT NULL REFERENCES run (id),
    utc TEXT NOT NULL,
    kind TEXT NOT NULL CHECK (kind <> ''),
    text TEXT NOT NULL,
    stamp_s REAL NOT NULL CHECK (stamp_s {_FINITE})
) STRICT;

CREATE INDEX intent_by_task ON intent (task_id);
CREATE INDEX stop_by_task ON stop (task_id);
CREATE INDEX checkpoint_by_task ON checkpoint (task_id);

CREATE TRIGGER intent_is_final BEFORE UPDATE ON intent BEGIN SELECT RAISE(ABORT, 'an intent is final'); END;
CREATE TRIGGER intent_stays BEFORE DELETE ON intent BEGIN SELECT RAISE(ABORT, 'an intent stays'); END;
CREATE TRIGGER result_is_final BEFORE UPDATE ON result BEGIN SELECT RAISE(ABORT, 'a result is final'); END;
CREATE TRIGGER result_stays BEFORE DELETE ON result BEGIN SELECT RAISE(ABORT, 'a result stays'); END;
{TABLES_3}"""
