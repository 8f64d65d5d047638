from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from drivers.arm.values import JointTrajectory
from robot.aiming import (
    AimPlan,
    ArmModel,
    CollisionModel,
    Obstacles,
    Sphere,
    Thing,
    Unreachable,
    WhyUnreachable,
    link_frames,
    motion_limits,
    parse_urdf,
    plan,
    plan_joints,
    stand_off_m,
    within_limits,
)
from robot.aiming.capsules import segment_point_m
from tests.robot.aiming.rig import READY_RAD, STOW_RAD, Rig

STEMS_X_M = (-0.2, 0.25)
FRUIT_M, DIAMETER_M = np.array([0.05, 0.60, 0.80]), 0.08


@pytest.fixture(scope="module")
def aimed(model: ArmModel, rig: Rig) -> AimPlan:
    found = plan(rig.arm(*FRUIT_M), DIAMETER_M, STOW_RAD, model, rig.parameters, rig.row(STEMS_X_M))
    assert isinstance(found, AimPlan)
    return found


def test_the_nozzle_points_at_the_fruit_from_its_stand_off(aimed: AimPlan, model: ArmModel, rig: Rig) -> None:
    frames = link_frames(model, np.array(aimed.goal_rad))
    assert frames.nozzle_m == pytest.approx(aimed.nozzle_m, abs=1e-6)
    assert frames.spray_axis == pytest.approx(aimed.axis, abs=1e-6)
    assert frames.nozzle_m + aimed.stand_off_m * frames.spray_axis == pytest.approx(rig.arm(*FRUIT_M), abs=1e-6)
    assert aimed.stand_off_m == pytest.approx(stand_off_m(DIAMETER_M, rig.parameters))


def test_a_free_fruit_is_sprayed_from_the_side_that_the_camera_sees(aimed: AimPlan, rig: Rig) -> None:
    seen_along = rig.arm(*FRUIT_M) - np.array(rig.parameters.camera_m)
    cosine = float(aimed.axis @ seen_along) / float(np.linalg.norm(seen_along))
    assert math.degrees(math.acos(min(1.0, cosine))) < 45.0


def test_the_trajectory_leads_from_the_present_angles_to_the_goal(aimed: AimPlan, model: ArmModel) -> None:
    assert aimed.trajectory.positions_rad[0] == tuple(STOW_RAD)
    assert aimed.trajectory.goal_rad == aimed.goal_rad
    assert within_limits(model, np.array(aimed.trajectory.positions_rad)).all()
    assert aimed.trajectory.duration_s < 3.0


def test_the_whole_way_keeps_the_margin(aimed: AimPlan, model: ArmModel, rig: Rig) -> None:
    scene = rig.row(STEMS_X_M, ((FRUIT_M, DIAMETER_M),))
    gaps = CollisionModel(model, scene, 0.015).clearances(np.array(aimed.trajectory.positions_rad))
    assert gaps.least_m().min() >= 0.010  # 15 mm at the checked postures, a little less between them


def test_most_fruit_of_a_stop_is_reached(model: ArmModel, rig: Rig) -> None:
    random = np.random.default_rng(11)
    reached = 0
    for _ in range(60):
        centre = random.uniform([-0.22, 0.42, 0.55], [0.22, 0.80, 1.15])
        stem_x_m = float(random.uniform(-0.22, 0.22))
        row = rig.row((stem_x_m - 0.45, stem_x_m, stem_x_m + 0.45))
        found = plan(rig.arm(*centre), float(random.uniform(0.05, 0.14)), STOW_RAD, model, rig.parameters, row)
        reached += isinstance(found, AimPlan)
    assert reached >= 57


def test_the_same_question_gets_the_same_answer(aimed: AimPlan, model: ArmModel, rig: Rig) -> None:
    again = plan(rig.arm(*FRUIT_M), DIAMETER_M, STOW_RAD, model, rig.parameters, rig.row(STEMS_X_M))
    assert isinstance(again, AimPlan)
    assert again.trajectory == aimed.trajectory


def test_the_target_among_the_known_fruit_is_taken_for_the_target(aimed: AimPlan, model: ArmModel, rig: Rig) -> None:
    known = rig.row(STEMS_X_M, ((FRUIT_M + np.array([0.002, 0.0, 0.004]), 0.082),))
    found = plan(rig.arm(*FRUIT_M), DIAMETER_M, STOW_RAD, model, rig.parameters, known)
    assert isinstance(found, AimPlan)
    assert found.goal_rad == pytest.approx(aimed.goal_rad)


def test_a_fruit_in_front_is_sprayed_around(model: ArmModel, rig: Rig) -> None:
    before = FRUIT_M + np.array([0.0, -0.10, 0.03])
    row = rig.row(STEMS_X_M, ((FRUIT_M, DIAMETER_M), (before, 0.07)))
    found = plan(rig.arm(*FRUIT_M), DIAMETER_M, READY_RAD, model, rig.parameters, row)
    assert isinstance(found, AimPlan)
    beside_m = segment_point_m(found.nozzle_m, rig.arm(*FRUIT_M), rig.arm(*before))
    assert float(beside_m) > 0.035


