"""From each device section's ``backend`` to an object behind the device's contract: the one place that chooses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from drivers.camera.epipolar import StereoCalibration
from drivers.camera.files import FilesCamera
from drivers.camera.frame_checks import PictureFault
from drivers.camera.frame_watch import ALL_FAULTS, FrameWatch
from drivers.camera.watched import WatchedCamera
from drivers.relay.values import BoardCapability, refusal_for_automatic
from drivers.twin.machine import Twin
from robot.aiming import ArmModel
from robot.config import Config
from robot.config.emulated import with_ports
from robot.errors import ConfigError, UnavailableError
from robot.runtime.devices import Devices
from robot.runtime.ports import Ports
from robot.runtime.workshop import Workshop
from robot.vision.stereo_rig import StereoRig


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """``ports`` stand in for the configured ones (device -> path or address); ``trace`` is a folder for all bytes."""

    config_path: Path
    ports: Mapping[str, str] = field(default_factory=dict)
    trace: Path | None = None


def needs_twin(config: Config) -> bool:
    """Whether some back end is a mock, which lives on the simulated machine in this process."""
    sections = (config.camera, config.arm, config.relay, config.inputs, config.gps, config.modem, config.wheels)
    return any(section.backend == "mock" for section in sections)


def watched(devices: Devices, rig: StereoRig, clock: Callable[[], float]) -> Devices:
    """The same devices, with every picture looked at for faults of the camera before anybody gets it.

    A recording may well repeat itself, so that a frozen one cannot be told.
    """
    calibration = StereoCalibration(
        rig.image_size, rig.K_left, rig.dist_left, rig.K_right, rig.dist_right, rig.R, rig.t_m
    )
    recorded = isinstance(devices.camera, FilesCamera)
    watch = FrameWatch(calibration, ALL_FAULTS - {PictureFault.FROZEN} if recorded else ALL_FAULTS)
    return replace(devices, camera=WatchedCamera(devices.camera, watch, clock))


def require_timed_pulses(capability: BoardCapability, longest_s: float) -> None:
    """``UnavailableError`` when the board must not spray unattended, or cannot time the longest pulse of a dose."""
    reason = refusal_for_automatic(capability)
    if reason is not None:
        raise UnavailableError(reason)
    if capability.pulse_max_s < longest_s:
        raise ConfigError(
            f"dosing.max_pulse_s ({longest_s:g}) exceeds the longest pulse of the relay board "
            f"({capability.pulse_max_s:g} s); lower it"
        )


def build_devices(
    config: Config, arm: ArmModel, twin: Twin | None, clock: Callable[[], float], options: BuildOptions,
    stack: AsyncExitStack,
) -> Devices:  # fmt: skip
    """Every device of the configuration, not yet open. ``ConfigError`` for settings that a driver cannot keep.

    The stack closes what is no device (the files of byte traces).
    """
    ports = Ports(clock, options.trace, stack)
    workshop = Workshop(with_ports(config, options.ports), arm, twin, clock, ports)
    return Devices(
        camera=workshop.camera(),
        arm=workshop.arm(),
        relay=workshop.relay(),
        inputs=workshop.inputs(),
        gps=workshop.gps(),
        modem=workshop.modem(),
        wheels=workshop.wheels(),
        ports=ports,
    )
