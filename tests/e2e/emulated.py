"""Emulated rovers in processes of their own, and what went over the ports to them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from drivers.arm.protocol2 import Instruction, Packet, PacketReader
from drivers.byte_trace import read_trace
from drivers.modbus_frames import FrameFinder, request_size
from drivers.twin.commands import ArmGoal, RelayPulse, RelaySwitch, WheelsDrive
from drivers.twin.truth_record import read_truth
from robot.cli import run_command
from robot.package_files import packaged

from .rover_process import SPRAYER

EMULATED = packaged("configs") / "emulated.toml"
UP_S = DOWN_S = 60.0
READS = frozenset({Instruction.PING, Instruction.READ, Instruction.SYNC_READ, Instruction.FAST_SYNC_READ,
                   Instruction.BULK_READ, Instruction.FAST_BULK_READ})  # fmt: skip
MODBUS_WRITES = frozenset({5, 6, 15, 16})


@dataclass(frozen=True)
class Emulated:
    """A rover that is being emulated: its process and its map of ports."""

    process: subprocess.Popen[str]
    ports: dict[str, str]

    def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        return self.process.wait(DOWN_S)


def start_emulator(*arguments: str, env: Mapping[str, str] | None = None, config: Path = EMULATED) -> Emulated:
    """``sprayer emulate --json``; ``env`` is added to the environment."""
    process = subprocess.Popen(
        [*SPRAYER, "emulate", "--config", str(config), "--json", *arguments],
        stdout=subprocess.PIPE, text=True, env=os.environ | dict(env or {}), start_new_session=True,
    )  # fmt: skip
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line, f"the emulator ended with {process.wait(DOWN_S)} without a map of ports"
    return Emulated(process, json.loads(line))


@contextmanager
def emulator(*arguments: str, env: Mapping[str, str] | None = None, config: Path = EMULATED) -> Iterator[Emulated]:
    rover = start_emulator(*arguments, env=env, config=config)
    try:
        yield rover
    finally:
        if rover.process.poll() is None:
            rover.process.terminate()
        rover.process.communicate(timeout=DOWN_S)


_HOLD = (
    "import sys; from drivers.line import Line, PortSettings;"
    "line = Line(PortSettings(sys.argv[1], 'x', 115200, 'raw'), lambda direction, data: None);"
    "print(flush=True); sys.stdin.read()"
)


@contextmanager
def held(port: str) -> Iterator[int]:
    """Another process, whose number is given, holds the port."""
    process = subprocess.Popen([sys.executable, "-c", _HOLD, port], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"\n"
    try:
        yield process.pid
    finally:
        process.communicate(timeout=DOWN_S)


def variables(ports: Mapping[str, str]) -> dict[str, str]:
    """The variables of the environment that put a robot on these ports."""
    keys = {name: "DEVICE" if name == "camera" else "PORT" for name in ports}
    return {f"SPRAYER_{name.upper()}__{key}": ports[name] for name, key in keys.items()}


def run_until(arguments: Sequence[str], longest_s: float) -> int:
    """``run_command``, ended by SIGTERM if it has not ended by itself by then."""
    guard = threading.Timer(longest_s, os.kill, (os.getpid(), signal.SIGTERM))
    guard.start()
    try:
        return run_command(list(arguments))
    finally:
        guard.cancel()
        guard.join()


def written(trace: Path) -> bytes:
    """All that the host wrote to the port of a trace; nothing when the port was never traced."""
    if not trace.exists():
        return b""
    return b"".join(chunk.data for chunk in read_trace(trace)[1] if chunk.direction == "out")


def orders_in(data: bytes) -> list[str]:
    """Frames that would change something in a servo, a Modbus unit or the network, whoever they were meant for."""
    orders = [
        f"servo {packet.servo_id}: {Instruction(packet.instruction).name}"
        for packet in PacketReader().feed(data)
        if isinstance(packet, Packet) and packet.instruction not in READS
    ]
    finder = FrameFinder(request_size)
    orders += [
        f"unit {found.data[0]}: function {found.data[1]}"
        for found in [*finder.feed(data), *finder.silence()]
        if found.is_frame and found.data[1] in MODBUS_WRITES
    ]
    return orders + ["a text is sent"] * data.count(b"+CMGS")


def motions_in(truth: Path) -> list[object]:
    """What moved or opened something on an emulated machine."""
    return [
        timed.command
        for process in read_truth(truth).processes
        for timed in process.commands
        if isinstance(timed.command, ArmGoal | RelayPulse)
        or (isinstance(timed.command, RelaySwitch) and timed.command.on)
        or (isinstance(timed.command, WheelsDrive) and drives(timed.command))
    ]


def drives(command: WheelsDrive) -> bool:
    return (command.speed_m_s, command.yaw_rate_rad_s) != (0.0, 0.0)