def test_a_fruit_between_two_nozzle_poses_is_gone_around(model: ArmModel, rig: Rig) -> None:
    first = plan(rig.arm(-0.15, 0.62, 0.80), 0.06, READY_RAD, model, rig.parameters, rig.body)
    assert isinstance(first, AimPlan)
    start = np.array(first.goal_rad)
    straight = plan(rig.arm(0.2, 0.62, 0.80), 0.06, start, model, rig.parameters, rig.body)
    assert isinstance(straight, AimPlan)
    between = (link_frames(model, (start + np.array(straight.goal_rad)) / 2)).nozzle_m
    blocked = replace(rig.body, fruits=(Sphere(between, 0.03),))
    found = plan(rig.arm(0.2, 0.62, 0.80), 0.06, start, model, rig.parameters, blocked)
    assert isinstance(found, AimPlan)
    gaps = CollisionModel(model, blocked, 0.015).clearances(np.array(found.trajectory.positions_rad))
    assert gaps.gap_m[:, gaps.thing == Thing.FRUIT].min() > 0.010


def test_a_fruit_beyond_the_row_is_out_of_reach(model: ArmModel, rig: Rig) -> None:
    found = plan(rig.arm(0.0, 1.6, 0.8), 0.08, READY_RAD, model, rig.parameters, rig.body)
    assert found == Unreachable(WhyUnreachable.TOO_FAR)


def test_a_fruit_inside_the_hole_about_the_shoulder_is_too_near(urdf_text: str, rig: Rig) -> None:
    short_forearm = parse_urdf(urdf_text.replace('<origin xyz="0.200 0 0"/>', '<origin xyz="0.020 0 0"/>'))
    from_above = replace(rig.parameters, camera_m=(0.05, 0.0, 1.0), fan_half_angle_rad=0.0, fan_directions=1)
    found = plan(np.array([0.05, 0.0, -0.10]), 0.05, READY_RAD, short_forearm, from_above, Obstacles())
    assert found == Unreachable(WhyUnreachable.TOO_NEAR)


def test_a_fruit_behind_a_stiff_waist_breaks_joint_limits(urdf_text: str, rig: Rig) -> None:
    stiff = parse_urdf(urdf_text.replace('lower="-3.14159265" upper="3.14159265"', 'lower="-0.3" upper="0.3"'))
    straight_only = replace(rig.parameters, fan_half_angle_rad=0.0, fan_directions=1, ready_rad=(0.0,) * 6)
    straight_only = replace(straight_only, camera_m=(-0.2, -0.1, 0.4))
    found = plan(np.array([0.3, 0.5, 0.4]), 0.05, np.zeros(6), stiff, straight_only, Obstacles())
    assert found == Unreachable(WhyUnreachable.JOINT_LIMITS)


def test_a_fruit_inside_the_rover_is_refused_for_the_rover(model: ArmModel, rig: Rig) -> None:
    found = plan(rig.arm(-0.05, 0.05, 0.35), 0.05, READY_RAD, model, rig.parameters, rig.body)
    assert found == Unreachable(WhyUnreachable.SELF_COLLISION)


def test_no_pose_sprays_across_the_camera(model: ArmModel, rig: Rig) -> None:
    fruit_m, camera_m = np.array([0.0, -0.10, 1.0]), np.array([0.0, 0.03, 0.88])
    found = plan(rig.arm(*fruit_m), 0.08, READY_RAD, model, rig.parameters, rig.body)
    assert isinstance(found, AimPlan)
    beside_m = float(segment_point_m(found.nozzle_m, rig.arm(*fruit_m), rig.arm(*camera_m)))
    assert beside_m > 0.02 + found.stand_off_m * math.tan(rig.parameters.cone_half_angle_rad)


def test_a_fruit_behind_a_fence_of_canes_is_refused_for_the_plants(model: ArmModel, rig: Rig) -> None:
    fence = rig.row(tuple(np.arange(-0.6, 0.9, 0.04).tolist()))
    found = plan(rig.arm(0.05, 0.80, 0.80), 0.05, READY_RAD, model, rig.parameters, fence)
    assert found == Unreachable(WhyUnreachable.PLANT_COLLISION)


def test_a_walled_in_arm_has_no_path(model: ArmModel, rig: Rig) -> None:
    frames = link_frames(model, STOW_RAD)
    cage = tuple(
        Sphere(frames.nozzle_m + 0.045 * direction, 0.012)
        for direction in np.concatenate([np.eye(3), -np.eye(3), 0.7 * (np.eye(3) + np.roll(np.eye(3), 1, axis=1))])
        if float(direction @ frames.spray_axis) > -0.6
    )
    found = plan(rig.arm(*FRUIT_M), DIAMETER_M, STOW_RAD, model, rig.parameters, replace(rig.body, fruits=cage))
    assert found == Unreachable(WhyUnreachable.NO_PATH)


