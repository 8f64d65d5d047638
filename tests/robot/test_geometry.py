"""Roll, pitch and yaw there and back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.geometry import rotation_from_rpy, rpy_from_rotation

ANGLE = st.floats(-math.pi, math.pi)


@given(ANGLE, ANGLE, ANGLE)
def test_the_angles_of_a_rotation_make_the_same_rotation(roll: float, pitch: float, yaw: float) -> None:
    rotation = rotation_from_rpy(roll, pitch, yaw)
    assert rotation_from_rpy(*rpy_from_rotation(rotation)) == pytest.approx(rotation, abs=2e-6)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
def test_looking_straight_up_or_down_keeps_the_roll_at_zero(pitch: float) -> None:
    rotation = rotation_from_rpy(0.4, pitch, 1.1)
    roll, found, _ = rpy_from_rotation(rotation)
    assert roll == 0.0
    assert found == pytest.approx(pitch)
    assert np.allclose(rotation_from_rpy(*rpy_from_rotation(rotation)), rotation, atol=1e-9)
