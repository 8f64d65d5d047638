"""What holds for every arm posture, every move and every fruit."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.arm.values import JointTrajectory
from robot.aiming import (
    AimPlan,
    CollisionModel,
    MotionLimits,
    Unreachable,
    inverse_kinematics,
    joint_trajectory,
    link_frames,
    parse_urdf,
    plan,
    plan_joints,
    visiting_order,
    within_limits,
)
from robot.geometry import Vector
from tests.robot.aiming.rig import READY_RAD, STOW_RAD, URDF, demo_rig

MODEL = parse_urdf(URDF.read_text(encoding="utf-8"))
RIG = demo_rig()


def shares(count: int) -> st.SearchStrategy[Vector]:
    return st.lists(st.floats(0.0, 1.0), min_size=count, max_size=count).map(np.array)


joints = shares(6).map(lambda share: MODEL.lower_rad + share * (MODEL.upper_rad - MODEL.lower_rad))
fruit_m = shares(3).map(lambda share: np.array([-0.22, 0.42, 0.55]) + share * np.array([0.44, 0.38, 0.60]))
diameters = st.floats(0.05, 0.14)
limits = st.tuples(st.floats(0.2, 3.0), st.floats(0.5, 10.0)).map(
    lambda pair: MotionLimits(np.full(6, pair[0]), np.full(6, pair[1]))
)


@given(joints, joints)
@settings(deadline=None, max_examples=150, derandomize=True)
def test_inverse_kinematics_undoes_forward_kinematics(posture: Vector, seed: Vector) -> None:
    pose = link_frames(MODEL, posture)
    found = inverse_kinematics(MODEL, pose.nozzle_m, pose.spray_axis, seed)
    assert found.valid.any()
    again = link_frames(MODEL, found.joints_rad[found.valid])
    assert np.linalg.norm(again.nozzle_m - pose.nozzle_m, axis=-1).max() < 1e-4
    assert np.linalg.norm(np.cross(again.spray_axis, pose.spray_axis), axis=-1).max() < np.sin(np.radians(0.01))


@given(shares(3), shares(3), joints)
@settings(deadline=None, max_examples=100, derandomize=True)
def test_no_solution_ever_crosses_a_joint_limit(where: Vector, towards: Vector, seed: Vector) -> None:
    axis = 2.0 * towards - 1.0
    axis = axis / max(np.linalg.norm(axis), 1e-3) if np.linalg.norm(axis) > 1e-3 else np.array([1.0, 0.0, 0.0])
    found = inverse_kinematics(MODEL, 1.6 * where - 0.8, axis, seed)
    assert within_limits(MODEL, found.joints_rad[found.valid]).all()


@given(st.lists(joints, min_size=2, max_size=4), limits)
@settings(deadline=None, max_examples=100, derandomize=True)
def test_trajectories_keep_both_limits_and_meet_their_ends_exactly(way: list[Vector], allowed: MotionLimits) -> None:
    trajectory = joint_trajectory(np.stack(way), allowed, 0.02)
    positions = np.array(trajectory.positions_rad)
    assert (positions[0] == way[0]).all()
    assert np.abs(positions[-1] - way[-1]).max() <= 1e-8
    resting = np.concatenate([positions[:1], positions, positions[-1:]])
    speed = np.diff(resting, axis=0) / 0.02
    assert np.abs(speed).max() <= allowed.velocity_rad_s[0] * (1 + 1e-6)
    assert np.abs(np.diff(speed, axis=0)).max() / 0.02 <= allowed.acceleration_rad_s2[0] * (1 + 1e-6)


@given(fruit_m, diameters, st.floats(-0.22, 0.22), st.lists(st.tuples(fruit_m, diameters), max_size=6))
@settings(deadline=None, max_examples=40, derandomize=True)
def test_every_plan_aims_exactly_and_touches_nothing(
    centre: Vector, diameter_m: float, stem_x_m: float, neighbours: list[tuple[Vector, float]]
) -> None:
    apart = [(c, d) for c, d in neighbours if np.linalg.norm(c - centre) > (d + diameter_m) / 2]
    row = RIG.row((stem_x_m - 0.45, stem_x_m, stem_x_m + 0.45), ((centre, diameter_m), *apart))
    target = RIG.arm(*centre)
    found = plan(target, diameter_m, STOW_RAD, MODEL, RIG.parameters, row)
    if isinstance(found, Unreachable):
        return
    assert isinstance(found, AimPlan)
    frames = link_frames(MODEL, np.array(found.goal_rad))
    assert np.linalg.norm(frames.nozzle_m + found.stand_off_m * frames.spray_axis - target) < 1e-4
    assert found.stand_off_m >= diameter_m / 2 + RIG.parameters.min_gap_m - 1e-9
    positions = np.array(found.trajectory.positions_rad)
    assert (positions[0] == STOW_RAD).all()
    assert within_limits(MODEL, positions).all()
    collisions = CollisionModel(MODEL, row, RIG.parameters.collision_margin_m)
    fine = collisions.steps(positions, np.radians(0.5), 0.005)
    assert collisions.clearances(positions[-1:]).least_m()[0] >= RIG.parameters.collision_margin_m - 1e-9
    assert collisions.clearances(fine).least_m().min() > 0.0


@given(joints)
@settings(deadline=None, max_examples=25, derandomize=True)
def test_a_planned_move_never_comes_nearer_than_it_stood_or_the_margin(start: Vector) -> None:
    moved = plan_joints(start, READY_RAD, MODEL, RIG.parameters, RIG.row((0.1,)))
    if isinstance(moved, Unreachable):
        return
    assert isinstance(moved, JointTrajectory)
    collisions = CollisionModel(MODEL, RIG.row((0.1,)), RIG.parameters.collision_margin_m)
    gaps = collisions.clearances(np.array(moved.positions_rad)).gap_m
    allowed = np.minimum(gaps[0] - 0.001, RIG.parameters.collision_margin_m)
    assert (gaps >= allowed - RIG.parameters.path_sweep_m / 2).all()


@given(st.lists(joints, max_size=9), joints)
@settings(deadline=None, max_examples=40, derandomize=True)
def test_an_order_visits_each_goal_exactly_once(goals: list[Vector], start: Vector) -> None:
    allowed = MotionLimits(np.full(6, 1.5), np.full(6, 4.0))
    order = visiting_order(np.array(goals).reshape(-1, 6), start, allowed)
    assert sorted(order) == list(range(len(goals)))
