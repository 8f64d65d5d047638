"""Everything that can be done to the simulated machine: by the robot over its buses, and by the world.

A command is data, so that a run can be replayed from its truth file. Times are in the clock of the run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from drivers.relay.values import Channel
from drivers.twin.codec import decode, encode


@dataclass(frozen=True, slots=True)
class RelaySwitch:
    """Coil on or off until further notice, when the frame arrives at the board at ``at_s``."""

    channel: Channel
    on: bool
    at_s: float


@dataclass(frozen=True, slots=True)
class RelayPulse:
    """Coil on for ``duration_s`` (a multiple of the board's quantum), then off by the board's timer."""

    channel: Channel
    duration_s: float
    at_s: float


@dataclass(frozen=True, slots=True)
class RelayAllOff:
    at_s: float


@dataclass(frozen=True, slots=True)
class ArmGoal:
    """One streamed goal position of all joints, as encoder angles."""

    rad: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ArmHold:
    """Brake and keep the place."""


@dataclass(frozen=True, slots=True)
class ArmTorque:
    on: bool


@dataclass(frozen=True, slots=True)
class JointGoal:
    """One streamed goal position of one joint, as encoder angle."""

    joint: int
    rad: float


@dataclass(frozen=True, slots=True)
class JointMove:
    """One joint moves to rest at an encoder angle, however fast it is now."""

    joint: int
    rad: float


@dataclass(frozen=True, slots=True)
class JointHold:
    """One joint brakes and keeps its place."""

    joint: int


@dataclass(frozen=True, slots=True)
class JointTorque:
    joint: int
    on: bool


@dataclass(frozen=True, slots=True)
class JointProfile:
    """A joint's servo keeps to limits below its own; 0 is no such limit."""

    joint: int
    velocity_rad_s: float
    acceleration_rad_s2: float


@dataclass(frozen=True, slots=True)
class WheelsDrive:
    speed_m_s: float
    yaw_rate_rad_s: float


@dataclass(frozen=True, slots=True)
class WheelsStop:
    pass


@dataclass(frozen=True, slots=True)
class WheelsRamps:
    """The motor controller is set: how fast wheel speeds rise and fall, and after what silence it brakes."""

    acceleration_m_s2: float
    deceleration_m_s2: float
    timeout_s: float


@dataclass(frozen=True, slots=True)
class ModemSend:
    number: str
    text: str


@dataclass(frozen=True, slots=True)
class ModemTake:
    """Take all received texts off the modem's store."""


@dataclass(frozen=True, slots=True)
class WorldEstop:
    """Somebody presses or releases the e-stop: power to valve, pump and wheels goes and comes back."""

    pressed: bool


@dataclass(frozen=True, slots=True)
class WorldBumper:
    pressed: bool


@dataclass(frozen=True, slots=True)
class WorldText:
    """Somebody texts the robot."""

    sender: str
    text: str


@dataclass(frozen=True, slots=True)
class WorldTilt:
    roll_rad: float
    pitch_rad: float


@dataclass(frozen=True, slots=True)
class WorldBattery:
    """The battery now gives ``voltage_v``, and goes on draining."""

    voltage_v: float


@dataclass(frozen=True, slots=True)
class WorldPush:
    """The standing base is shoved, in its own axes; the wheels skid and do not count it."""

    x_m: float
    y_m: float
    heading_rad: float


@dataclass(frozen=True, slots=True)
class WorldServoError:
    """A servo shows an error byte; any but 0 shuts its torque off."""

    joint: int
    error: int


@dataclass(frozen=True, slots=True)
class WorldCradle:
    """The arm is found without torque, at rest in its cradle, which bears it until it first leaves."""


@dataclass(frozen=True, slots=True)
class WorldRefill:
    """The tank now holds ``tank_ml``."""

    tank_ml: float


@dataclass(frozen=True, slots=True)
class WorldGpsQuality:
    """The receiver's surroundings change: ``quality`` by ``FixQuality``'s number."""

    quality: int


@dataclass(frozen=True, slots=True)
class WorldNetwork:
    """The modem finds its network or loses it."""

    registered: bool


WorldCommand = (
    WorldEstop
    | WorldBumper
    | WorldText
    | WorldTilt
    | WorldBattery
    | WorldPush
    | WorldServoError
    | WorldCradle
    | WorldRefill
    | WorldGpsQuality
    | WorldNetwork
)
Command = (
    RelaySwitch
    | RelayPulse
    | RelayAllOff
    | ArmGoal
    | ArmHold
    | ArmTorque
    | JointGoal
    | JointMove
    | JointHold
    | JointTorque
    | JointProfile
    | WheelsDrive
    | WheelsStop
    | WheelsRamps
    | ModemSend
    | ModemTake
    | WorldCommand
)

_NAMES: dict[type[Command], tuple[str, str]] = {
    RelaySwitch: ("relay", "switch"),
    RelayPulse: ("relay", "pulse"),
    RelayAllOff: ("relay", "all_off"),
    ArmGoal: ("arm", "goal"),
    ArmHold: ("arm", "hold"),
    ArmTorque: ("arm", "torque"),
    JointGoal: ("arm", "joint_goal"),
    JointMove: ("arm", "joint_move"),
    JointHold: ("arm", "joint_hold"),
    JointTorque: ("arm", "joint_torque"),
    JointProfile: ("arm", "joint_profile"),
    WheelsDrive: ("wheels", "drive"),
    WheelsStop: ("wheels", "stop"),
    WheelsRamps: ("wheels", "ramps"),
    ModemSend: ("modem", "send"),
    ModemTake: ("modem", "take"),
    WorldEstop: ("world", "estop"),
    WorldBumper: ("world", "bumper"),
    WorldText: ("world", "text"),
    WorldTilt: ("world", "tilt"),
    WorldBattery: ("world", "battery"),
    WorldPush: ("world", "push"),
    WorldServoError: ("world", "servo_error"),
    WorldCradle: ("world", "cradle"),
    WorldRefill: ("world", "refill"),
    WorldGpsQuality: ("world", "gps_quality"),
    WorldNetwork: ("world", "network"),
}
_KINDS = {names: kind for kind, names in _NAMES.items()}


def command_line(command: Command) -> dict[str, Any]:
    """Device, verb and args of a command, as the truth file holds them."""
    device, verb = _NAMES[type(command)]
    return {"device": device, "verb": verb, "args": encode(command)}


def command_of(device: str, verb: str, args: Mapping[str, Any]) -> Command:
    """The command of a line of the truth file. Raises ``ValueError`` when there is no such command."""
    kind = _KINDS.get((device, verb))
    if kind is None:
        raise ValueError(f"truth file: unknown command {device} {verb}; it was written by another version")
    return decode(kind, args)
