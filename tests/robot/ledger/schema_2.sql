-- The tables of schema version 2, as that program made them.
PRAGMA application_id = 1397772889;
PRAGMA user_version = 2;

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
    label_cap_ml REAL NOT NULL CHECK (label_cap_ml BETWEEN 0 AND 1e6),
    tank_fill_ml REAL NOT NULL CHECK (tank_fill_ml BETWEEN 0 AND 1e6),
    water INTEGER NOT NULL CHECK (water IN (0, 1)),
    route TEXT NOT NULL,
    config_hash TEXT NOT NULL,
    seed INTEGER
) STRICT;

CREATE TABLE target (
    task_id INTEGER NOT NULL REFERENCES task (id),
    id INTEGER NOT NULL,
    x_m REAL NOT NULL CHECK (x_m BETWEEN -1e9 AND 1e9),
    y_m REAL NOT NULL CHECK (y_m BETWEEN -1e9 AND 1e9),
    z_m REAL NOT NULL CHECK (z_m BETWEEN -1e9 AND 1e9),
    covariance_m2 TEXT NOT NULL,  -- JSON: xx xy xz yy yz zz
    diameter_m REAL NOT NULL CHECK (diameter_m > 0 AND diameter_m < 1),
    diameter_sigma_m REAL NOT NULL CHECK (diameter_sigma_m BETWEEN 0 AND 1e6),
    ripeness TEXT NOT NULL CHECK (ripeness IN ('red', 'turning', 'green')),
    ripeness_score REAL NOT NULL CHECK (ripeness_score BETWEEN -1e9 AND 1e9),
    confidence REAL NOT NULL CHECK (confidence BETWEEN 0 AND 1),
    visible_fraction REAL NOT NULL CHECK (visible_fraction BETWEEN 0 AND 1),
    sightings INTEGER NOT NULL CHECK (sightings >= 1),
    last_seen_s REAL NOT NULL CHECK (last_seen_s BETWEEN -1e9 AND 1e9),
    state TEXT NOT NULL CHECK (
        state IN ('open', 'sprayed', 'uncertain', 'unreachable', 'doubtful', 'not_wanted')
    ),
    reason TEXT NOT NULL,
    measured INTEGER NOT NULL DEFAULT 1 CHECK (measured IN (0, 1)),
    ripeness_weight REAL NOT NULL DEFAULT 0 CHECK (ripeness_weight BETWEEN 0 AND 1e6),
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
    due_ml REAL NOT NULL CHECK (due_ml BETWEEN 0 AND 1e6),
    dose_ml REAL NOT NULL CHECK (dose_ml BETWEEN 0 AND 1e6),
    open_s REAL NOT NULL CHECK (open_s > 0 AND open_s <= 3600),
    pulse_s REAL NOT NULL CHECK (pulse_s > 0 AND pulse_s <= 3600),
    full_ml REAL NOT NULL CHECK (full_ml BETWEEN 0 AND 1e6),
    stamp_s REAL NOT NULL CHECK (stamp_s BETWEEN -1e9 AND 1e9),
    factor REAL NOT NULL DEFAULT 1 CHECK (factor BETWEEN 0 AND 2),
    reason TEXT NOT NULL DEFAULT '',
    FOREIGN KEY (task_id, target_id) REFERENCES target (task_id, id)
) STRICT;

CREATE TABLE result (
    intent_id INTEGER PRIMARY KEY REFERENCES intent (id),
    utc TEXT NOT NULL,
    outcome TEXT NOT NULL CHECK (outcome IN ('sprayed', 'shortened', 'uncertain', 'not_opened')),
    booked_ml REAL NOT NULL CHECK (booked_ml BETWEEN 0 AND 1e6),
    open_s REAL NOT NULL CHECK (open_s >= 0 AND open_s <= 3600),
    measured_ml REAL CHECK (measured_ml BETWEEN 0 AND 1e6),
    reason TEXT NOT NULL,
    stamp_s REAL NOT NULL CHECK (stamp_s BETWEEN -1e9 AND 1e9),
    CHECK (outcome <> 'not_opened' OR booked_ml = 0)
) STRICT;

