from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from robot.aiming import ArmModel, inverse_kinematics, link_frames, nearest_solution, parse_urdf, within_limits
from robot.aiming.inverse_numeric import solve_numeric
from robot.aiming.inverse_spherical import find_spherical_wrist

RandomJoints = Callable[[int], np.ndarray]


def test_a_thousand_random_reachable_poses_are_all_solved(model: ArmModel, random_joints: RandomJoints) -> None:
    poses = link_frames(model, random_joints(1000))
    found = inverse_kinematics(model, poses.nozzle_m, poses.spray_axis, np.zeros(6))
    assert found.valid.any(axis=1).all()
    reached = link_frames(model, found.joints_rad[found.valid])
    pose_of = np.nonzero(found.valid)[0]
    assert np.linalg.norm(reached.nozzle_m - poses.nozzle_m[pose_of], axis=1).max() < 1e-9
    assert np.linalg.norm(np.cross(reached.spray_axis, poses.spray_axis[pose_of]), axis=1).max() < 1e-9


def test_the_posture_that_made_a_pose_is_among_its_solutions(model: ArmModel, random_joints: RandomJoints) -> None:
    joints = random_joints(300)
    poses = link_frames(model, joints)
    found = inverse_kinematics(model, poses.nozzle_m, poses.spray_axis, np.zeros(6))
    off = np.abs(np.mod(found.joints_rad - joints[:, None] + np.pi, 2 * np.pi) - np.pi)[..., :5].max(axis=-1)
    assert np.where(found.valid, off, np.inf).min(axis=1).max() < 1e-6


def test_solutions_lie_inside_the_limits_and_differ(model: ArmModel) -> None:
    pose = link_frames(model, np.array([0.2, -0.3, 0.4, 0.5, 0.6, 0.0]))
    found = inverse_kinematics(model, pose.nozzle_m, pose.spray_axis, np.zeros(6))
    solutions = found.joints_rad[found.valid]
    assert within_limits(model, solutions).all()
    assert len(solutions) >= 2
    assert len(np.unique(solutions.round(6), axis=0)) == len(solutions)


def test_the_turn_about_the_spray_axis_stays_at_the_seed(model: ArmModel, random_joints: RandomJoints) -> None:
    poses = link_frames(model, random_joints(20))
    found = inverse_kinematics(model, poses.nozzle_m, poses.spray_axis, np.array([0, 0, 0, 0, 0, 1.1]))
    assert found.joints_rad[found.valid][:, 5] == pytest.approx(1.1)


def test_a_straight_wrist_keeps_the_forearm_roll_of_the_seed(model: ArmModel) -> None:
    pose = link_frames(model, np.array([0.1, 0.2, 0.3, 0.0, 0.0, 0.0]))
    near = nearest_solution(model, pose.nozzle_m, pose.spray_axis, np.array([0.1, 0.2, 0.3, 0.7, 0.0, 0.0]))
    assert near == pytest.approx([0.1, 0.2, 0.3, 0.7, 0.0, 0.0], abs=1e-6)


def test_the_nearest_solution_is_the_one_with_the_smallest_largest_move(model: ArmModel) -> None:
    seed = np.array([0.3, -0.2, 0.5, 0.4, -0.6, 0.2])
    pose = link_frames(model, seed)
    assert nearest_solution(model, pose.nozzle_m, pose.spray_axis, seed) == pytest.approx(seed, abs=1e-9)


def test_a_pose_out_of_reach_has_no_solution(model: ArmModel) -> None:
    found = inverse_kinematics(model, np.array([1.5, 0, 0.4]), np.array([1.0, 0, 0]), np.zeros(6))
    assert not found.in_reach.any()
    assert nearest_solution(model, np.array([1.5, 0, 0.4]), np.array([1.0, 0, 0]), np.zeros(6)) is None


def test_a_pose_beyond_the_limits_is_in_reach_but_not_valid(urdf_text: str, random_joints: RandomJoints) -> None:
    stiff = parse_urdf(urdf_text.replace('lower="-3.14159265" upper="3.14159265"', 'lower="-0.1" upper="0.1"'))
    pose = link_frames(stiff, np.array([1.0, 0.3, 0.2, 0.0, 0.4, 0.0]))
    found = inverse_kinematics(stiff, pose.nozzle_m, pose.spray_axis, np.zeros(6))
    assert found.in_reach.any()
    assert not found.valid.any()


def test_a_whole_turn_is_added_when_only_that_lies_inside_the_limits(urdf_text: str) -> None:
    turned = parse_urdf(
        urdf_text.replace('lower="-3.14159265" upper="3.14159265"', 'lower="3.5" upper="9.0"', 1)  # the waist
    )
    pose = link_frames(turned, np.array([4.0, 0.3, 0.2, 0.3, 0.4, 0.0]))
    near = nearest_solution(turned, pose.nozzle_m, pose.spray_axis, np.array([6.0, 0.3, 0.2, 0.3, 0.4, 0.0]))
    assert near is not None
    assert 3.5 <= near[0] <= 9.0


def test_a_shoulder_offset_to_the_side_still_has_the_closed_form(urdf_text: str, random_joints: RandomJoints) -> None:
    offset = parse_urdf(urdf_text.replace('<origin xyz="0 0 0.04805"/>', '<origin xyz="0.02 0.05 0.04805"/>'))
    assert find_spherical_wrist(offset) is not None
    poses = link_frames(offset, random_joints(300))
    assert inverse_kinematics(offset, poses.nozzle_m, poses.spray_axis, np.zeros(6)).valid.any(axis=1).all()


def test_an_elbow_turning_the_other_way_still_has_the_closed_form(urdf_text: str, random_joints: RandomJoints) -> None:
    elbow = '<origin xyz="0.05955 0 0.300"/><axis xyz="0 1 0"/>'
    other_way = parse_urdf(urdf_text.replace(elbow, elbow.replace("0 1 0", "0 -1 0")))
    poses = link_frames(other_way, np.clip(random_joints(300), -1.6, 1.2))
    assert inverse_kinematics(other_way, poses.nozzle_m, poses.spray_axis, np.zeros(6)).valid.any(axis=1).all()


@pytest.fixture(scope="module")
def offset_wrist(urdf_text: str) -> ArmModel:
    arm = parse_urdf(urdf_text.replace('<origin xyz="0.069744 0 0"/>', '<origin xyz="0.05 0 0.055"/>'))
    assert find_spherical_wrist(arm) is None
    return arm


def test_an_offset_wrist_is_solved_by_iteration(offset_wrist: ArmModel, random_joints: RandomJoints) -> None:
    poses = link_frames(offset_wrist, random_joints(60))
    for k in range(60):
        assert nearest_solution(offset_wrist, poses.nozzle_m[k], poses.spray_axis[k], np.zeros(6)) is not None


def test_iteration_agrees_with_the_closed_form(model: ArmModel, random_joints: RandomJoints) -> None:
    poses = link_frames(model, random_joints(10))
    found = solve_numeric(model, poses.nozzle_m, poses.spray_axis, np.zeros(6))
    off_m = np.linalg.norm(link_frames(model, found).nozzle_m - poses.nozzle_m[:, None], axis=-1)
    assert off_m.min(axis=1).max() < 1e-6


def test_iteration_finds_nothing_out_of_reach(offset_wrist: ArmModel) -> None:
    assert nearest_solution(offset_wrist, np.array([0, 0, 2.0]), np.array([0, 0, 1.0]), np.zeros(6)) is None
