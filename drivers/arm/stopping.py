"""Stopping all servos that move, whoever else does not answer."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from drivers.arm import register_blocks as blocks
from drivers.arm.braking import stop_angle, stopped
from drivers.arm.joints import DynamixelSettings, JointSettings
from drivers.arm.register_blocks import Stopping, int32
from drivers.arm.servo_line import DEVICE, ServoLine
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout

STREAM_S = 0.05  # after the last goal for so long the joints are taken to move on as the goals did
PATIENCE_S = 0.012
ATTEMPTS = 2


class Stream:
    """The last two goals of a trajectory: where the joints are meant to be, and how fast, when nobody answers."""

    def __init__(self) -> None:
        self._goal_rad: tuple[float, ...] = ()
        self._speed_rad_s: tuple[float, ...] = ()
        self._at_s = -math.inf

    def note(self, now_s: float, goal_rad: Sequence[float]) -> None:
        gap_s = now_s - self._at_s
        if self._goal_rad and 0.0 < gap_s < STREAM_S:
            self._speed_rad_s = tuple((b - a) / gap_s for a, b in zip(self._goal_rad, goal_rad, strict=True))
        else:
            self._speed_rad_s = (0.0,) * len(goal_rad)
        self._goal_rad, self._at_s = tuple(goal_rad), now_s

    def motion(self, now_s: float) -> tuple[tuple[float, float], ...] | None:
        """Goal and speed of each joint (rad, rad/s); None when no goals are streaming."""
        if now_s - self._at_s > STREAM_S:
            return None
        return tuple(zip(self._goal_rad, self._speed_rad_s, strict=True))


class Stop:
    """One stop of the whole arm. ``profile`` is what bounds the braking (registers 108 to 115)."""

    def __init__(
        self, servos: ServoLine, settings: DynamixelSettings, profile: bytes, clock: Callable[[], float]
    ) -> None:
        self._servos, self._settings, self._profile, self._clock = servos, settings, profile, clock

    def do(self, streamed: Sequence[tuple[float, float]] | None) -> None:
        """Every moving joint gets a goal where its braking ends; that it has it is read back. Then the rest is told.

        ``DeviceTimeout``: some servo did not answer (it got its goal blindly if it was following a stream);
        ``DeviceFault``: some servo did not take its goal.
        """
        ids = self._settings.servo_ids
        read_s = self._clock()
        found = self._read(ids)
        lead_s = self._clock() - read_s
        goals: dict[int, int] = {}
        for k, joint in enumerate(self._settings.joints):
            moving = None if streamed is None else streamed[k]
            angle = self._stop_angle(joint, found, lead_s, moving)
            if angle is not None:
                goals |= {servo.servo_id: servo.tick_of(angle) for servo in joint.servos}
        refused = self._send(goals, [servo_id for servo_id in goals if servo_id in found]) if goals else []
        silent = [servo_id for servo_id in ids if servo_id not in found]
        if silent:
            raise self._told(DeviceTimeout, "every servo to answer that it stops", "silence", silent)
        if refused:
            raise self._told(DeviceFault, "every servo to take the goal it stops at", "another goal", refused)

    def _read(self, ids: Sequence[int]) -> dict[int, Stopping]:
        """All that can be read: together, then one by one those that a silent one before them kept from answering."""
        answers = self._servos.sync_read(blocks.STOPPING_ADDRESS, blocks.STOPPING_BYTES, ids)
        data = dict(answers.data)
        if data and answers.missing:
            with self._servos.patience(PATIENCE_S):
                for servo_id in answers.missing:
                    try:
                        data[servo_id] = self._servos.read(servo_id, blocks.STOPPING_ADDRESS, blocks.STOPPING_BYTES)
                    except (DeviceTimeout, DeviceFault):
                        continue
        return {servo_id: Stopping.of(raw) for servo_id, raw in data.items()}

    def _stop_angle(
        self, joint: JointSettings, found: dict[int, Stopping], lead_s: float, moving: tuple[float, float] | None
    ) -> float | None:
        """Both servos of a joint stop at one angle; of a joint that does not answer only its goals are known."""
        limit = self._settings.max_acceleration_rad_s2
        for servo in joint.servos:
            if servo.servo_id in found:
                streamed_rad_s = None if moving is None else moving[1]
                return stop_angle(joint, servo, found[servo.servo_id], lead_s, limit, streamed_rad_s)
        return None if moving is None else stopped(joint, *moving, limit)

    def _send(self, goals: dict[int, int], checked: Sequence[int]) -> list[int]:
        """The goals, again to those that have not taken them; who has not in the end."""
        wrong = list(goals)
        for _ in range(ATTEMPTS):
            self._servos.sync_write(blocks.PROFILE_ADDRESS, {i: self._profile + int32(goals[i]) for i in wrong})
            if not checked:
                return []
            taken = self._servos.sync_read(blocks.GOAL_ADDRESS, blocks.GOAL_BYTES, checked).data
            wrong = [i for i in checked if taken.get(i) != int32(goals[i])]
            if not wrong:
                return []
        return wrong

    def _told(self, kind: type[DeviceError], expected: str, found: str, ids: Sequence[int]) -> DeviceError:
        joint_of, names = self._settings.joint_of, self._settings.joint_names
        where = ", ".join(f"{names[joint_of[servo_id]]} (servo {servo_id})" for servo_id in ids)
        return kind(DEVICE, expected, f"{found} at {where}", "the others stop; keep clear of the arm")