def test_a_goal_beyond_the_limits_is_refused(model: ArmModel, rig: Rig) -> None:
    found = plan_joints(STOW_RAD, np.array([0, 2.0, 0, 0, 0, 0]), model, rig.parameters, rig.body)
    assert found == Unreachable(WhyUnreachable.JOINT_LIMITS)


def test_a_goal_in_the_deck_or_a_cane_is_refused(model: ArmModel, rig: Rig) -> None:
    into_deck = np.array([3.1, 1.25, 0.6, 0.0, 0.0, 0.0])
    refused = plan_joints(STOW_RAD, into_deck, model, rig.parameters, rig.body)
    assert refused == Unreachable(WhyUnreachable.SELF_COLLISION)
    cane_at_goal = rig.row((float(rig.base_from_arm.apply(link_frames(model, np.zeros(6)).nozzle_m)[0]),))
    stretched = np.array([0.0, 0.6, -0.6, 0.0, 0.0, 0.0])
    refused = plan_joints(STOW_RAD, stretched, model, rig.parameters, cane_at_goal)
    assert refused == Unreachable(WhyUnreachable.PLANT_COLLISION)


def test_speeds_stay_below_the_configured_share_of_both_limits(model: ArmModel, rig: Rig) -> None:
    slow = replace(rig.parameters, max_velocity_rad_s=0.5, max_acceleration_rad_s2=1.0)
    trajectory = plan_joints(STOW_RAD, READY_RAD, model, slow, rig.body)
    assert isinstance(trajectory, JointTrajectory)
    speed = np.diff(np.array(trajectory.positions_rad), axis=0) / 0.02
    assert np.abs(speed).max() <= 0.85 * 0.5 + 1e-9
    assert np.abs(np.diff(speed, axis=0)).max() / 0.02 <= 0.85 * 1.0 + 1e-6
    assert motion_limits(model, slow).velocity_rad_s.max() == pytest.approx(0.425)


def test_a_reading_just_beyond_a_limit_does_not_keep_the_arm_from_moving(model: ArmModel, rig: Rig) -> None:
    beyond = STOW_RAD + np.array([0.0, 0.0, model.upper_rad[2] + 0.002 - STOW_RAD[2], 0.0, 0.0, 0.0])
    found = plan(rig.arm(*FRUIT_M), DIAMETER_M, beyond, model, rig.parameters, rig.row(STEMS_X_M))
    assert isinstance(found, AimPlan)
    assert found.trajectory.positions_rad[0] == tuple(beyond)
    assert within_limits(model, np.array(found.goal_rad))


def test_an_arm_that_is_there_already_stays(aimed: AimPlan, model: ArmModel, rig: Rig) -> None:
    again = plan(rig.arm(*FRUIT_M), DIAMETER_M, np.array(aimed.goal_rad), model, rig.parameters, rig.row(STEMS_X_M))
    assert isinstance(again, AimPlan)
    assert again.goal_rad == pytest.approx(aimed.goal_rad, abs=1e-9)
    assert again.trajectory.duration_s == 0.0


@pytest.mark.parametrize("centre", [[math.nan, 0.3, 0.3], [0.3, 0.3], [math.inf, 0, 0]])
def test_impossible_numbers_are_refused(model: ArmModel, rig: Rig, centre: list[float]) -> None:
    with pytest.raises(ValueError, match="fruit_centre_m: expected 3 finite numbers"):
        plan(np.array(centre), 0.08, STOW_RAD, model, rig.parameters, rig.body)
    with pytest.raises(ValueError, match="joints_rad: expected 6 finite numbers"):
        plan(rig.arm(*FRUIT_M), 0.08, np.full(6, math.nan), model, rig.parameters, rig.body)


def test_a_fruit_that_others_hide_from_every_side_is_not_aimed_at(model: ArmModel, rig: Rig) -> None:
    """Otherwise the fruit in front would get its neighbour's dose on top of its own."""
    target = rig.arm(*FRUIT_M)
    toward_camera = np.array(rig.parameters.camera_m) - target
    toward_camera /= np.linalg.norm(toward_camera)
    one_side = replace(rig.parameters, fan_half_angle_rad=math.radians(10.0), fan_directions=9)
    in_front = Sphere(target + 0.05 * toward_camera, 0.025)
    found = plan(target, 0.06, READY_RAD, model, one_side, replace(rig.body, fruits=(in_front,)))
    assert found == Unreachable(WhyUnreachable.HIDDEN)
    assert isinstance(plan(target, 0.06, READY_RAD, model, one_side, rig.body), AimPlan)
