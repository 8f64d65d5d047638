"""The devices of a rover together, and the simulated machine that a configuration describes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from drivers.arm.interface import Arm
from drivers.camera.interface import StereoCamera
from drivers.errors import DeviceError
from drivers.gps.interface import Gps
from drivers.gps.values import FixQuality
from drivers.inputs.interface import Inputs
from drivers.modem.interface import Modem
from drivers.relay.interface import RelayBoard
from drivers.relay.values import Channel
from drivers.twin.aftermath import resume_from
from drivers.twin.faults import FaultPlan, parse_fault
from drivers.twin.machine import Twin
from drivers.twin.nominal import Nominal
from drivers.twin.optics import StereoOptics
from drivers.twin.scene import Scene
from drivers.wheels.interface import Wheels
from robot.config import Config
from robot.config.devices import MockRelaySection
from robot.errors import BusyError, ConfigError, FileError, UsageError
from robot.navigation import Row
from robot.runtime.ports import Ports
from robot.runtime.settings import mounts
from robot.vision.stereo_rig import StereoRig

EMULATED_QUANTUM_S, EMULATED_LONGEST_S = 0.1, 30.0


@dataclass(frozen=True, slots=True, eq=False)
class Devices:
    """Every device of the rover, each behind its contract; ``ports`` are those that some of them share."""

    camera: StereoCamera
    arm: Arm
    relay: RelayBoard
    inputs: Inputs
    gps: Gps
    modem: Modem
    wheels: Wheels
    ports: Ports

    async def open(self, stack: AsyncExitStack, on_trouble: Callable[[str], None]) -> None:
        """Open all; the stack closes them in reverse order, the relay last, and goes on past one that fails."""
        named: dict[str, _Device] = {
            "relay": self.relay, "inputs": self.inputs, "wheels": self.wheels, "arm": self.arm,
            "camera": self.camera, "gps": self.gps, "modem": self.modem,
        }  # fmt: skip
        for name, device in named.items():
            await device.open()
            stack.push_async_callback(_close, name, device, on_trouble)


class _Device(Protocol):
    async def open(self) -> None: ...

    async def close(self) -> None: ...


async def _close(name: str, device: _Device, on_trouble: Callable[[str], None]) -> None:
    try:
        await device.close()
    except DeviceError as error:
        on_trouble(f"{name} was not closed: {error}")


def nominal_machine(config: Config, rig: StereoRig, urdf_text: str) -> Nominal:
    """The machine as configured, in the twin's words: what the robot is told, from which the twin's truth deviates."""
    base_from_camera, base_from_arm = mounts(config)
    quantum_s, longest_s = _timer(config)
    return Nominal(
        optics=StereoOptics(
            rig.image_size, rig.K_left, rig.K_right, rig.dist_left, rig.dist_right, rig.R, rig.t_m
        ),
        base_from_camera=base_from_camera.matrix(),
        base_from_arm=base_from_arm.matrix(),
        urdf_text=urdf_text,
        stow_rad=config.arm.stow_rad,
        joint_velocity_rad_s=config.arm.max_velocity_rad_s,
        joint_acceleration_rad_s2=config.arm.max_acceleration_rad_s2,
        nozzle_flow_ml_s=config.fluid.nozzle_flow_ml_s,
        nozzle_pressure_bar=config.fluid.nozzle_pressure_bar,
        cone_half_angle_rad=config.fluid.cone_half_angle_rad,
        valve_open_s=config.fluid.valve_open_s,
        valve_close_s=config.fluid.valve_close_s,
        pump_pressure_bar=config.fluid.pump_pressure_bar,
        tank_ml=config.fluid.tank_ml,
        tank_fill_ml=config.task.tank_fill_ml,
        flow_meter_pulses_per_l=1000.0 / config.fluid.meter_ml_per_pulse,
        wheel_radius_m=config.wheels.radius_m,
        track_m=config.wheels.track_m,
        max_speed_m_s=config.wheels.max_speed_m_s,
        max_acceleration_m_s2=config.wheels.max_acceleration_m_s2,
        channels=frozenset(Channel(name) for name in config.relay.channels.wired),
        pulse_quantum_s=quantum_s,
        pulse_max_s=longest_s,
        camera_rate_hz=config.camera.rate_hz,
        drive_timeout_s=config.wheels.command_timeout_s,
        exposure_s=config.camera.exposure_s,
        gain=config.camera.gain,
        gps_latitude_deg=config.navigation.datum_latitude_deg or 0.0,
        gps_longitude_deg=config.navigation.datum_longitude_deg or 0.0,
        gps_row_heading_rad=config.navigation.datum_heading_rad,
        gps_quality=FixQuality[config.twin.gps.upper()],
    )


def fault_plan(texts: Iterable[str]) -> FaultPlan:
    """The declared faults; ``UsageError`` for one that cannot be read."""
    try:
        return FaultPlan(parse_fault(text) for text in texts)
    except ValueError as error:
        raise UsageError(f"--fault: {error}") from error


def _timer(config: Config) -> tuple[float, float]:
    """Quantum and longest pulse of a mock board; an emulated one times by its own rules, up to its driver's longest."""
    if isinstance(config.relay, MockRelaySection):
        return config.relay.pulse_quantum_s, config.relay.pulse_max_s
    return EMULATED_QUANTUM_S, EMULATED_LONGEST_S


def make_twin(
    config: Config, row: Row, rig: StereoRig, urdf_text: str, truth: Path | None, faults: FaultPlan | None = None
) -> Twin:
    """The simulated machine behind mocks or emulators: a new one, or the one that an existing truth file tells of."""
    seed = config.twin.seed
    try:
        nominal = nominal_machine(config, rig, urdf_text)
        scene = _scene(config, row)
    except ValueError as error:
        raise ConfigError(f"the simulated machine cannot be built: {error}") from error
    if truth is None:
        return Twin(nominal, scene, seed, None, faults)
    try:
        return resume_from(truth, nominal, scene, seed, faults)
    except BlockingIOError as error:
        raise BusyError(str(error)) from error
    except OSError as error:
        raise FileError(f"{truth}: cannot be used ({error.strerror}); choose another truth file") from error
    except ValueError as error:
        raise FileError(str(error)) from error


def _scene(config: Config, row: Row) -> Scene:
    return Scene(
        seed=config.twin.seed,
        hour=config.twin.hour,
        weather=config.twin.weather,
        row_length_m=row.length_m,
        side=row.side,
        plant_spacing_m=config.plants.spacing_m,
        stem_distance_m=config.plants.stem_distance_m,
        fruits_per_plant=config.twin.fruits_per_plant,
    )
