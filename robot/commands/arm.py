"""``sprayer arm``: who is on the servo bus, what their registers hold, torque by hand."""

from __future__ import annotations

import asyncio
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import typer
from rich.console import Console
from rich.table import Table

from drivers.arm.bring_up import FoundServo, known_bauds, read_registers, scan, set_torque
from drivers.arm.control_tables import Register, hardware_error_text
from drivers.line import Line, PortSettings
from drivers.serial_port import SerialPort
from robot.commands import order
from robot.config import Config, load_config
from robot.config.devices import DynamixelArmSection
from robot.errors import UsageError
from robot.package_files import config_file

T = TypeVar("T")

app = typer.Typer(help="Arm the robot that runs here; with a command: look at the arm's servos.")

ConfigOption = Annotated[Path | None, typer.Option("--config", metavar="FILE", help="Take port and servos from it.")]
PortOption = Annotated[str | None, typer.Option("--port", metavar="DEV", help="The servos' adapter.")]
BaudOption = Annotated[int | None, typer.Option("--baud", min=9600, max=4_500_000, help="Default 1000000.")]
IdsOption = Annotated[str | None, typer.Option("--ids", metavar="IDS", help="Such as 1-8 or 1,4,7.")]


@app.callback(invoke_without_command=True)
def arm(context: typer.Context, socket: order.SocketOption = None, config: order.ConfigOption = None) -> int:
    """Arm the robot that runs here: contactor and torque on, ready to start. With a command: look at its servos."""
    if context.invoked_subcommand is None:
        return order.verb("arm", "")(socket, config)
    if socket is not None or config is not None:
        name = context.invoked_subcommand
        raise UsageError(f"options of 'arm {name}' belong behind it: sprayer arm {name} --config FILE")
    return 0


@app.command("scan")
def scan_command(
    config: ConfigOption = None,
    port: PortOption = None,
    baud: BaudOption = None,
    ids: IdsOption = None,
    all_bauds: Annotated[bool, typer.Option("--all-bauds", help="Search at every rate, not only at one.")] = False,
) -> int:
    """List the servos that answer."""
    bus = _bus(config, port, baud)
    rates = known_bauds() if all_bauds else (bus.settings.baud,)
    found = _on_port(bus.settings, lambda line: scan(line, _ids(ids), rates))
    if not found:
        sys.stdout.write("no servo answers; check power and cable, try --all-bauds\n")
        return 1
    Console().print(_servo_table(found, bus.joints))
    return 0


@app.command()
def read(
    servo: Annotated[int, typer.Argument(metavar="ID", min=0, max=252, help="The servo's id.")],
    names: Annotated[list[str] | None, typer.Argument(metavar="REGISTER...", help="Registers; default all.")] = None,
    config: ConfigOption = None,
    port: PortOption = None,
    baud: BaudOption = None,
) -> int:
    """Show registers of one servo."""
    bus = _bus(config, port, baud)
    registers = _on_port(bus.settings, lambda line: read_registers(line, servo, names or ()))
    for register, value in registers:
        sys.stdout.write(f"{register.address:4}  {register.name:<24}{_value_text(register, value)}\n")
    return 0


@app.command()
def torque(
    state: Annotated[Literal["on", "off"], typer.Argument(metavar="on|off")],
    config: ConfigOption = None,
    port: PortOption = None,
    baud: BaudOption = None,
    ids: IdsOption = None,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
) -> int:
    """Switch torque on (each servo holds its place) or off (the arm sinks: support it)."""
    bus = _bus(config, port, baud)
    chosen = _ids(ids) or tuple(bus.joints)
    if not chosen:
        raise UsageError("torque: expected --ids or --config, found neither; say which servos")
    question = "The arm holds where it is" if state == "on" else "The arm sinks when it is not supported"
    if not yes:
        typer.confirm(f"{question}. Servos {', '.join(map(str, chosen))}: torque {state}?", abort=True)
    _on_port(bus.settings, lambda line: set_torque(line, chosen, state == "on"))
    sys.stdout.write(f"torque {state} at servos {', '.join(map(str, chosen))}\n")
    return 0


@dataclass(frozen=True, slots=True)
class _Bus:
    """Where the servos are; ``joints`` by id as far as a configuration tells."""

    settings: PortSettings
    joints: dict[int, str]


def _bus(config: Path | None, port: str | None, baud: int | None) -> _Bus:
    if config is None:
        if port is None:
            raise UsageError("arm: expected --config FILE or --port DEV, found neither; say where the servos are")
        return _Bus(PortSettings(port, "arm", baud or 1_000_000, "dynamixel"), {})
    section = _dynamixel(load_config(config_file(config)), config)
    joints = {servo_id: name for name, servos in section.servos.items() for servo_id in servos.ids}
    return _Bus(PortSettings(port or section.port, "arm", baud or section.baud, "dynamixel"), joints)


def _dynamixel(config: Config, path: Path) -> DynamixelArmSection:
    section = config.arm
    if not isinstance(section, DynamixelArmSection):
        raise UsageError(f"{path}: its arm is a {section.backend}, which has no servo bus; give --port DEV")
    return section


def _on_port(settings: PortSettings, job: Callable[[Line], T]) -> T:
    """One job on a port of its own."""

    async def main() -> T:
        port = SerialPort(settings, asyncio.get_running_loop().time)
        await port.attach("arm tool", lambda line: None)
        try:
            return await port.run(job)
        finally:
            await port.detach("arm tool")

    return asyncio.run(main())


def _ids(text: str | None) -> tuple[int, ...] | None:
    if text is None:
        return None
    ids: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,3})(?:-(\d{1,3}))?\s*", part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if not first <= last <= 252:
            raise UsageError(f"--ids {text}: expected ids of 0 to 252 such as 1-8 or 1,4,7")
        ids += range(first, last + 1)
    return tuple(dict.fromkeys(ids))


def _servo_table(found: list[FoundServo], joints: dict[int, str]) -> Table:
    table = Table()
    for column in ("id", "model", "firmware", "baud", "joint"):
        table.add_column(column, justify="left" if column in ("model", "joint") else "right")
    for servo in found:
        model = servo.model or f"unknown ({servo.model_number})"
        joint = joints.get(servo.servo_id, "not in the configuration" if joints else "")
        table.add_row(str(servo.servo_id), model, str(servo.firmware), str(servo.baud), joint)
    return table


def _value_text(register: Register, value: int) -> str:
    return hardware_error_text(value) if register.name == "hardware_error_status" else str(value)
