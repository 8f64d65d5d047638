"""The serial ports of one robot: each opened once, shared by the devices on it, traced when asked for."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import asdict
from pathlib import Path

from drivers.byte_trace import ByteTrace, TraceHead
from drivers.line import PortSettings
from drivers.modbus_master import ModbusMaster
from drivers.serial_port import SerialPort
from robot.errors import ConfigError, FileError


class Ports:
    """``trace`` is a folder that gets a file of every port's bytes; the stack closes these files."""

    def __init__(self, clock: Callable[[], float], trace: Path | None, stack: AsyncExitStack) -> None:
        self._clock, self._trace, self._stack = clock, trace, stack
        self._taken: dict[str, PortSettings] = {}
        self._buses: dict[str, ModbusMaster] = {}
        self._opened: dict[str, SerialPort] = {}

    def serial(self, settings: PortSettings) -> SerialPort:
        """A port that one device has for itself."""
        self._claim(settings)
        port = self._opened[settings.device] = SerialPort(settings, self._clock, trace=self.trace_of(settings))
        return port

    def alone(self, settings: PortSettings) -> PortSettings:
        """The settings of a port that its driver opens itself, and that no other device may name."""
        self._claim(settings)
        return settings

    def modbus(self, settings: PortSettings, timeout_s: float) -> ModbusMaster:
        """The bus at a port, the same for every device that names it."""
        place = _place(settings)
        bus = self._buses.get(place)
        if bus is None:
            bus = self._buses[place] = ModbusMaster(self.serial(settings), timeout_s)
            return bus
        first = self._taken[place]
        ways = [f"{each.baud} 8{each.parity}{each.stop_bits}" for each in (first, settings)]
        if ways[0] != ways[1]:
            raise ConfigError(
                f"{first.device} and {settings.device} share {settings.path} and must speak alike, found "
                f"{ways[0]} and {ways[1]}; correct one of them"
            )
        return bus

    def counts(self) -> dict[str, dict[str, int]]:
        """What went over each port that is opened here, by its first device; of a Modbus bus its requests too."""
        counts = {device: asdict(port.statistics) for device, port in self._opened.items()}
        for bus in self._buses.values():
            counts[bus.port.settings.device] |= asdict(bus.statistics)
        return counts

    def trace_of(self, settings: PortSettings) -> ByteTrace | None:
        """A new trace file for a port, None when nobody asked for one."""
        if self._trace is None:
            return None
        head = TraceHead(settings.device, settings.protocol, settings.path, settings.baud)
        try:
            self._trace.mkdir(parents=True, exist_ok=True)
            trace = ByteTrace(self._trace / f"{settings.device}.trace.jsonl", head)
        except OSError as error:
            raise FileError(f"{self._trace}: byte traces cannot be written ({error.strerror}); choose another folder") \
                from error  # fmt: skip
        self._stack.callback(trace.close)
        return trace

    def _claim(self, settings: PortSettings) -> None:
        place = _place(settings)
        if place in self._taken:
            raise ConfigError(
                f"{settings.device} and {self._taken[place].device} both name {settings.path}; "
                "give each its own port (only Modbus devices can share one)"
            )
        self._taken[place] = settings


def _place(settings: PortSettings) -> str:
    """One for all names of a device."""
    return settings.path if settings.is_tcp else os.path.realpath(settings.path)