CREATE TABLE checkpoint (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    task_id INTEGER NOT NULL REFERENCES task (id),
    run_id INTEGER NOT NULL REFERENCES run (id),
    utc TEXT NOT NULL,
    stop INTEGER NOT NULL CHECK (stop >= 0),
    x_m REAL NOT NULL CHECK (x_m BETWEEN -1e9 AND 1e9),
    y_m REAL NOT NULL CHECK (y_m BETWEEN -1e9 AND 1e9),
    heading_rad REAL NOT NULL CHECK (heading_rad BETWEEN -1e9 AND 1e9),
    left_m REAL NOT NULL CHECK (left_m BETWEEN -1e9 AND 1e9),
    right_m REAL NOT NULL CHECK (right_m BETWEEN -1e9 AND 1e9),
    stamp_s REAL NOT NULL CHECK (stamp_s BETWEEN -1e9 AND 1e9)
) STRICT;

CREATE TABLE stop (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    task_id INTEGER NOT NULL REFERENCES task (id),
    run_id INTEGER NOT NULL REFERENCES run (id),
    utc TEXT NOT NULL,
    row TEXT NOT NULL,
    stop INTEGER NOT NULL CHECK (stop >= 0),
    planned_x_m REAL NOT NULL CHECK (planned_x_m BETWEEN -1e9 AND 1e9),
    x_m REAL NOT NULL CHECK (x_m BETWEEN -1e9 AND 1e9),
    y_m REAL NOT NULL CHECK (y_m BETWEEN -1e9 AND 1e9),
    heading_rad REAL NOT NULL CHECK (heading_rad BETWEEN -1e9 AND 1e9),
    stamp_s REAL NOT NULL CHECK (stamp_s BETWEEN -1e9 AND 1e9),
    frame_file TEXT NOT NULL,
    light_level REAL NOT NULL CHECK (light_level BETWEEN 0 AND 255),
    fruits_seen INTEGER NOT NULL CHECK (fruits_seen >= 0),
    light_state TEXT CHECK (light_state IN ('good', 'dim', 'dark', 'bright')),
    plant_level REAL CHECK (plant_level BETWEEN 0 AND 1),
    burnt_share REAL CHECK (burnt_share BETWEEN 0 AND 1),
    illumination_1_s REAL CHECK (illumination_1_s BETWEEN 0 AND 1e6),
    exposure_s REAL CHECK (exposure_s > 0 AND exposure_s <= 3600),
    gain REAL CHECK (gain >= 1 AND gain <= 1e6),
    lamp INTEGER CHECK (lamp IN (0, 1)),
    light_remark TEXT
) STRICT;

CREATE TABLE event (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    run_id INTEGER NOT NULL REFERENCES run (id),
    utc TEXT NOT NULL,
    kind TEXT NOT NULL CHECK (kind <> ''),
    text TEXT NOT NULL,
    stamp_s REAL NOT NULL CHECK (stamp_s BETWEEN -1e9 AND 1e9)
) STRICT;

CREATE INDEX intent_by_task ON intent (task_id);
CREATE INDEX stop_by_task ON stop (task_id);
CREATE INDEX checkpoint_by_task ON checkpoint (task_id);

CREATE TRIGGER intent_is_final BEFORE UPDATE ON intent BEGIN SELECT RAISE(ABORT, 'an intent is final'); END;
CREATE TRIGGER intent_stays BEFORE DELETE ON intent BEGIN SELECT RAISE(ABORT, 'an intent stays'); END;
CREATE TRIGGER result_is_final BEFORE UPDATE ON result BEGIN SELECT RAISE(ABORT, 'a result is final'); END;
CREATE TRIGGER result_stays BEFORE DELETE ON result BEGIN SELECT RAISE(ABORT, 'a result stays'); END;
