from __future__ import annotations

import numpy as np
import pytest

from drivers.arm.values import JointTrajectory
from robot.aiming import ArmModel, CollisionModel, plan_joints, stow_problems
from tests.robot.aiming.rig import READY_RAD, STOW_RAD, Rig

ROW_SIDE_M = 0.30


def _problems(model: ArmModel, rig: Rig, stow: np.ndarray) -> str:
    collisions = CollisionModel(model, rig.body, 0.015)
    return "\n".join(stow_problems(stow, collisions, rig.base_from_arm, rig.views, ROW_SIDE_M))


def test_the_demo_stow_is_clear_inside_the_rover_and_out_of_both_views(model: ArmModel, rig: Rig) -> None:
    assert _problems(model, rig, STOW_RAD) == ""


def test_no_point_of_the_stowed_arm_is_seen(model: ArmModel, rig: Rig) -> None:
    starts, ends, radii = CollisionModel(model, rig.body, 0.0).placed_capsules(STOW_RAD[None])
    shares = np.linspace(0, 1, 21)[:, None, None]
    axis_points = (starts[0] + shares * (ends[0] - starts[0])).reshape(-1, 3)
    sphere = np.random.default_rng(0).normal(size=(200, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    skin = (axis_points[:, None] + np.tile(radii, 21)[:, None, None] * sphere).reshape(-1, 3)
    for view in rig.views:
        seen = view.arm_from_camera.inverse().apply(skin)
        ahead = seen[seen[:, 2] > 0.0]
        pixels = ahead @ view.K.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        width, height = view.image_size
        assert not ((np.abs(pixels - [319.5, 239.5]) <= [width / 2, height / 2]).all(axis=1)).any()


@pytest.mark.parametrize(
    ("stow", "complaint"),
    [
        ([0.0, 0.6, 0.2, 0.0, 0.0, 0.0], "outside the view of eye 0"),
        ([0.0, 0.9, 0.0, 0.0, 0.0, 0.0], "of the lane's middle"),
        ([0.0, -0.2, 1.6, 0.0, 2.0, 0.0], "of clearance"),
        ([0.0, -2.0, 1.3, 0.0, 0.7, 0.0], "inside the joint limits"),
    ],
)
def test_an_unfit_stow_is_refused_with_the_rule_it_breaks(
    model: ArmModel, rig: Rig, stow: list[float], complaint: str
) -> None:
    assert complaint in _problems(model, rig, np.array(stow))


def test_the_view_bound_is_the_distance_to_the_pyramid(rig: Rig) -> None:
    view = rig.views[0]
    below = view.arm_from_camera.apply(np.array([0.0, 1.0, 0.5]))
    slope = 240 / 457
    expected = (1.0 - 0.5 * slope) / np.hypot(1.0, slope) - 0.05
    assert view.outside_m(below, below, np.array(0.05)) == pytest.approx(expected)


def test_the_arm_unfolds_and_folds_again(model: ArmModel, rig: Rig) -> None:
    there = plan_joints(STOW_RAD, READY_RAD, model, rig.parameters, rig.row((-0.2, 0.25)))
    assert isinstance(there, JointTrajectory)
    assert there.goal_rad == tuple(READY_RAD)
    back = plan_joints(np.array(there.goal_rad), STOW_RAD, model, rig.parameters, rig.row((-0.2, 0.25)))
    assert isinstance(back, JointTrajectory)
    assert back.duration_s < 2.0
