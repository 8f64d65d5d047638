"""An arm of Dynamixel X-series servos on one serial bus."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress

import numpy as np

from drivers.arm.following import HEARTBEAT_S, Follower
from drivers.arm.joints import DynamixelSettings
from drivers.arm.servo_group import ServoGroup
from drivers.arm.servo_health import ArmDiagnostics, told
from drivers.arm.servo_line import DEVICE
from drivers.arm.values import ArmState, JointTrajectory
from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceRefused
from drivers.serial_port import SerialPort
from drivers.stop_lane import StopLane

USER = "arm"
START_TOLERANCE_RAD = 0.1
LIMIT_TOLERANCE_RAD = 0.01
POLL_S = 0.1
RECENT_S = 0.03


class DynamixelArm:
    """Implements ``drivers.arm.interface.Arm``; ``clock`` gives loop time.

    A servo that was rebooted is a ``DeviceFault`` until the arm is opened again; one that is silent is a
    ``DeviceTimeout`` until it answers again. Between its calls a task looks after the servos.
    """

    def __init__(self, settings: DynamixelSettings, port: SerialPort, clock: Callable[[], float]) -> None:
        self._settings, self._port, self._clock = settings, port, clock
        self._group = ServoGroup(settings, clock)
        self._turn = 0  # counts trajectories and stops, so that each ends the one before
        self._following = False
        self._poller: asyncio.Task[None] | None = None
        self.stop_lane = StopLane(DEVICE, self.post_hold)  # servos that hear nothing stop by their bus watchdog

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self._settings.joint_names

    async def open(self) -> None:
        """Prove every servo; nothing moves, torque stays as it is. Opened again, it forgets what servos did wrong."""
        if self._poller is not None:
            await self.close()
        self._group.forget()
        await self._port.attach(USER, self._group.greet)
        self._poller = asyncio.create_task(self._look_after(), name="arm: look after the servos")

    async def close(self) -> None:
        """Stop if moving, disarm the servos' watchdogs, torque as the policy says."""
        poller, self._poller = self._poller, None
        if poller is None:
            return
        poller.cancel()
        await asyncio.wait({poller})
        try:
            with suppress(DeviceLost):  # without the host the servos stop and hold by themselves
                if self._following:
                    await asyncio.wrap_future(self.post_hold())
                await self._port.run(self._group.leave)
        finally:
            await self._port.detach(USER)

    async def state(self) -> ArmState:
        self._require_open()
        if self._following and (recent := self._group.recent_state(RECENT_S)) is not None:
            self._group.roster.require_sound()
            return recent
        state = await self._port.run(self._group.read_state)
        self._group.roster.require_sound()
        return state

    async def torque(self, on: bool) -> None:
        self._require_open()
        self._turn += 1
        if on:
            await self._port.run(lambda line: self._group.torque(line, True))
        else:
            await self._port.stop(lambda line: self._group.torque(line, False))

    async def hold(self) -> None:
        self._require_open()
        await asyncio.shield(asyncio.wrap_future(self.post_hold()))

    def post_hold(self) -> Future[None]:
        """Like ``hold``, from any thread and without waiting."""
        self._turn += 1
        return self._port.post_stop(self._group.brake)

    async def follow(self, trajectory: JointTrajectory) -> None:
        self._require_open()
        self.stop_lane.require_released()
        if self._following:
            raise DeviceRefused(DEVICE, "one trajectory at a time", "a second one", "wait for the first, or hold()")
        self._following = True
        self._turn += 1
        turn = self._turn  # taken before anything is awaited: a stop from here on ends it
        try:
            self._check(await self.state(), trajectory)
            await self._stream(trajectory, turn)
        finally:
            self._following = False

    def diagnostics(self) -> ArmDiagnostics:
        """What is known of servos and bus without asking them."""
        group = self._group
        return ArmDiagnostics(
            servos=tuple(told(health) for health in group.roster.health.values()),
            cycles=group.cadence.cycles,
            cycle_mean_s=group.cadence.mean_s,
            cycle_worst_s=group.cadence.worst_s,
            late_cycles=group.cadence.late,
            garbled=group.roster.garbled,
            silences=group.roster.silences,
            notes=group.notes,
        )

    def _check(self, state: ArmState, trajectory: JointTrajectory) -> None:
        """Where the arm is, what it can do, and that it works."""
        first, joints = trajectory.positions_rad[0], self._settings.joints
        if len(first) != len(joints):
            raise DeviceRefused(
                DEVICE, f"{len(joints)} joint angles", f"{len(first)}", "plan for the arm that is configured"
            )
        angles = np.asarray(trajectory.positions_rad)
        if not np.isfinite(angles).all():
            raise DeviceRefused(DEVICE, "finite joint angles", "nan or infinity", "plan the trajectory anew")
        apart = np.abs(np.subtract(first, state.position_rad))
        if apart.max() > START_TOLERANCE_RAD:
            raise DeviceRefused(
                DEVICE,
                f"a trajectory that starts within {START_TOLERANCE_RAD} rad of where the arm is",
                f"{apart.max():.3f} rad at {self.joint_names[int(apart.argmax())]}",
                "plan from the arm's present state",
            )
        for joint, low, high in zip(joints, angles.min(axis=0), angles.max(axis=0), strict=True):
            if low < joint.low_rad - LIMIT_TOLERANCE_RAD or high > joint.high_rad + LIMIT_TOLERANCE_RAD:
                raise DeviceRefused(
                    DEVICE, f"{joint.name} between {joint.low_rad:.3f} and {joint.high_rad:.3f} rad",
                    f"{low:.3f} to {high:.3f} rad", "plan within the joint's limits",
                )  # fmt: skip
        self._group.roster.require_working()

    async def _stream(self, trajectory: JointTrajectory, turn: int) -> None:
        """Failing, the follower has braked; for whatever else ends this the arm brakes and holds."""
        follower = Follower(self._port, self._group, trajectory, self._clock, lambda: self._turn == turn)
        following = asyncio.wrap_future(follower.done)
        following.add_done_callback(_retrieve)
        losses = self._port.statistics.losses
        try:
            await self._port.run(follower.start)
            while not following.done():
                await asyncio.wait({following}, timeout=HEARTBEAT_S)
                follower.heartbeat()
                self._require_open()
                if self._port.statistics.losses != losses and not following.done():
                    raise DeviceLost(DEVICE, "its port to be there", "it unplugged", "plug it in again")
        except BaseException as error:
            if self._turn == turn:
                await self._brake(error)
            raise
        following.result()

    async def _brake(self, error: BaseException) -> None:
        """The stop is under way before anything else; what it could not do is told with the error."""
        braking = asyncio.wrap_future(self.post_hold())
        braking.add_done_callback(_retrieve)
        try:
            await asyncio.shield(braking)
        except DeviceError as failed:
            error.add_note(f"stopping: {failed}")

    async def _look_after(self) -> None:
        """A silent bus is told by whoever asks for something; a lost port is looked for by the port."""
        while True:
            await asyncio.sleep(POLL_S)
            with suppress(DeviceLost):
                await self._port.run(self._group.poll)

    def _require_open(self) -> None:
        poller = self._poller
        if poller is None:
            raise DeviceLost(DEVICE, "an open connection", "a closed one", "open the device first")
        if poller.done() and not poller.cancelled() and (error := poller.exception()) is not None:
            raise DeviceFault(
                DEVICE, "the servos to be looked after", f"that to have ended ({error!r})", "open the arm again"
            ) from error


def _retrieve(future: asyncio.Future[None]) -> None:
    if not future.cancelled():
        future.exception()
