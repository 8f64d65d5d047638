"""The base by keys: it runs while presses keep coming, and stands when they do not."""

from __future__ import annotations

import pytest

from drivers.twin.commands import WheelsDrive, WheelsStop
from robot.actuation import Refused
from robot.runtime.manual.arm import jog_joint
from robot.runtime.manual.base import CONSOLE_HEARTBEAT_S, LOOK_EVERY_S, hold_to_run

from .hand_session import Session, by_hand

HOLD = ("w",)


class Keyboard:
    """Presses that were thought out beforehand: one batch a look; the last ends it."""

    def __init__(self, *batches: tuple[str, ...] | None) -> None:
        self._batches = list(batches)
        self.looks = 0

    def within(self, timeout_s: float) -> tuple[str, ...] | None:
        assert timeout_s == LOOK_EVERY_S
        self.looks += 1
        return self._batches.pop(0)


def drive(folder, *batches: tuple[str, ...] | None, speed_m_s: float = 0.1) -> tuple[Session, float]:
    gone_m: list[float] = []

    async def act(hands, _twin):
        gone_m.append(await hold_to_run(hands, Keyboard(*batches), speed_m_s))

    session = by_hand(folder, act)
    assert session.error is None
    return session, gone_m[0]


def held(key: str, seconds: float) -> list[tuple[str, ...]]:
    """A key held: its repeat comes at every other look."""
    return [(key,) if k % 2 == 0 else () for k in range(round(seconds / LOOK_EVERY_S))]


def silence(seconds: float) -> list[tuple[str, ...]]:
    return [()] * round(seconds / LOOK_EVERY_S)


@pytest.mark.parametrize(("key", "sign"), [("w", 1), ("up", 1), ("s", -1), ("down", -1)])
def test_the_base_runs_as_long_as_the_key_is_held_and_no_faster_than_the_limit(key, sign, tmp_path):
    session, gone_m = drive(tmp_path, *held(key, 2.0), ("x",), *silence(1.0), ("q",))
    x_m, y_m, heading = session.twin.base_pose
    assert sign * x_m == pytest.approx(0.1 * 2.0, abs=0.04)
    assert abs(y_m) < 0.01
    assert abs(heading) < 0.02
    assert gone_m == pytest.approx(abs(x_m), rel=0.03)
    speeds = [abs(timed.command.speed_m_s) for timed in session.process.commands if _is_drive(timed)]
    assert max(speeds) <= 0.1


@pytest.mark.parametrize(("key", "sign"), [("a", 1), ("left", 1), ("d", -1), ("right", -1)])
def test_it_turns_on_the_spot(key, sign, tmp_path):
    session, _ = drive(tmp_path, *held(key, 1.5), ("x",), *silence(1.0), ("q",))
    x_m, y_m, heading = session.twin.base_pose
    assert sign * heading > 0.3
    assert abs(x_m) < 0.02
    assert abs(y_m) < 0.02


def test_a_single_press_runs_for_the_heartbeat_and_not_longer(tmp_path):
    session, _ = drive(tmp_path, HOLD, *silence(3.0), ("q",))
    first_s = next(timed.t for timed in session.process.commands if _is_drive(timed))
    stop_s = next(t.t for t in session.process.commands if isinstance(t.command, WheelsStop) and t.t > first_s)
    assert stop_s - first_s <= CONSOLE_HEARTBEAT_S
    assert not [t for t in session.process.commands if _is_drive(t) and t.t > stop_s]
    assert 0.01 < session.twin.base_pose[0] < 0.1 * 0.5 + 0.02


@pytest.mark.parametrize("key", ["x", " ", "other", "1"])
def test_any_other_key_stops_at_once(key, tmp_path):
    session, _ = drive(tmp_path, *held("w", 1.0), (key,), *silence(1.0), ("q",))
    last_s = max(timed.t for timed in session.process.commands if _is_drive(timed))
    stop_s = min(t.t for t in session.process.commands if isinstance(t.command, WheelsStop) and t.t > last_s)
    assert stop_s - last_s <= 2 * LOOK_EVERY_S + 0.02
    assert 0.05 < session.twin.base_pose[0] < 0.13


def test_the_last_of_several_keys_counts(tmp_path):
    session, _ = drive(tmp_path, ("w", "x"), *silence(1.0), ("x", "w"), ("x",), *silence(0.5), ("q",))
    assert len([timed for timed in session.process.commands if _is_drive(timed)]) == 1


def test_a_terminal_that_is_gone_stops_the_base(tmp_path):
    session, _ = drive(tmp_path, *held("w", 1.0), None)
    assert session.modes[-1] == "disarmed"
    assert 0.05 < session.after.base_pose[0] < 0.13


def test_no_key_moves_nothing(tmp_path):
    session, gone_m = drive(tmp_path, *silence(2.0), ("q",))
    assert session.asked_after(0.0) == []
    assert gone_m == 0.0


def test_an_unfolded_arm_keeps_the_base_where_it_is(tmp_path):
    async def act(hands, _twin):
        await jog_joint(hands, "waist", 0.3, 1.0)
        await hold_to_run(hands, Keyboard(*held("w", 1.0)), 0.1)

    session = by_hand(tmp_path, act)
    assert isinstance(session.error, Refused)
    assert "sprayer arm home" in str(session.error)
    assert session.after.base_pose == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def _is_drive(timed) -> bool:
    command = timed.command
    return isinstance(command, WheelsDrive) and (command.speed_m_s, command.yaw_rate_rad_s) != (0.0, 0.0)
