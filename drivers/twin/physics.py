"""The moving and flowing parts of the machine together, advanced from event to event."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.relay.values import Channel
from drivers.twin import commands as c
from drivers.twin.deposits import Deposits
from drivers.twin.deviations import TrueMachine
from drivers.twin.drive import Drive
from drivers.twin.faults import FaultPlan, Verb
from drivers.twin.hydraulics import Flowed, Hydraulics
from drivers.twin.kinematics import ArmGeometry, read_urdf
from drivers.twin.nominal import Nominal
from drivers.twin.relay_board import Board
from drivers.twin.servos import Servos
from drivers.twin.spray import Deposit

Array = npt.NDArray[np.float64]

Actuation = (
    c.RelaySwitch
    | c.RelayPulse
    | c.RelayAllOff
    | c.ArmGoal
    | c.ArmHold
    | c.ArmTorque
    | c.WheelsDrive
    | c.WheelsStop
    | c.WheelsRamps
)
JointCommand = c.JointGoal | c.JointMove | c.JointHold | c.JointTorque | c.JointProfile


class Physics:
    """Relay board, liquid, arm and base. The result depends on commands and their times only, not on who looks when.

    ``on_event(t_s, what, detail)`` is told of each physical event, in order; ``share_out`` says where 1 ml lands.
    ``plan`` holds the faults of the actuators, in the same clock.
    """

    def __init__(
        self,
        nominal: Nominal,
        true: TrueMachine,
        seed: int,
        share_out: Callable[[Array, Array], Deposit],
        on_event: Callable[[float, str, dict[str, Any]], None],
    ) -> None:
        self.t_s = 0.0
        self.plan = FaultPlan()
        self.geometry: ArmGeometry = read_urdf(nominal.urdf_text)
        self.board = Board(nominal.channels)
        self.hydraulics = Hydraulics(nominal, true)
        self.servos = Servos(
            self.geometry,
            nominal.stow_rad,
            nominal.joint_velocity_rad_s,
            nominal.joint_acceleration_rad_s2,
            true.joint_zero_rad,
            up=nominal.base_from_arm[2, :3],
        )
        self.drive = Drive(nominal, true, seed)
        self.deposits = Deposits(share_out)
        self.estop_pressed = False
        self._base_from_arm = nominal.base_from_arm
        self._on_event = on_event

    @property
    def resting(self) -> bool:
        """Nothing moves, flows or will by itself."""
        quiet = self.hydraulics.resting and self.servos.resting and self.drive.resting
        return quiet and math.isinf(self.board.next_s)

    @property
    def row_from_base(self) -> Array:
        """(4, 4)."""
        x, y, heading = self.drive.pose
        cos, sin = math.cos(heading), math.sin(heading)
        return np.array([[cos, -sin, 0.0, x], [sin, cos, 0.0, y], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])

    @property
    def row_from_arm(self) -> Array:
        """(4, 4), of the arm's root link."""
        return self.row_from_base @ self._base_from_arm

    @property
    def row_from_nozzle(self) -> Array:
        """(4, 4); it sprays along its x."""
        return self.row_from_arm @ self.geometry.nozzle_pose(self.servos.angles_rad(self.t_s))

    @property
    def tank_ml(self) -> float:
        """What the tank holds at this moment."""
        return self.hydraulics.tank_ml - (self.hydraulics.dispensed_ml(self.t_s) - self.hydraulics.total_ml)

    def advance(self, t_s: float) -> None:
        """Let everything run to ``t_s``; nothing happens for an earlier time."""
        while True:
            change_s = self.plan.next_change_s(self.t_s)
            due_s = min(self.board.next_s, self.hydraulics.next_s, change_s)
            if due_s > t_s:
                break
            self._move_to(due_s)
            self._switch()
            if change_s == due_s:
                self.apply_faults()
        self._move_to(t_s)

    def obey(self, command: Actuation) -> bool:
        """True when the command sets arm or base in motion, or halts them. Relay frames act when they arrive."""
        t = self.t_s
        match command:
            case c.ArmGoal(rad):
                return self.servos.goal(t, rad)
            case c.ArmHold():
                self.servos.hold()
            case c.ArmTorque(on):
                self.servos.torque(on)
            case c.WheelsDrive(speed, yaw_rate):
                return self.drive.command(t, speed, yaw_rate)
            case c.WheelsStop():
                return self.drive.stop(t)
            case c.WheelsRamps(acceleration, deceleration, timeout_s):
                self.drive.set_ramps(acceleration, deceleration, timeout_s)
                return False
            case _:
                raise TypeError(f"relay frames go to the board: {command}")
        return True

    def obey_joint(self, command: JointCommand) -> bool:
        """As ``obey``, for one joint."""
        servos, t = self.servos, self.t_s
        match command:
            case c.JointGoal(joint, rad):
                return servos.joint_goal(t, joint, rad)
            case c.JointMove(joint, rad):
                return servos.joint_move(joint, rad)
            case c.JointHold(joint):
                servos.joint_hold(joint)
            case c.JointTorque(joint, on):
                servos.joint_torque(joint, on)
            case c.JointProfile(joint, velocity, acceleration):
                servos.joint_profile(joint, velocity, acceleration)
                return False
        return True

    def press_estop(self, pressed: bool) -> None:
        self.estop_pressed = pressed
        self._switch()

    def refill(self, tank_ml: float) -> None:
        self._land(self.hydraulics.refill(self.t_s, tank_ml))

    def apply_faults(self) -> None:
        """Take up what the plan says of the actuators at this moment."""
        t = self.t_s
        self.board.frozen = self.plan.verb("relay", t) is Verb.STUCK
        self.drive.frozen = self.plan.verb("wheels", t) is Verb.STUCK
        if (jammed := self.plan.verb("arm", t) is Verb.STUCK) != self.servos.frozen:
            self.servos.freeze(jammed)
        self._land(self.hydraulics.set_valve_fault(t, self.plan.verb("valve", t)))
        self._switch()

    def _move_to(self, t_s: float) -> None:
        if t_s <= self.t_s:
            return
        arm_s, base_s = self.servos.advance(t_s), self.drive.advance(t_s)
        self.t_s = t_s
        stops: list[tuple[float, str, dict[str, Any]]] = []
        if arm_s is not None:
            stops.append((arm_s, "arm_stopped", {"joints": self.servos.angles_rad(t_s).tolist()}))
        if base_s is not None:
            stops.append((base_s, "base_stopped", {"base": list(self.drive.pose)}))
        for at_s, what, detail in sorted(stops, key=lambda stop: stop[:2]):
            self._on_event(at_s, what, detail)

    def _switch(self) -> None:
        """Do what is due now on the board, on the power lines and at the valve."""
        t = self.t_s
        for change in self.board.step(t):
            self._on_event(t, "coil_on" if change.on else "coil_off", {"channel": change.channel.value})
        self._power()
        flowed, moved = self.hydraulics.step(t)
        self._land(flowed)
        if moved:
            self.deposits.opened(t)
            self._on_event(t, "valve_opened", {})
        elif moved is False:
            pose = self.row_from_nozzle
            opened_s, sums = self.deposits.closed()
            where = {"nozzle_m": pose[:3, 3].tolist(), "axis": pose[:3, 0].tolist()}
            self._on_event(t, "valve_closed", {})
            self._on_event(t, "delivered", {"open_s": t - opened_s, **sums, **where})

    def _power(self) -> None:
        """Valve, pump and wheels have power while the e-stop is released and the contactor, if wired, is closed."""
        contacts = self.board.contacts
        live = not self.estop_pressed and contacts.get(Channel.CONTACTOR, True)
        self.drive.powered = live
        was_on = self.hydraulics.pump_on
        self._land(self.hydraulics.set_pump(self.t_s, live and contacts.get(Channel.PUMP, False)))
        if self.hydraulics.pump_on != was_on:
            self._on_event(self.t_s, "pump_off" if was_on else "pump_on", {})
        self.hydraulics.set_valve_coil(self.t_s, live and contacts.get(Channel.VALVE, False))

    def _land(self, flowed: Flowed | None) -> None:
        if flowed is None:
            return
        pose = self.row_from_nozzle
        self.deposits.land(flowed, pose[:3, 3], pose[:3, 0])
        if self.hydraulics.tank_ml <= 0.0:
            self._on_event(flowed.to_s, "tank_empty", {})
