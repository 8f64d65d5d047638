from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from robot.aiming import ArmModel, parse_urdf
from tests.robot.aiming.rig import URDF, Rig, demo_rig


@pytest.fixture(scope="session")
def urdf_text() -> str:
    return URDF.read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def model(urdf_text: str) -> ArmModel:
    return parse_urdf(urdf_text, URDF.name)


@pytest.fixture(scope="session")
def rig() -> Rig:
    return demo_rig()


@pytest.fixture(scope="session")
def random_joints(model: ArmModel) -> Callable[[int], np.ndarray]:
    """Uniform inside the joint limits, the same at every call."""

    def draw(count: int) -> np.ndarray:
        return np.random.default_rng(7).uniform(model.lower_rad, model.upper_rad, (count, 6))

    return draw
