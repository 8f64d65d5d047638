"""From each device section's ``backend`` to an object behind the device's contract: the one place that chooses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from pathlib import Path

from drivers.twin.machine import Twin
from robot.aiming import ArmModel
from robot.config import Config
from robot.config.emulated import with_ports
from robot.runtime.devices import Devices
from robot.runtime.ports import Ports
from robot.runtime.workshop import Workshop


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
    )
