"""Joint dynamics."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.twin.kinematics import read_urdf
from drivers.twin.servo import STEP_S
from drivers.twin.servos import ENCODER_TICK_RAD, Servos
from tests.drivers.twin.rig import POINTING_RAD, STOW_RAD, URDF, quintic

ARM = read_urdf(URDF.read_text())
UP = np.array([0.0, 0.0, 1.0])
VELOCITY, ACCELERATION = 1.5, 4.0
ZEROS = (0.0,) * 6


def servos(zero_rad: tuple[float, ...] = ZEROS) -> Servos:
    return Servos(ARM, STOW_RAD, VELOCITY, ACCELERATION, zero_rad, UP)


def stream(device: Servos, duration_s: float, begin_s: float = 0.0) -> None:
    for k in range(round(duration_s / 0.02) + 1):
        device.advance(begin_s + 0.02 * k)
        device.goal(begin_s + 0.02 * k, quintic(STOW_RAD, POINTING_RAD, duration_s, 0.02 * k))


def test_a_single_goal_is_reached_without_overshoot() -> None:
    device = servos()
    device.goal(0.0, POINTING_RAD)
    reached = []
    for k in range(1, 1000):
        device.advance(0.01 * k)
        reached.append(device.angles_rad(0.01 * k)[1])
    assert max(reached) < POINTING_RAD[1] + 1e-3
    assert abs(reached[-1] - POINTING_RAD[1]) < 1e-4
    assert device.resting


@given(
    goal=st.tuples(*[st.floats(-3.0, 3.0)] * 6), again=st.tuples(*[st.floats(-3.0, 3.0)] * 6), at=st.floats(0.1, 3.0)
)
@settings(max_examples=25, deadline=None)
def test_no_joint_exceeds_its_limits_whatever_is_asked(
    goal: tuple[float, ...], again: tuple[float, ...], at: float
) -> None:
    device = servos()
    device.goal(0.0, goal)
    track = [device.angles_rad(0.0)]
    for k in range(1, 1200):
        if (k - 1) * STEP_S < at <= k * STEP_S:
            device.goal(k * STEP_S, again)
        device.advance(k * STEP_S)
        track.append(device.angles_rad(k * STEP_S))
    angles = np.array(track)
    speed = np.diff(angles, axis=0) / STEP_S
    low, high = (np.array([getattr(j, side) for j in ARM.joints]) for side in ("low_rad", "high_rad"))
    assert (angles >= low - 1e-9).all()
    assert (angles <= high + 1e-9).all()
    assert np.abs(speed).max() <= VELOCITY + 1e-9
    assert np.abs(np.diff(speed, axis=0)).max() / STEP_S <= ACCELERATION * 1.01


def test_a_stream_is_followed_with_the_servos_lag_only() -> None:
    device, duration_s = servos(), 2.2
    worst = 0.0
    for k in range(round(duration_s / 0.02) + 1):
        t = 0.02 * k
        device.advance(t)
        device.goal(t, quintic(STOW_RAD, POINTING_RAD, duration_s, t))
        lagging = np.array(quintic(STOW_RAD, POINTING_RAD, duration_s, max(0.0, t - 0.04)))
        worst = max(worst, float(np.abs(device.angles_rad(t) - lagging).max()))
    assert worst < 0.02


def test_hold_brakes_within_the_acceleration_limit_and_does_not_come_back() -> None:
    device = servos()
    stream(device, 2.2)
    device = servos()
    for k in range(56):
        device.advance(0.02 * k)
        device.goal(0.02 * k, quintic(STOW_RAD, POINTING_RAD, 2.2, 0.02 * k))
    device.hold()
    shoulder = [device.angles_rad(1.1)[1]]
    for k in range(1, 200):
        device.advance(1.1 + 0.01 * k)
        shoulder.append(device.angles_rad(1.1 + 0.01 * k)[1])
    assert all(b >= a - 1e-6 for a, b in pairwise(shoulder))
    assert shoulder[-1] - shoulder[0] <= VELOCITY**2 / (2 * ACCELERATION) + 0.04 * VELOCITY


def test_a_stream_that_ceases_ends_in_a_stop_beyond_and_not_in_a_return() -> None:
    device = servos()
    for k in range(56):
        device.advance(0.02 * k)
        device.goal(0.02 * k, quintic(STOW_RAD, POINTING_RAD, 2.2, 0.02 * k))
    shoulder = []
    for k in range(300):
        device.advance(1.1 + 0.01 * k)
        shoulder.append(device.angles_rad(1.1 + 0.01 * k)[1])
    assert all(b >= a - 1e-6 for a, b in pairwise(shoulder))
    assert device.resting


def test_the_encoder_reads_true_angle_plus_zero_offset_in_ticks() -> None:
    zero = (0.01, -0.01, 0.005, 0.0, 0.002, -0.004)
    device = servos(zero)
    state = device.reading(0.0, 0.0, np.random.default_rng(0))
    assert np.abs(np.subtract(state.position_rad, STOW_RAD)).max() < 3 * ENCODER_TICK_RAD
    ticks = np.array(state.position_rad) / ENCODER_TICK_RAD
    assert np.allclose(ticks, np.round(ticks))
    assert np.allclose(device.angles_rad(0.0), np.subtract(STOW_RAD, zero))


def test_a_stretched_arm_loads_its_shoulder_more_than_an_upright_one() -> None:
    rng = np.random.default_rng(0)
    upright = Servos(ARM, ZEROS, VELOCITY, ACCELERATION, ZEROS, UP)
    stretched = Servos(ARM, (0.0, math.pi / 2.6, -math.pi / 2.6, 0.0, 0.0, 0.0), VELOCITY, ACCELERATION, ZEROS, UP)
    loads = [abs(device.reading(0.0, 0.0, rng).load[1]) for device in (upright, stretched)]
    assert loads[1] > loads[0] + 0.05
    assert loads[1] < 1.0


def test_a_limp_joint_gives_way_and_the_others_hold() -> None:
    device = Servos(ARM, POINTING_RAD, VELOCITY, ACCELERATION, ZEROS, UP)
    device.servo_error(1, 0x20)
    device.advance(2.0)
    moved = np.abs(device.angles_rad(2.0) - POINTING_RAD)
    assert moved[1] > 0.05
    assert moved[[0, 2, 3, 4, 5]].max() < 1e-9


def test_jammed_joints_stay_and_go_on_when_freed() -> None:
    device = servos()
    device.goal(0.0, POINTING_RAD)
    device.advance(0.5)
    device.freeze(True)
    there = device.angles_rad(0.5)
    device.advance(3.0)
    assert np.abs(device.angles_rad(3.0) - there).max() < 1e-9
    device.freeze(False)
    device.advance(6.0)
    assert np.abs(device.angles_rad(6.0) - POINTING_RAD).max() < 1e-3


@given(looks=st.lists(st.floats(0.0, 2.5), max_size=15))
@settings(max_examples=20, deadline=None)
def test_it_does_not_matter_who_looks_when(looks: list[float]) -> None:
    watched, alone = servos(), servos()
    for device in (watched, alone):
        device.goal(0.0, POINTING_RAD)
    for look_s in sorted(looks):
        watched.advance(look_s)
    for device in (watched, alone):
        device.advance(3.0)
    assert np.array_equal(watched.angles_rad(3.0), alone.angles_rad(3.0))


def test_a_goal_that_brakes_nearly_as_hard_as_the_servo_can_is_not_overshot_after_a_late_start() -> None:
    """A trapezoid at 85 % of both limits that begins two milliradians off, as a planner starts from an encoder."""
    device = servos()
    speed, rate, way = 0.85 * VELOCITY, 0.85 * ACCELERATION, 0.95
    ramp_s = speed / rate
    end_s = way / speed + ramp_s
    farthest = 0.0
    for k in range(round(end_s / 0.02) + 60):
        t = min(0.02 * k, end_s)
        up, down = min(t, ramp_s), max(0.0, t - (end_s - ramp_s))
        share = (
            0.5 * rate * up**2 + speed * max(0.0, min(t, end_s - ramp_s) - ramp_s) + speed * down - 0.5 * rate * down**2
        )
        device.advance(0.02 * k)
        if 0.02 * k <= end_s + 0.02:
            device.goal(0.02 * k, (STOW_RAD[0] - 0.002 + share, *STOW_RAD[1:]))
        farthest = max(farthest, float(device.angles_rad(0.02 * k)[0]))
    assert farthest - (STOW_RAD[0] - 0.002 + way) < 0.012
    assert abs(float(device.angles_rad(end_s + 1.0)[0]) - (STOW_RAD[0] - 0.002 + way)) < 1e-3


def test_one_joint_moves_to_rest_while_the_others_stay() -> None:
    device = servos()
    assert device.joint_move(2, 0.2)
    device.advance(3.0)
    angles = device.angles_rad(3.0)
    assert abs(angles[2] - 0.2) < 1e-4
    assert np.delete(angles, 2).tolist() == np.delete(np.array(STOW_RAD), 2).tolist()
    assert device.resting


def test_a_move_that_interrupts_a_stream_ends_where_it_says_without_overshoot() -> None:
    device = servos()
    stream_until_s = 1.1
    for k in range(round(stream_until_s / 0.01) + 1):
        device.advance(0.01 * k)
        device.goal(0.01 * k, quintic(STOW_RAD, POINTING_RAD, 2.2, 0.01 * k))
    profile, speed = device.profiles[1]
    stop = profile + speed * abs(speed) / (2.0 * ACCELERATION)
    device.joint_move(1, stop)
    reached = []
    for k in range(1, 200):
        device.advance(stream_until_s + STEP_S * k)
        reached.append(float(device.angles_rad(stream_until_s + STEP_S * k)[1]))
    assert max(reached) < stop + 1e-3
    assert abs(reached[-1] - stop) < 1e-3


def test_a_joint_without_torque_sinks_alone() -> None:
    device = servos()
    device.joint_torque(1, False)
    assert not device.torque_on
    device.advance(1.0)
    angles = device.angles_rad(1.0)
    assert abs(angles[1] - STOW_RAD[1]) > 0.01
    assert np.delete(angles, 1).tolist() == np.delete(np.array(STOW_RAD), 1).tolist()
    device.joint_torque(1, True)
    held = float(device.angles_rad(1.0)[1])
    device.advance(3.0)
    assert abs(device.angles_rad(3.0)[1] - held) < 1e-3


def test_a_servo_keeps_to_a_profile_below_its_own_limits() -> None:
    device = servos()
    device.joint_profile(1, 0.3, 0.0)
    device.joint_move(1, 0.2)
    fastest = 0.0
    for k in range(1, 400):
        device.advance(0.01 * k)
        fastest = max(fastest, abs(device.profiles[1][1]))
    assert 0.29 < fastest <= 0.3 + 1e-9


def test_a_cradle_bears_a_limp_arm_until_it_has_left() -> None:
    device = servos()
    device.lie_in_cradle()
    device.advance(30.0)
    assert device.angles_rad(30.0).tolist() == list(STOW_RAD)
    device.torque(True)
    device.joint_move(1, STOW_RAD[1] + 0.5)
    device.advance(33.0)
    device.torque(False)
    device.advance(34.0)
    assert abs(device.angles_rad(34.0)[1] - (STOW_RAD[1] + 0.5)) > 0.01
