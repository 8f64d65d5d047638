"""Values as the columns of their tables."""

from __future__ import annotations

import json

from robot.ledger.records import StopLight
from robot.targets.values import Target


def light_columns(light: StopLight | None) -> tuple[object, ...]:
    if light is None:
        return (None,) * 8
    return (
        light.state.value,
        light.plant_level,
        light.burnt_share,
        light.illumination_1_s,
        light.exposure_s,
        light.gain,
        int(light.lamp),
        light.remark,
    )


def target_columns(task_id: int, target: Target) -> tuple[object, ...]:
    c = target.covariance_m2
    covariance = [float(c[i, j]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    return (
        task_id,
        target.id,
        *(float(value) for value in target.centre_m),
        json.dumps(covariance, allow_nan=False),
        float(target.diameter_m),
        float(target.diameter_sigma_m),
        target.ripeness.value,
        float(target.ripeness_score),
        float(target.confidence),
        float(target.visible_fraction),
        target.sightings,
        float(target.last_seen_s),
        target.state.value,
        target.reason,
        int(target.measured),
        float(target.ripeness_weight),
    )
