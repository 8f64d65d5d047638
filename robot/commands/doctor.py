"""``sprayer doctor``: what is wrong with this rover, device by device."""

from __future__ import annotations

import asyncio
import json
import sys
from contextlib import AsyncExitStack
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from robot.clock import RealClockLoop, run_real, run_virtual
from robot.commands.run import ConfigOption
from robot.config import Config, load_config
from robot.doctor import Finding, Level, exit_code
from robot.doctor.computer import calibration_findings, clock_finding, clock_synchronised, disk_finding
from robot.doctor.devices import (
    examine,
    look_at_arm,
    look_at_camera,
    look_at_gps,
    look_at_inputs,
    look_at_modem,
    look_at_relay,
    look_at_wheels,
)
from robot.doctor.ports import port_findings
from robot.errors import UsageError
from robot.package_files import config_file, named_file
from robot.runtime import EmulatorOptions, emulator_process
from robot.runtime.backends import BuildOptions, build_devices, needs_twin, watched
from robot.runtime.devices import Devices, make_twin
from robot.runtime.settings import load_arm, load_camera, load_row

PIPED_WIDTH = 160
STYLES = {Level.OK: "green", Level.WARN: "yellow", Level.FAIL: "bold red"}


def doctor(
    config: ConfigOption,
    emulate: Annotated[bool, typer.Option("--emulate", help="Start the emulated rover and examine that.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON line a finding.")] = False,
) -> int:
    """Examine every device; nothing moves. The exit code says the worst that was found."""
    settings = load_config(config)
    path = config_file(config)
    if emulate and not settings.emulated:
        raise UsageError(f"{config}: has no emulated rover (twin.behind is not 'emulators'); leave --emulate out")
    examination = _with_emulator(settings, path) if emulate else _examine(settings, BuildOptions(path))
    findings = run_virtual(examination) if settings.simulated else run_real(examination)
    if as_json:
        for finding in findings:
            sys.stdout.write(json.dumps(asdict(finding)) + "\n")
    else:
        console = Console()
        if not console.is_terminal:
            console.width = PIPED_WIDTH
        console.print(_table(settings, findings))
    return exit_code(findings)


async def _with_emulator(config: Config, path: Path) -> list[Finding]:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, RealClockLoop)
    async with emulator_process(EmulatorOptions(path, config.twin.seed, loop.zero_s)) as ports:
        return await _examine(config, BuildOptions(path, ports))


async def _examine(config: Config, options: BuildOptions) -> list[Finding]:
    now = datetime.now(UTC)
    findings = [clock_finding(now, clock_synchronised()), disk_finding(config.robot.run_directory)]
    findings += calibration_findings(named_file(config.camera.calibration, options.config_path), now)
    arm_model, urdf_text = load_arm(config, options.config_path)
    rig = load_camera(config, options.config_path)
    async with AsyncExitStack() as stack:
        twin = None
        if needs_twin(config):
            twin = make_twin(config, load_row(config, options.config_path), rig, urdf_text, None)
        clock = asyncio.get_running_loop().time
        devices = watched(build_devices(config, arm_model, twin, clock, options, stack), rig, clock)
        seen: set[str] = set()
        for name in ("relay", "inputs", "wheels", "arm", "camera", "gps", "modem"):
            port = options.ports.get(name) or getattr(getattr(config, name), "port", None)
            if port is not None and port not in seen:
                seen.add(port)
                findings += port_findings(name, port)
            if not any(finding.device == name and finding.level is Level.FAIL for finding in findings):
                findings += await _look(name, devices, config.simulated or config.emulated)
    return findings


async def _look(name: str, devices: Devices, simulated: bool) -> list[Finding]:
    match name:
        case "relay":
            return await examine(name, devices.relay, lambda: look_at_relay(devices.relay))
        case "inputs":
            return await examine(name, devices.inputs, lambda: look_at_inputs(devices.inputs))
        case "wheels":
            return await examine(name, devices.wheels, lambda: look_at_wheels(devices.wheels))
        case "arm":
            return await examine(name, devices.arm, lambda: look_at_arm(devices.arm))
        case "camera":
            return await examine(name, devices.camera, lambda: look_at_camera(devices.camera))
        case "gps":
            return await examine(name, devices.gps, lambda: look_at_gps(devices.gps, simulated))
        case _:
            return await examine(name, devices.modem, lambda: look_at_modem(devices.modem))


def _table(config: Config, findings: list[Finding]) -> Table:
    table = Table(title=f"{config.robot.name}: doctor")
    for column in ("device", "what", "", "found", "expected", "what to do"):
        table.add_column(column, overflow="fold")
    for finding in findings:
        level = Text(finding.level.value, style=STYLES[finding.level])
        table.add_row(
            finding.device, finding.what, level, finding.found, finding.expected, finding.remedy,
        )  # fmt: skip
    return table
