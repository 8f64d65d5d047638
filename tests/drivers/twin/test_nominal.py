"""What the robot is told, how the truth differs, and both as JSON."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from drivers.gps.values import FixQuality
from drivers.twin import Nominal, TrueMachine, draw, exact
from drivers.twin.codec import decode, encode
from tests.drivers.twin import rig

NOMINAL = rig.nominal()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("nozzle_flow_ml_s", 0.0),
        ("pulse_max_s", -1.0),
        ("track_m", math.nan),
        ("exposure_s", 10.0),
        ("tank_fill_ml", 1e9),
        ("base_from_arm", np.eye(3)),
        ("base_from_camera", np.diag([1.0, 1.0, -1.0, 1.0])),
    ],
)
def test_an_impossible_machine_is_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=name):
        rig.nominal(**{name: value})


def test_a_receiver_without_a_position_is_possible() -> None:
    assert rig.nominal(gps_quality=FixQuality.NONE).gps_quality is FixQuality.NONE


def test_the_truth_differs_within_the_bounds() -> None:
    for seed in range(200):
        true = draw(NOMINAL, seed)
        off = np.linalg.inv(NOMINAL.base_from_camera) @ true.base_from_camera
        turn = math.acos(min(1.0, 0.5 * (np.trace(off[:3, :3]) - 1.0)))
        assert np.linalg.norm(off[:3, 3]) <= 0.002
        assert turn <= math.radians(0.3) + 1e-9
        assert abs(true.nozzle_flow_ml_s / NOMINAL.nozzle_flow_ml_s - 1.0) <= 0.04
        assert abs(true.valve_open_s - NOMINAL.valve_open_s) <= 0.005
        assert abs(true.valve_close_s - NOMINAL.valve_close_s) <= 0.005


def test_the_bounds_are_made_use_of() -> None:
    flows = [draw(NOMINAL, seed).nozzle_flow_ml_s / NOMINAL.nozzle_flow_ml_s for seed in range(200)]
    assert min(flows) < 0.965
    assert max(flows) > 1.035


def test_the_same_seed_draws_the_same_machine() -> None:
    assert encode(draw(NOMINAL, 7)) == encode(draw(NOMINAL, 7)) != encode(draw(NOMINAL, 8))


def test_an_exact_machine_is_as_told() -> None:
    assert exact(NOMINAL).nozzle_flow_ml_s == NOMINAL.nozzle_flow_ml_s
    assert np.array_equal(exact(NOMINAL).base_from_camera, NOMINAL.base_from_camera)


@pytest.mark.parametrize(("kind", "value"), [(Nominal, NOMINAL), (TrueMachine, draw(NOMINAL, 3))])
def test_json_keeps_every_bit(kind: type[Any], value: object) -> None:
    text = json.dumps(encode(value))
    back = decode(kind, json.loads(text))
    assert encode(back) == encode(value)
    assert type(back) is type(value)


def test_an_unknown_key_is_refused() -> None:
    data = encode(exact(NOMINAL)) | {"colour": "red"}
    with pytest.raises(ValueError, match="colour"):
        decode(TrueMachine, data)
