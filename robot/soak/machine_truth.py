"""The machine as it truly is, for whoever watches it: nothing here moves time on or draws from its noise."""

from __future__ import annotations

import math

from drivers.relay.values import Channel
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin

FORGOTTEN_S = 900.0  # beyond that no fault of the past shows


class MachineTruth:
    """Asks the twin without touching it."""

    def __init__(self, twin: Twin) -> None:
        self.twin = twin
        self._former: tuple[tuple[str, Verb, float], ...] = ()

    @property
    def valve_open(self) -> bool:
        return self.twin.valve_open

    def coil(self, channel: Channel) -> bool:
        return self.twin.physics.board.contacts.get(channel, False)

    @property
    def dispensed_ml(self) -> float:
        """All that left the nozzle, leaks included."""
        return self.twin.dispensed_ml

    @property
    def leaked_ml(self) -> float:
        return self.twin.physics.deposits.leaked_ml

    @property
    def base_speed_m_s(self) -> float:
        """The faster wheel's, by its controller."""
        forward, turning = self.twin.physics.drive.speeds_m_s
        return abs(forward) + 0.5 * abs(turning) * self.twin.nominal.track_m

    @property
    def counters_m(self) -> tuple[float, float]:
        return self.twin.physics.drive.counters_m

    @property
    def base_rests(self) -> bool:
        return self.twin.physics.drive.resting

    @property
    def base_xy_m(self) -> tuple[float, float]:
        x, y, _ = self.twin.base_pose
        return x, y

    @property
    def arm_rests(self) -> bool:
        return self.twin.physics.servos.resting

    @property
    def arm_speed_rad_s(self) -> float:
        """The fastest joint's."""
        return max(abs(speed) for speed in self.twin.physics.servos.speeds_rad_s)

    @property
    def joints_rad(self) -> tuple[float, ...]:
        return tuple(self.twin.joints_rad.tolist())

    @property
    def servo_errors(self) -> bool:
        return any(self.twin.physics.servos.errors) or not self.twin.physics.servos.torque_on

    @property
    def estop_pressed(self) -> bool:
        return self.twin.physics.estop_pressed

    def verb(self, device: str) -> Verb:
        """What ``device`` does wrong at this moment."""
        return self.twin.physics.plan.verb(device, self.twin.physics.t_s)

    @property
    def was_sound(self) -> bool:
        """Whether nothing was wrong with any device under the process before."""
        return not self._former

    def before_another_plan(self) -> None:
        """The next process will have other faults; what the present ones did may still show for a while."""
        now_s = self.twin.physics.t_s
        self._former = tuple(
            (fault.device, fault.verb, min(fault.end_s, now_s))
            for fault in self.twin.physics.plan.faults
            if fault.start_s <= now_s and fault.verb is not Verb.OK
        )

    def sound(self, device: str, for_s: float = math.inf, but: frozenset[Verb] = frozenset()) -> bool:
        """Whether nothing was wrong with ``device`` in the last ``for_s`` (at most 15 minutes, this process and the one
        before), ``but`` what is named."""
        now_s = self.twin.physics.t_s
        known = self._former + tuple(
            (fault.device, fault.verb, fault.end_s)
            for fault in self.twin.physics.plan.faults
            if fault.start_s <= now_s and fault.verb is not Verb.OK
        )
        return not any(
            who == device and verb not in but and end_s >= now_s - min(for_s, FORGOTTEN_S)
            for who, verb, end_s in known
        )
