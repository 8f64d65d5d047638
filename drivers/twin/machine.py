"""The simulated machine in its greenhouse: one truth behind every mock and emulator."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.arm.values import ArmState
from drivers.gps.values import Fix, FixQuality
from drivers.inputs.values import InputState
from drivers.modem.values import ModemStatus, Sms
from drivers.relay.values import Channel
from drivers.twin import commands as c
from drivers.twin.codec import encode
from drivers.twin.deviations import TrueMachine, draw
from drivers.twin.faults import FaultPlan, Verb
from drivers.twin.leaf_pictures import PICTURES, leaf_coverage
from drivers.twin.light import Light, light_at
from drivers.twin.network import Network, SentText
from drivers.twin.nominal import Nominal
from drivers.twin.physics import Physics
from drivers.twin.plants import Greenhouse, grow
from drivers.twin.receiver import Receiver
from drivers.twin.renderer import PairRenderer, StereoRenderer
from drivers.twin.scene import Scene
from drivers.twin.sensors import Liquid, Sensors
from drivers.twin.shot import Shot, view_line
from drivers.twin.sightings import FruitView
from drivers.twin.spray import Deposit, deposit
from drivers.twin.truth import FORMAT, TruthLog
from drivers.wheels.values import Odometry

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

EPOCH_STEP_S = 1.0  # a process begins on a common multiple of all grids
LIGHT_STEP_S = 300.0  # the sun moves on in steps
MULTIPATH_M = 3.0


class Twin:
    """Deterministic by seed. Every method takes the time; calls come in order of time.

    Times at its door are in the clock of the process (0 when it began); inside, time runs on over processes.
    ``true`` are the true parameters (drawn by seed when None). A command is in the truth log before it takes effect.
    """

    def __init__(
        self,
        nominal: Nominal,
        scene: Scene,
        seed: int,
        truth: TruthLog | None = None,
        faults: FaultPlan | None = None,
        true: TrueMachine | None = None,
    ) -> None:
        self.nominal, self.scene, self.seed = nominal, scene, seed
        self.true = draw(nominal, seed) if true is None else true
        self.physics = Physics(nominal, self.true, seed, self._share_out, self._record)
        self._noise = np.random.default_rng([seed, 0x015E])
        self._receiver = Receiver(nominal, seed)
        self._network = Network(nominal)
        self._sensors = Sensors(nominal, self.true)
        self.truth = TruthLog(None)
        self._epoch_s = 0.0
        self.begin(truth or TruthLog(None), faults or FaultPlan())

    def begin(self, truth: TruthLog, faults: FaultPlan) -> None:
        """A process takes the machine over as it stands: its clock starts at 0, its faults hold from here."""
        self._epoch_s = math.ceil(self.physics.t_s / EPOCH_STEP_S - 1e-9) * EPOCH_STEP_S
        self.physics.advance(self._epoch_s)
        self.truth = truth
        if truth.keeps:
            truth.append(self._world_line(faults))
        self.physics.plan = faults.shifted(self._epoch_s)
        self.physics.apply_faults()
        self._snapshot(self.physics.t_s)

    def warm_up(self) -> None:
        """Do now what the first spraying would have to do, for a machine that must keep to real time."""
        for k in range(PICTURES):
            leaf_coverage(k)
        self._share_out(np.zeros(3), np.array([0.0, 1.0, 0.0]))

    def close_truth(self) -> None:
        """Let go of the truth file; the machine tells nothing more."""
        self.truth.close()

    @property
    def now_s(self) -> float:
        """The time of the last call, in the process's clock."""
        return self.physics.t_s - self._epoch_s

    def advance(self, now_s: float) -> None:
        """Let the physics run to ``now_s``."""
        self.physics.advance(now_s + self._epoch_s)

    def verb(self, device: str, now_s: float) -> Verb:
        """What ``device`` does wrong at ``now_s``."""
        return self.physics.plan.verb(device, now_s + self._epoch_s)

    def apply(self, now_s: float, command: c.Command) -> None:
        """Obey a command; it is in the truth log before anything of it happens."""
        self.advance(now_s)
        if self.truth.keeps:
            self.truth.append({"kind": "command", "t": now_s, **c.command_line(command)})
        match command:
            case c.RelaySwitch() | c.RelayPulse() | c.RelayAllOff():
                self.physics.board.submit(command.at_s + self._epoch_s, command)
            case c.ArmGoal() | c.ArmHold() | c.ArmTorque() | c.WheelsDrive() | c.WheelsStop() | c.WheelsRamps():
                if self.physics.obey(command):
                    self._snapshot(self.physics.t_s)
            case c.JointGoal() | c.JointMove() | c.JointHold() | c.JointTorque() | c.JointProfile():
                if self.physics.obey_joint(command):
                    self._snapshot(self.physics.t_s)
            case c.ModemSend(number, text):
                self._network.send(now_s, number, text)
            case c.ModemTake():
                self._network.take(self.physics.t_s)
            case _:
                self._suffer(command)

    def _suffer(self, command: c.WorldCommand) -> None:
        """What the world does to the machine."""
        match command:
            case c.WorldEstop(pressed):
                self._sensors.estop_pressed = pressed
                self.physics.press_estop(pressed)
            case c.WorldBumper(pressed):
                self._sensors.bumper_pressed = pressed
            case c.WorldTilt(roll, pitch):
                self._sensors.roll_rad, self._sensors.pitch_rad = roll, pitch
            case c.WorldBattery(voltage):
                self._sensors.battery_gives(voltage, self.physics.t_s)
            case c.WorldPush(x, y, heading):
                self.physics.drive.push(x, y, heading)
                self._snapshot(self.physics.t_s)
            case c.WorldServoError(joint, error):
                self.physics.servos.servo_error(joint, error)
            case c.WorldCradle():
                self.physics.servos.lie_in_cradle()
            case c.WorldRefill(tank_ml):
                self.physics.refill(tank_ml)
            case c.WorldText(sender, text):
                self._network.deliver(self.physics.t_s, sender, text)
            case c.WorldNetwork(registered):
                self._network.registered = registered
            case c.WorldGpsQuality(quality):
                self._receiver.quality = FixQuality(quality)

    # --- what the devices read

    def coils(self, now_s: float) -> dict[Channel, bool]:
        self.advance(now_s)
        return dict(self.physics.board.contacts)

    def arm_state(self, now_s: float) -> ArmState:
        self.advance(now_s)
        return self.physics.servos.reading(self.physics.t_s, now_s, self._noise)

    def joint_profiles(self, now_s: float) -> tuple[tuple[float, float], ...]:
        """Where each servo's own profile is (encoder angle, rad and rad/s): what the joint follows."""
        self.advance(now_s)
        return self.physics.servos.profiles

    def odometry(self, now_s: float) -> Odometry:
        self.advance(now_s)
        return self.physics.drive.reading(now_s, self._noise)

    def inputs(self, now_s: float) -> InputState:
        self.advance(now_s)
        liquid, t = self.physics.hydraulics, self.physics.t_s
        truth = Liquid(self.physics.tank_ml, liquid.flow_ml_s(t), liquid.dispensed_ml(t), liquid.pressure_bar(t))
        return self._sensors.reading(t, now_s, truth, self._noise)

    def next_epoch_s(self, now_s: float) -> float:
        """When the receiver next determines its position."""
        return self._receiver.next_epoch_s(now_s + self._epoch_s) - self._epoch_s

    def fix(self, now_s: float) -> Fix:
        """The position at the epoch ``now_s``."""
        self.advance(now_s)
        offset_m = MULTIPATH_M if self.verb("gps", now_s) is Verb.WRONG else 0.0
        drive = self.physics.drive
        return self._receiver.fix(self.physics.t_s, now_s, drive.pose, drive.speeds_m_s[0], offset_m)

    def modem_status(self, now_s: float) -> ModemStatus:
        self.advance(now_s)
        return self._network.status(now_s, self._noise)

    def texts(self, now_s: float) -> tuple[Sms, ...]:
        """What waits in the modem's store, oldest first."""
        self.advance(now_s)
        return self._network.waiting(self.physics.t_s, self._epoch_s)

    def shot(self, now_s: float) -> Shot:
        """What stands before the camera at ``now_s``."""
        self.advance(now_s)
        return Shot(
            now_s,
            self.base_pose,
            self.physics.row_from_base @ self.true.base_from_camera,
            self._light(),
            self.physics.geometry.capsules(self.joints_rad, self.physics.row_from_arm),
        )

    def tell_view(self, shot: Shot, sequence: int, seen: Iterable[FruitView]) -> None:
        """Put into the truth log how a frame saw the fruit; ``seen`` is the renderer's truth for that shot."""
        if self.truth.keeps:
            self.truth.append(view_line(shot, sequence, seen))

    def expose(self, now_s: float, exposure_s: float, gain: float, sequence: int) -> tuple[Image, Image]:
        """The pair (left, right) of an exposure whose middle is ``now_s``; (height, width, 3) BGR."""
        shot = self.shot(now_s)
        pair = self.renderer.render(shot.row_from_camera, shot.light, exposure_s, gain, shot.bodies, sequence)
        if self.truth.keeps:
            self.tell_view(shot, sequence, self.renderer.truth(shot.row_from_camera, shot.bodies))
        return pair

    # --- the truth

    @cached_property
    def greenhouse(self) -> Greenhouse:
        return grow(self.scene)

    @cached_property
    def renderer(self) -> PairRenderer:
        return StereoRenderer(self.greenhouse, self.nominal.optics, self.seed)

    @property
    def valve_open(self) -> bool:
        return self.physics.hydraulics.valve_open

    @property
    def dispensed_ml(self) -> float:
        """All that left the nozzle since the machine was built."""
        return self.physics.hydraulics.dispensed_ml(self.physics.t_s)

    @property
    def fruit_ml(self) -> dict[int, float]:
        """What lies on each fruit that got any, by its id."""
        return dict(self.physics.deposits.total.fruit_ml)

    @property
    def base_pose(self) -> tuple[float, float, float]:
        """x, y, heading in the row frame."""
        return self.physics.drive.pose

    @property
    def joints_rad(self) -> Array:
        """True joint angles."""
        return self.physics.servos.angles_rad(self.physics.t_s)

    @property
    def nozzle_pose(self) -> Array:
        """(4, 4) row_from_nozzle; it sprays along its x."""
        return self.physics.row_from_nozzle

    @property
    def registered(self) -> bool:
        """Whether the modem's network has the robot."""
        return self._network.registered

    @property
    def outbox(self) -> tuple[SentText, ...]:
        return tuple(self._network.outbox)

    def _light(self) -> Light:
        since_s = math.floor(self.physics.t_s / LIGHT_STEP_S) * LIGHT_STEP_S
        return light_at(
            min(24.0, self.scene.hour + since_s / 3600.0),
            self.scene.weather,
            lamp_on=self.physics.board.contacts.get(Channel.LAMP, False),
            row_azimuth_rad=self.nominal.gps_row_heading_rad,
        )

    def _share_out(self, nozzle_m: Array, axis: Array) -> Deposit:
        return deposit(self.greenhouse, nozzle_m, axis, self.nominal.cone_half_angle_rad, 1.0)

    def _record(self, t_s: float, what: str, detail: dict[str, Any]) -> None:
        if self.truth.keeps:
            self.truth.append({"kind": "event", "t": t_s - self._epoch_s, "what": what, **detail})
        if what in ("arm_stopped", "base_stopped"):
            self._snapshot(t_s)

    def _snapshot(self, t_s: float) -> None:
        if self.truth.keeps:
            self.truth.append(
                {
                    "kind": "state",
                    "t": t_s - self._epoch_s,
                    "base": list(self.base_pose),
                    "counters": list(self.physics.drive.counters_m),
                    "joints": self.joints_rad.tolist(),
                    "tank_ml": self.physics.tank_ml,
                    "dispensed_ml": self.dispensed_ml,
                    "pressure_bar": self.physics.hydraulics.pressure_bar(self.physics.t_s),
                }
            )

    def _world_line(self, faults: FaultPlan) -> dict[str, Any]:
        fruits = [
            {"id": f.id, "centre_m": f.centre_m.tolist(), "diameter_m": f.diameter_m, "ripeness": f.ripeness}
            for f in self.greenhouse.fruits
        ]
        return {
            "kind": "world",
            "format": FORMAT,
            "t": 0.0,
            "epoch_s": self._epoch_s,
            "seed": self.seed,
            "faults": [str(fault) for fault in faults.faults],
            "scene": encode(self.scene),
            "nominal": encode(self.nominal),
            "true": encode(self.true),
            "fruits": fruits,
        }
