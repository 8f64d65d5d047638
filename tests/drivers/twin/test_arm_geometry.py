"""The twin's own forward kinematics."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drivers.twin.kinematics import read_urdf
from tests.drivers.twin.rig import URDF

TEXT = URDF.read_text()
ARM = read_urdf(TEXT)


def test_the_arm_at_zero_stretches_its_forearm_level_above_its_shoulder() -> None:
    pose = ARM.nozzle_pose(np.zeros(6))
    assert pose[:3, 3] == pytest.approx([0.05955 + 0.2 + 0.1 + 0.069744 + 0.07, 0.0, 0.079 + 0.04805 + 0.3])
    assert pose[:3, 0] == pytest.approx([1.0, 0.0, 0.0])


def test_the_waist_turns_the_whole_arm() -> None:
    straight = ARM.nozzle_pose(np.zeros(6))[:3, 3]
    turned = ARM.nozzle_pose([math.pi / 2, 0, 0, 0, 0, 0])[:3, 3]
    assert turned == pytest.approx([0.0, straight[0], straight[2]])


def test_positive_shoulder_leans_forward() -> None:
    lifted = ARM.nozzle_pose([0, 0.3, 0, 0, 0, 0])
    assert lifted[:3, 0] == pytest.approx([math.cos(0.3), 0.0, -math.sin(0.3)])


def test_turning_the_last_joint_leaves_the_nozzle_on_its_axis() -> None:
    a, b = ARM.nozzle_pose([0.3, 0.2, 0.1, 0.4, 0.5, 0.0]), ARM.nozzle_pose([0.3, 0.2, 0.1, 0.4, 0.5, 1.2])
    assert a[:3, 3] == pytest.approx(b[:3, 3])
    assert a[:3, 0] == pytest.approx(b[:3, 0])


def test_bodies_move_with_their_links() -> None:
    row_from_root = np.eye(4)
    row_from_root[:3, 3] = [1.0, 2.0, 3.0]
    rest = ARM.capsules(np.zeros(6), row_from_root)
    turned = ARM.capsules([math.pi, 0, 0, 0, 0, 0], row_from_root)
    assert len(rest) >= 7
    for a, b in zip(rest[1:], turned[1:], strict=True):
        assert b.p1_m - [1, 2, 3] == pytest.approx((a.p1_m - [1, 2, 3]) * [-1, -1, 1], abs=1e-9)
        assert a.radius_m == b.radius_m > 0.0


def test_gravity_pulls_a_stretched_arm_down_about_its_shoulder() -> None:
    torque = ARM.gravity_torque_n_m(np.zeros(6), np.array([0.0, 0.0, 1.0]))
    assert torque[0] == pytest.approx(0.0, abs=1e-9)
    assert 0.5 < torque[1] < 15.0  # about +y, which leans forward
    assert torque[1] > torque[4] > 0.0


def test_gravity_torque_is_the_slope_of_potential_energy() -> None:
    angles = np.array([0.2, 0.5, -0.3, 0.4, 0.6, 0.1])
    up = np.array([0.0, 0.0, 1.0])

    def energy(q: np.ndarray) -> float:
        masses = [body.mass_kg for body in ARM.bodies]
        middles = [0.5 * (c.p0_m + c.p1_m) for c in ARM.capsules(q, np.eye(4))]
        return 9.80665 * sum(m * float(p[2]) for m, p in zip(masses, middles, strict=True))

    slope = [(energy(angles + d) - energy(angles - d)) / 2e-6 for d in 1e-6 * np.eye(6)]
    assert ARM.gravity_torque_n_m(angles, up) == pytest.approx(-np.array(slope), abs=1e-6)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot", "expected XML"),
        (TEXT.replace('<child link="nozzle"/>', '<child link="gripper"/>'), "nozzle"),
        (TEXT.replace('type="revolute"', 'type="prismatic"', 1), "waist"),
        (TEXT.replace('<origin xyz="0 0 0.079"/>', '<origin xyz="0 0"/>'), "three numbers"),
        (TEXT.replace('<parent link="base_link"/>', '<parent link="nozzle"/>'), "loop"),
        (TEXT.replace('<cylinder radius="0.055" length="0.030"/>', '<box size="1 1 1"/>'), "cylinder"),
    ],
)
def test_a_wrong_description_says_what_is_wrong(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        read_urdf(text)
