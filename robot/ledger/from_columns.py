"""Rows of the tables as values."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from typing import Any

import numpy as np

from robot.ledger.certainty import true_state
from robot.ledger.records import ShotRow, StopLight, StopRecord
from robot.ledger.values import Intent, Outcome, Result
from robot.targets.values import Target, TargetState
from robot.vision.light import LightState
from robot.vision.values import Ripeness

SHOT_COLUMNS = """
    intent.id, intent.task_id, intent.run_id, intent.utc, target_id, stop, pulse, due_ml, dose_ml, intent.open_s,
    pulse_s, full_ml, intent.stamp_s, factor, intent.reason, model_ml,
    result.utc, outcome, booked_ml, result.open_s, measured_ml, result.reason, result.stamp_s
    FROM intent LEFT JOIN result ON result.intent_id = intent.id
"""


def utc_of(text: str) -> datetime:
    return datetime.fromisoformat(text)


def stop_of(row: Sequence[Any]) -> StopRecord:
    *stop, state, level, burnt, illumination, exposure_s, gain, lamp, remark = row
    light = None
    if state is not None:
        light = StopLight(LightState(state), level, burnt, illumination, exposure_s, gain, bool(lamp), remark)
    return replace(StopRecord(*stop), light=light)


def shot_of(row: Sequence[Any]) -> ShotRow:
    intent_id, task_id, run_id, utc, *planned = row[:16]
    result_utc, outcome, booked_ml, opened_s, measured_ml, reason, result_stamp_s = row[16:]
    return ShotRow(
        intent_id=intent_id,
        task_id=task_id,
        run_id=run_id,
        intent=Intent(*planned),
        utc=utc_of(utc),
        result=None
        if outcome is None
        else Result(Outcome(outcome), booked_ml, opened_s, measured_ml, reason, result_stamp_s),
        result_utc=None if result_utc is None else utc_of(result_utc),
    )


def target_of(row: Sequence[Any], shots: Sequence[ShotRow]) -> Target:
    target_id, x_m, y_m, z_m, covariance, *figures, state, reason = row
    diameter_m, diameter_sigma_m, ripeness, score, weight, *figures = figures
    confidence, visible, measured, sightings, last_seen_s = figures
    xx, xy, xz, yy, yz, zz = json.loads(covariance)
    state, reason = true_state(TargetState(state), reason, shots)
    return Target(
        id=target_id,
        centre_m=np.array([x_m, y_m, z_m]),
        covariance_m2=np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
        diameter_m=diameter_m,
        diameter_sigma_m=diameter_sigma_m,
        ripeness=Ripeness(ripeness),
        ripeness_score=score,
        ripeness_weight=weight,
        confidence=confidence,
        visible_fraction=visible,
        measured=bool(measured),
        sightings=sightings,
        last_seen_s=last_seen_s,
        state=state,
        reason=reason,
    )
