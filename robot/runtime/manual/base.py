"""Driving the base by hand: a short step, or as long as a key is held."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Protocol

from drivers.errors import DeviceTimeout
from robot import navigation
from robot.actuation import Refused
from robot.clock import work
from robot.errors import UsageError
from robot.mission.rolling import RollingWatch
from robot.runtime.manual.session import ByHand

LONGEST_STEP_M = 0.5
CONSOLE_HEARTBEAT_S = 0.5  # without a key press for this long the base stops
LOOK_EVERY_S = 0.05


class Keys(Protocol):
    """A keyboard."""

    def within(self, timeout_s: float) -> tuple[str, ...] | None:
        """The names of keys pressed until the first batch or the time-out; None when the terminal is gone. Blocks."""
        ...


def check_step(by_m: float) -> None:
    if not (math.isfinite(by_m) and 0.0 < abs(by_m) <= LONGEST_STEP_M):
        raise UsageError(
            f"--forward-m {by_m:g}: expected a step of at most {LONGEST_STEP_M:g} m, forward or (minus) back"
        )


async def step(hands: ByHand, by_m: float, speed_m_s: float) -> float:
    """Drive straight by ``by_m`` as odometry counts it; returns how far it went. ``DeviceError`` when it does not."""
    check_step(by_m)
    _require_stowed(hands)
    limits = replace(hands.settings.drive, max_speed_m_s=min(speed_m_s, hands.settings.drive.max_speed_m_s))
    start_m = hands.localiser.pose.x_m
    deadline_s = hands.now_s() + 10.0 + 3.0 * abs(by_m) / limits.max_speed_m_s
    rolling, commanded_m_s = RollingWatch(), 0.0
    await hands.record(f"jog base by {by_m:g} m")
    while True:
        reading, pose = hands.actuation.odometry, hands.localiser.pose
        assert reading is not None  # the session began with one
        rolling.check(reading, commanded_m_s)
        order = navigation.command(pose, start_m + by_m, reading.speed_m_s, commanded_m_s, limits)
        if order.arrived:
            await hands.actuation.halt_base()
            return pose.x_m - start_m
        if hands.now_s() > deadline_s:
            way = f"{by_m:g} m", f"{pose.x_m - start_m:.3f} m"
            raise DeviceTimeout("wheels", *way, "look for what blocks or slips")
        await hands.actuation.drive(order.speed_m_s, order.yaw_rate_rad_s)
        commanded_m_s = order.speed_m_s
        await asyncio.sleep(limits.period_s)


async def hold_to_run(hands: ByHand, keys: Keys, speed_m_s: float) -> float:
    """Drive while presses of a moving key keep coming; any other key stops, ``q`` ends. Returns the metres gone.

    The base stands within ``CONSOLE_HEARTBEAT_S`` of the last press, and at once when the terminal is gone. Turning
    keeps the rims of the wheels at ``speed_m_s``.
    """
    _require_stowed(hands)
    await hands.record(f"jog base by keys, at most {speed_m_s:g} m/s")
    moves = _moves(speed_m_s, hands.settings.track_m)
    driven_m, last_x_m = 0.0, hands.localiser.pose.x_m
    motion: tuple[float, float] | None = None
    pressed_s = -math.inf
    while True:
        pressed = await work(lambda: keys.within(LOOK_EVERY_S), LOOK_EVERY_S)
        if pressed is None or "q" in pressed:
            await hands.actuation.halt_base()
            return driven_m + abs(hands.localiser.pose.x_m - last_x_m)
        wanted = moves.get(pressed[-1]) if pressed else motion
        if pressed:
            pressed_s = hands.now_s()
        if hands.now_s() + LOOK_EVERY_S > pressed_s + CONSOLE_HEARTBEAT_S:
            wanted = None
        if wanted is not None:
            await hands.actuation.drive(*wanted)
        elif motion is not None:
            await hands.actuation.halt_base()
        motion = wanted
        driven_m += abs(hands.localiser.pose.x_m - last_x_m)
        last_x_m = hands.localiser.pose.x_m


def _moves(speed_m_s: float, track_m: float) -> Mapping[str, tuple[float, float]]:
    """Speed and yaw rate by key."""
    turn_rad_s = 2.0 * speed_m_s / track_m
    ahead, back, left, right = (speed_m_s, 0.0), (-speed_m_s, 0.0), (0.0, turn_rad_s), (0.0, -turn_rad_s)
    return {"w": ahead, "s": back, "a": left, "d": right, "up": ahead, "down": back, "left": left, "right": right}


def _require_stowed(hands: ByHand) -> None:
    if not hands.actuation.arm_stowed:
        raise Refused("the base does not drive with the arm unfolded; stow it first: sprayer arm home")
