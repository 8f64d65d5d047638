from __future__ import annotations

import numpy as np
import pytest

from robot.aiming import ArmModel, Capsule, CollisionModel, Obstacles, RoverBody, Sphere, Thing, link_frames
from robot.geometry import transform_from_xyz_rpy
from tests.robot.aiming.rig import READY_RAD, STOW_RAD, Rig

MARGIN_M = 0.015
FREE_RAD = np.array([0.3, 0.2, 0.3, 0.2, 0.4, 0.0])


def _alone(model: ArmModel, obstacles: Obstacles | None = None) -> CollisionModel:
    return CollisionModel(model, obstacles or Obstacles(), MARGIN_M)


def test_a_stretched_arm_touches_nothing_of_itself(model: ArmModel) -> None:
    assert _alone(model).touched(FREE_RAD) == set()


def test_a_forearm_folded_down_touches_the_root(model: ArmModel) -> None:
    assert Thing.ARM in _alone(model).touched(np.array([0.0, -0.2, 1.6, 0.0, 2.0, 0.0]))


def test_gaps_to_itself_do_not_change_with_the_waist(model: ArmModel) -> None:
    turned = FREE_RAD + np.array([1.0, 0, 0, 0, 0, 0])
    gaps = _alone(model).clearances(np.stack([FREE_RAD, turned])).gap_m
    assert gaps[0] == pytest.approx(gaps[1], abs=1e-12)


def test_a_ball_before_the_nozzle_is_as_far_as_it_is(model: ArmModel) -> None:
    frames = link_frames(model, FREE_RAD)
    ball = Sphere(frames.nozzle_m + 0.1 * frames.spray_axis, 0.04)
    clearances = _alone(model, Obstacles(fruits=(ball,))).clearances(FREE_RAD[None])
    assert clearances.gap_m[0, clearances.thing == Thing.FRUIT].min() == pytest.approx(0.06, abs=1e-9)


def test_a_string_across_the_forearm_is_a_support_touched(model: ArmModel) -> None:
    elbow_m, wrist_m = link_frames(model, FREE_RAD).origin_m[[3, 5]]
    middle = (elbow_m + wrist_m) / 2
    up = np.array([0.0, 0.0, 1.0])
    string = Capsule(middle - up, middle + up, 0.005)
    assert _alone(model, Obstacles(supports=(string,))).touched(FREE_RAD) == {Thing.SUPPORT}


def test_the_upright_arm_under_the_camera_touches_the_rover(model: ArmModel) -> None:
    below_camera = transform_from_xyz_rpy((0.0, 0.05, 0.42), (0.0, 0.0, np.pi / 2))
    assert _alone(model, RoverBody().obstacles(below_camera)).touched(np.zeros(6)) == {Thing.ROVER}


def test_an_arm_reaching_down_touches_the_deck(model: ArmModel, rig: Rig) -> None:
    assert Thing.ROVER in _alone(model, rig.body).touched(np.array([np.pi, 1.25, 0.6, 0.0, 0.0, 0.0]))


def test_an_arm_raised_above_the_deck_stands_on_a_post() -> None:
    def parts(z_m: float) -> int:
        return len(RoverBody().obstacles(transform_from_xyz_rpy((0.15, 0.1, z_m), (0.0, 0.0, np.pi / 2))).body)

    assert parts(0.7) == parts(0.45) + 1


def test_obstacles_beyond_reach_are_left_out(model: ArmModel) -> None:
    far = Obstacles(fruits=(Sphere(np.array([3.0, 0, 0]), 0.05),))
    assert Thing.FRUIT not in _alone(model, far).clearances(FREE_RAD[None]).thing


def test_no_point_between_checks_strays_farther_than_the_sweep(model: ArmModel) -> None:
    steps = _alone(model).steps(np.stack([STOW_RAD, READY_RAD, FREE_RAD]), np.radians(2.0), 0.03)
    assert np.abs(np.diff(steps, axis=0)).max() <= np.radians(2.0) + 1e-12
    moved_m = np.linalg.norm(np.diff(link_frames(model, steps).origin_m, axis=0), axis=-1)
    assert moved_m.max() <= 0.03
    assert (steps[0] == STOW_RAD).all()
    assert steps[-1] == pytest.approx(FREE_RAD)


def test_a_way_through_a_fruit_is_not_free(model: ArmModel) -> None:
    there = FREE_RAD + np.array([0.8, 0, 0, 0, 0, 0])
    between = link_frames(model, (FREE_RAD + there) / 2).nozzle_m
    blocked = _alone(model, Obstacles(fruits=(Sphere(between, 0.03),)))
    assert not blocked.path_is_free(np.stack([FREE_RAD, there]), np.radians(2.0), 0.03)
    assert _alone(model).path_is_free(np.stack([FREE_RAD, there]), np.radians(2.0), 0.03)


def test_an_arm_too_near_may_leave_but_not_come_nearer(model: ArmModel) -> None:
    frames = link_frames(model, FREE_RAD)
    beside = np.cross(frames.spray_axis, [0.0, 0.0, 1.0])
    left = 1.0 if np.cross([0.0, 0.0, 1.0], frames.nozzle_m) @ beside > 0 else -1.0
    ball = Sphere(frames.nozzle_m + 0.05 * beside, 0.03)
    near = _alone(model, Obstacles(fruits=(ball,)))
    assert near.touched(FREE_RAD) == {Thing.FRUIT}
    turn = np.array([0.3 * left, 0, 0, 0, 0, 0])
    assert near.path_is_free(np.stack([FREE_RAD, FREE_RAD - turn]), np.radians(2.0), 0.03)
    assert not near.path_is_free(np.stack([FREE_RAD, FREE_RAD + turn]), np.radians(2.0), 0.03)
