"""Who gets which port, and whose bytes are kept where."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from drivers.byte_trace import TraceHead, read_trace
from drivers.line import PortSettings
from robot.errors import ConfigError, FileError
from robot.runtime.ports import Ports


def at(path: str | Path, device: str, baud: int = 115_200, **more: object) -> PortSettings:
    return PortSettings(str(path), device, baud, "modbus", **more)  # type: ignore[arg-type]


@pytest.fixture
def stack() -> Iterator[AsyncExitStack]:
    stack = AsyncExitStack()
    yield stack
    asyncio.run(stack.aclose())


@pytest.fixture
def ports(stack: AsyncExitStack) -> Ports:
    return Ports(lambda: 0.0, None, stack)


def test_modbus_devices_that_name_one_port_share_one_bus(ports: Ports) -> None:
    assert ports.modbus(at("/dev/a", "relay"), 0.1) is ports.modbus(at("/dev/a", "inputs"), 0.1)
    assert ports.modbus(at("/dev/b", "wheels"), 0.1) is not ports.modbus(at("/dev/a", "inputs"), 0.1)


def test_a_stable_name_and_the_device_behind_it_are_one_port(ports: Ports, tmp_path: Path) -> None:
    (tmp_path / "ttyUSB0").write_text("")
    (tmp_path / "by-id").symlink_to(tmp_path / "ttyUSB0")
    bus = ports.modbus(at(tmp_path / "ttyUSB0", "relay"), 0.1)
    assert ports.modbus(at(tmp_path / "by-id", "inputs"), 0.1) is bus
    with pytest.raises(ConfigError, match=r"arm and relay both name .*by-id; give each its own port"):
        ports.serial(at(tmp_path / "by-id", "arm"))


def test_devices_of_one_bus_must_speak_alike(ports: Ports) -> None:
    ports.modbus(at("/dev/a", "relay"), 0.1)
    with pytest.raises(ConfigError, match=r"relay and inputs share /dev/a .* 115200 8N1 and 9600 8N1; correct one"):
        ports.modbus(at("/dev/a", "inputs", 9600), 0.1)
    with pytest.raises(ConfigError, match="115200 8N1 and 115200 8E1"):
        ports.modbus(at("/dev/a", "inputs", parity="E"), 0.1)


@pytest.mark.parametrize("first", ["serial", "alone", "modbus"])
@pytest.mark.parametrize("second", ["serial", "alone"])
def test_nobody_shares_a_port_with_a_device_that_is_not_modbus(ports: Ports, first: str, second: str) -> None:
    def take(how: str, device: str) -> None:
        settings = at("/dev/a", device)
        ports.modbus(settings, 0.1) if how == "modbus" else getattr(ports, how)(settings)

    take(first, "gps")
    with pytest.raises(ConfigError, match="modem and gps both name /dev/a"):
        take(second, "modem")


def test_each_port_has_a_trace_of_its_own_once_one_is_asked_for(tmp_path: Path, stack: AsyncExitStack) -> None:
    ports = Ports(lambda: 0.0, tmp_path / "bytes", stack)
    ports.modbus(at("/dev/a", "relay"), 0.1)
    ports.modbus(at("/dev/a", "inputs"), 0.1)
    ports.serial(PortSettings("/dev/b", "arm", 1_000_000, "dynamixel"))
    assert sorted(file.name for file in (tmp_path / "bytes").iterdir()) == ["arm.trace.jsonl", "relay.trace.jsonl"]
    head, chunks = read_trace(tmp_path / "bytes" / "arm.trace.jsonl")
    assert head == TraceHead("arm", "dynamixel", "/dev/b", 1_000_000)
    assert list(chunks) == []


def test_without_being_asked_nothing_is_kept(ports: Ports) -> None:
    assert ports.trace_of(at("/dev/a", "relay")) is None


def test_a_folder_for_traces_that_cannot_be_is_named(tmp_path: Path, stack: AsyncExitStack) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(FileError, match=r"taken: byte traces cannot be written .* choose another folder"):
        Ports(lambda: 0.0, tmp_path / "taken", stack).serial(at("/dev/a", "relay"))
