"""The contract of an arm."""

from __future__ import annotations

from typing import Protocol

from drivers.arm.values import ArmState, JointTrajectory
from drivers.stop_lane import StopLane


class Arm(Protocol):
    """A serial arm under position control that keeps holding when nobody speaks to it.

    Every method raises a ``DeviceError``; every wait ends in ``DeviceTimeout``.
    """

    @property
    def stop_lane(self) -> StopLane | None:
        """The stop from any thread; None for a simulated device, which belongs to the event loop with its machine."""
        ...

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joint names from the base outwards, in the order of every tuple of angles."""
        ...

    async def open(self) -> None:
        """Connect, verify identity, leave the arm where it is."""
        ...

    async def close(self) -> None: ...

    async def state(self) -> ArmState: ...

    async def torque(self, on: bool) -> None: ...

    async def follow(self, trajectory: JointTrajectory) -> None:
        """Follow to the last way point; returns when its time has come (the arm may still settle).

        The first way point must lie within 0.1 rad of the present position (``DeviceRefused`` otherwise).
        When the caller is cancelled the arm stops where it is and holds.
        """
        ...

    async def hold(self) -> None:
        """Stop where the arm is and keep torque. Never moves to a 'home'."""
        ...
