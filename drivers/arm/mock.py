"""An arm on the twin."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from drivers.arm.values import ArmState, JointTrajectory
from drivers.errors import DeviceFault, DeviceRefused
from drivers.twin.bus import Bus
from drivers.twin.commands import ArmGoal, ArmHold, ArmTorque
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin

TIMEOUT_S = 0.1
GOAL_PERIOD_S = 0.02
START_TOLERANCE_RAD = 0.1
WRONG_RAD = 0.05


class MockArm:
    """Implements ``drivers.arm.interface.Arm``; ``clock`` gives loop time. Goals are streamed at 50 Hz."""

    stop_lane = None

    def __init__(self, twin: Twin, clock: Callable[[], float]) -> None:
        self._twin, self._clock = twin, clock
        self._bus = Bus(twin, clock, "arm", twin.nominal.arm_round_trip_s, TIMEOUT_S)
        self._stream = 0  # counts the trajectories and holds, so that each ends the one before
        self._following = False

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self._twin.physics.geometry.joint_names

    async def open(self) -> None:
        await self._bus.connect()
        await self.state()

    async def close(self) -> None:
        self._bus.disconnect()

    async def state(self) -> ArmState:
        state = await self._bus.exchange(lambda: self._twin.arm_state(self._clock()))
        return self._bus.seen(state, _first_joint_off)

    async def torque(self, on: bool) -> None:
        self._stream += 1
        await self._bus.exchange(lambda: None, lambda _at_s: self._twin.apply(self._clock(), ArmTorque(on)))

    async def hold(self) -> None:
        self._stream += 1
        await self._bus.exchange(lambda: None, lambda _at_s: self._brake())

    async def follow(self, trajectory: JointTrajectory) -> None:
        if self._following:
            raise DeviceRefused("arm", "one trajectory at a time", "a second one", "wait for the first, or hold()")
        self._following = True
        self._stream += 1
        stream = self._stream  # taken before anything is awaited: a stop from here on ends it
        try:
            await self._check_start(await self.state(), trajectory)
            self._require_unstopped(stream)
            await self._send_goals(trajectory, stream)
        finally:
            self._following = False

    async def _check_start(self, state: ArmState, trajectory: JointTrajectory) -> None:
        first = trajectory.positions_rad[0]
        if len(first) != len(state.position_rad):
            raise DeviceRefused(
                "arm", f"{len(state.position_rad)} joint angles", f"{len(first)}", "plan for the arm that is configured"
            )
        if not np.isfinite(trajectory.positions_rad).all():
            raise DeviceRefused("arm", "finite joint angles", "nan or infinity", "plan the trajectory anew")
        apart = np.abs(np.subtract(first, state.position_rad))
        if apart.max() > START_TOLERANCE_RAD:
            name = self.joint_names[int(apart.argmax())]
            raise DeviceRefused(
                "arm",
                f"a trajectory that starts within {START_TOLERANCE_RAD} rad of where the arm is",
                f"{apart.max():.3f} rad at {name}",
                "plan from the arm's present state",
            )
        self._require_working(state.torque_on, state.hardware_error)

    def _require_unstopped(self, stream: int) -> None:
        if self._stream != stream:
            raise DeviceFault("arm", "to follow to the end", "a stop meanwhile", "plan from where the arm is")

    def _require_working(self, torque_on: bool, errors: Sequence[int]) -> None:
        for name, error in zip(self.joint_names, errors, strict=True):
            if error:
                raise DeviceFault("arm", "servos without errors", f"{name} reports 0x{error:02x}", "look at that servo")
        if not torque_on:
            raise DeviceFault("arm", "torque on", "torque off", "switch torque on when nobody is near the arm")

    async def _send_goals(self, trajectory: JointTrajectory, stream: int) -> None:
        """Cancelled or failing, the arm brakes and holds."""
        start_s, cycle, servos = self._clock(), 0, self._twin.physics.servos
        end_s = start_s + trajectory.duration_s
        try:
            while True:
                now_s = self._clock()
                await self._bus.require_answer()
                self._require_working(servos.torque_on, servos.errors)
                self._twin.apply(self._clock(), ArmGoal(trajectory.at(now_s - start_s)))
                if now_s >= end_s:
                    return
                cycle += 1
                due_s = min(start_s + cycle * GOAL_PERIOD_S, end_s)
                await asyncio.sleep(max(0.0, due_s - self._clock()))
                self._bus.require_open()
                self._require_unstopped(stream)
                await self._bus.require_clean_answer(self._bus.verb)
        except BaseException:
            if self._stream == stream and self._bus.verb is not Verb.OFF:
                self._brake()
            raise

    def _brake(self) -> None:
        self._twin.apply(self._clock(), ArmHold())


def _first_joint_off(state: ArmState) -> ArmState:
    first, *others = state.position_rad
    return replace(state, position_rad=(first + WRONG_RAD, *others))
