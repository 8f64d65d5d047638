from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from robot.aiming import ArmModel, link_frames, nozzle_jacobian, within_limits
from robot.aiming.kinematics import joint_reach_m


def test_at_angle_zero_the_nozzle_points_forward_where_the_dimensions_put_it(model: ArmModel) -> None:
    frames = link_frames(model, np.zeros(6))
    assert frames.nozzle_m == pytest.approx([0.05955 + 0.2 + 0.1 + 0.069744 + 0.07, 0.0, 0.079 + 0.04805 + 0.3])
    assert frames.spray_axis == pytest.approx([1, 0, 0])


def test_a_quarter_turn_of_the_waist_turns_the_nozzle_to_the_left(model: ArmModel) -> None:
    frames = link_frames(model, np.array([np.pi / 2, 0, 0, 0, 0, 0]))
    assert frames.spray_axis == pytest.approx([0, 1, 0], abs=1e-12)
    assert frames.nozzle_m == pytest.approx([0, 0.499294, 0.42705], abs=1e-12)


def test_the_shoulder_leans_the_upper_arm_forward_and_down(model: ArmModel) -> None:
    elbow_m = link_frames(model, np.array([0, np.pi / 2, 0, 0, 0, 0])).origin_m[3]
    assert elbow_m == pytest.approx([0.3, 0, 0.12705 - 0.05955])


def test_many_postures_at_once_equal_one_by_one(model: ArmModel, random_joints: Callable[[int], np.ndarray]) -> None:
    joints = random_joints(5)
    together = link_frames(model, joints)
    for k in range(5):
        one = link_frames(model, joints[k])
        assert together.origin_m[k] == pytest.approx(one.origin_m)
        assert together.rotation[k] == pytest.approx(one.rotation)


def test_the_jacobian_is_the_derivative_of_the_nozzle_pose(
    model: ArmModel, random_joints: Callable[[int], np.ndarray]
) -> None:
    joints = random_joints(10)
    jacobian = nozzle_jacobian(model, joints)
    for j in range(6):
        step = np.zeros(6)
        step[j] = 1e-6
        ahead, behind = link_frames(model, joints + step), link_frames(model, joints - step)
        assert (ahead.nozzle_m - behind.nozzle_m) / 2e-6 == pytest.approx(jacobian[:, :3, j], abs=1e-7)
        axis_rate = (ahead.spray_axis - behind.spray_axis) / 2e-6
        turning = np.cross(jacobian[:, 3:, j], link_frames(model, joints).spray_axis)
        assert axis_rate == pytest.approx(turning, abs=1e-7)


def test_no_point_of_the_arm_moves_farther_than_the_reach_of_its_joints_says(
    model: ArmModel, random_joints: Callable[[int], np.ndarray]
) -> None:
    joints = random_joints(200)
    turned = joints + np.random.default_rng(1).uniform(-0.05, 0.05, joints.shape)
    bound_m = np.abs(turned - joints) @ joint_reach_m(model)
    moved_m = np.linalg.norm(link_frames(model, turned).origin_m - link_frames(model, joints).origin_m, axis=-1)
    assert (moved_m.max(axis=1) <= bound_m).all()


def test_limits_hold_for_every_joint(model: ArmModel) -> None:
    assert within_limits(model, model.upper_rad)
    for j in range(6):
        beyond = np.zeros(6)
        beyond[j] = model.upper_rad[j] + 0.01
        assert not within_limits(model, beyond)


def test_a_wrong_number_of_angles_is_refused(model: ArmModel) -> None:
    with pytest.raises(ValueError, match="expected 6 joint angles"):
        link_frames(model, np.zeros(5))
