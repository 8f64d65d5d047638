"""The devices that a session by hand moves and reads: arm, relay, wheels, inputs. The others are not opened."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from pathlib import Path

from drivers.errors import DeviceError
from robot.aiming import ArmModel
from robot.config import Config
from robot.navigation import Row
from robot.runtime.backends import BuildOptions, build_devices, needs_twin
from robot.runtime.devices import Devices, fault_plan, make_twin
from robot.runtime.settings import load_camera

OPENED = ("relay", "inputs", "wheels", "arm")


@dataclass(frozen=True, slots=True)
class ManualOptions:
    """What the command line adds to the configuration; as ``RunOptions`` of a run."""

    config_path: Path
    folder: Path
    truth: Path | None = None
    ports: Mapping[str, str] = field(default_factory=dict)
    faults: tuple[str, ...] = ()
    trace: Path | None = None


def hand_devices(
    config: Config, row: Row, arm: ArmModel, urdf_text: str, options: ManualOptions, stack: AsyncExitStack
) -> Devices:
    """All devices of the configuration, not yet open. The camera's calibration is read for a simulated machine only."""
    twin = None
    if needs_twin(config):
        rig = load_camera(config, options.config_path)
        twin = make_twin(config, row, rig, urdf_text, options.truth, fault_plan(options.faults))
        stack.callback(twin.close_truth)
    build = BuildOptions(options.config_path, options.ports, options.trace)
    return build_devices(config, arm, twin, asyncio.get_running_loop().time, build, stack)


async def open_hands(devices: Devices, stack: AsyncExitStack, on_trouble: Callable[[str], None]) -> None:
    """Open those in ``OPENED``; the stack closes them, the relay last. ``DeviceError`` names a missing one."""

    async def close(name: str) -> None:
        try:
            await getattr(devices, name).close()
        except DeviceError as error:
            on_trouble(f"{name} was not closed: {error}")

    for name in OPENED:
        await getattr(devices, name).open()
        stack.push_async_callback(close, name)
