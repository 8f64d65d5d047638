"""From each device section's ``backend`` to an object behind the device's contract: the one place that chooses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from pathlib import Path

from drivers.arm.mock import MockArm
from drivers.camera.mock import MockCamera
from drivers.gps.mock import MockGps
from drivers.inputs.mock import MockInputs
from drivers.modem.mock import MockModem
from drivers.relay.mock import MockRelay
from drivers.twin.machine import Twin
from drivers.wheels.mock import MockWheels
from robot.aiming import ArmModel
from robot.config import Config
from robot.config.emulated import with_ports
from robot.runtime.devices import Devices


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
    """Every device of the configuration, not yet open."""
    config = with_ports(config, options.ports)
    assert twin is not None
    return Devices(
        camera=MockCamera(twin, clock),
        arm=MockArm(twin, clock),
        relay=MockRelay(twin, clock),
        inputs=MockInputs(twin, clock),
        gps=MockGps(twin, clock),
        modem=MockModem(twin, clock),
        wheels=MockWheels(twin, clock),
    )
