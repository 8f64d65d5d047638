"""Rows for the tests."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from robot.ledger import Checkpoint, Intent, Ledger, Outcome, Result, StopLight, StopRecord, Task
from robot.targets import Target, TargetState
from robot.vision.light import LightState
from robot.vision.values import Ripeness

NOON = datetime(2026, 6, 1, 12, 0, tzinfo=UTC)
TASK = Task(
    product="Water",
    registration_number="-",
    dilution_percent=0.0,
    operator="Ada",
    label_cap_ml=5000.0,
    tank_fill_ml=8000.0,
    water=True,
    route="demo",
    config_hash="0123456789abcdef",
    seed=7,
)
INTENT = Intent(
    target_id=1, stop=2, pulse=0, due_ml=5.2, dose_ml=5.0, open_s=0.40, pulse_s=0.5, full_ml=6.3, stamp_s=12.5,
    factor=0.5, reason="maximum dose",
)
SPRAYED = Result(Outcome.SPRAYED, 5.0, 0.401, 4.9, "", 13.0)
CHECKPOINT = Checkpoint(stop=3, x_m=1.4, y_m=0.001, heading_rad=0.002, left_m=1.39, right_m=1.41, stamp_s=30.0)
STOP = StopRecord("A", 2, 1.0, 0.998, 0.002, 0.001, 11.0, "stop_002.jpg", 101.5, 4)

LIGHT = StopLight(LightState.DIM, 0.031, 0.002, 0.19, 0.02, 8.0, True, "backlight")


def target(target_id: int = 1, state: TargetState = TargetState.OPEN, x_m: float = 1.0) -> Target:
    return Target(
        id=target_id,
        centre_m=np.array([x_m, 0.6, 0.9]),
        covariance_m2=np.array([[4e-6, 1e-7, 2e-7], [1e-7, 9e-5, 3e-7], [2e-7, 3e-7, 5e-6]]),
        diameter_m=0.08,
        diameter_sigma_m=0.003,
        ripeness=Ripeness.TURNING,
        ripeness_score=0.55,
        ripeness_weight=1.3,
        confidence=0.9,
        visible_fraction=0.8,
        measured=True,
        sightings=2,
        last_seen_s=11.0,
        state=state,
        reason="",
    )


def started(path: Path) -> tuple[Ledger, int]:
    """An open ledger with a task and targets 1 to 3."""
    ledger = Ledger.open(path, utc=lambda: NOON)
    ledger.begin_run("boot-1", NOON)
    task_id = ledger.begin_task(TASK)
    ledger.upsert_targets(task_id, [target(n, x_m=0.3 * n) for n in (1, 2, 3)])
    return ledger, task_id


def intent(target_id: int, pulse: int = 0) -> Intent:
    return replace(INTENT, target_id=target_id, pulse=pulse)
