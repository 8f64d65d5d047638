"""One Modbus bus that several drivers share, over a serial line or over TCP, in the owner thread of its port."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import TypeVar

from pymodbus.pdu import DecodePDU, ModbusPDU

from drivers import modbus_pdu as pdu
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.line import TCP, Line
from drivers.modbus_framing import Framing, Garbled, RtuFraming, Silence, TcpFraming, rtu_frame, tcp_frame
from drivers.serial_port import SerialPort, Timer

T = TypeVar("T")

TIMEOUT_S = 0.1
ANSWER_S = 0.02  # a unit's time to think and to answer a write, beside the time on the wire


@dataclass(slots=True)
class ModbusStatistics:
    """What became of the requests since the bus was made."""

    requests: int = 0
    silent: int = 0
    garbled: int = 0
    refused: int = 0


class ModbusMaster:
    """Whoever shares the bus gives it jobs; each job has the bus for itself.

    ``timeout_s``: how long a unit may think before it answers. A port at ``tcp://host:port`` speaks Modbus TCP, any
    other, ``rtu+tcp://host:port`` included, RTU.
    """

    def __init__(self, port: SerialPort, timeout_s: float = TIMEOUT_S) -> None:
        self.port = port
        self.statistics = ModbusStatistics()
        self._timeout_s = timeout_s
        self._opened: tuple[Line, ModbusLine] | None = None

    async def attach(self, user: str, greet: Callable[[ModbusLine], None]) -> None:
        """Join the bus; ``greet`` runs now and after every reconnection. Raises what opening and greeting raise."""
        await self.port.attach(user, lambda line: greet(self._on(line)))

    async def detach(self, user: str) -> None:
        """Leave the bus; the last user closes the port."""
        await self.port.detach(user)

    async def run(self, job: Callable[[ModbusLine], T]) -> T:
        """Run a job in its turn, to its end even when the caller is cancelled."""
        return await self.port.run(lambda line: job(self._on(line)))

    async def stop(self, job: Callable[[ModbusLine], T]) -> T:
        """Like ``run``, before everything that waits."""
        return await self.port.stop(lambda line: job(self._on(line)))

    def post_stop(self, job: Callable[[ModbusLine], T]) -> Future[T]:
        """Like ``stop``, from any thread and without waiting."""
        return self.port.post_stop(lambda line: job(self._on(line)))

    def write_beside(self, unit_id: int, requests: Sequence[pdu.Request]) -> None:
        """Writes for one unit, beside an owner that hangs and from any thread; sent twice, the answers unheard.

        ``DeviceLost`` without a device, ``DeviceTimeout`` when it takes nothing.
        """
        settings = self.port.settings
        framed = tcp_frame if settings.path.startswith(TCP) else rtu_frame
        frames = [framed(unit_id, request) for request in requests]
        answer_s = max(map(len, frames)) * settings.byte_s + ANSWER_S  # on two wires an answer takes its turn
        self.port.write_beside([*frames, *frames], answer_s)

    def at(self, due_s: float, job: Callable[[ModbusLine], None]) -> Timer:
        """Run a job in the owner thread at ``due_s`` of the clock; it sees to its own errors."""
        return self.port.at(due_s, lambda line: job(self._on(line)))

    @property
    def busy(self) -> bool:
        """Whether a job or a timer waits or runs."""
        return self.port.busy

    def _on(self, line: Line) -> ModbusLine:
        """The conversation over ``line``: one for as long as it stays open."""
        if self._opened is None or self._opened[0] is not line:
            framing = TcpFraming(line) if line.settings.path.startswith(TCP) else RtuFraming(line)
            self._opened = (line, ModbusLine(framing, self._timeout_s, self.statistics))
        return self._opened[1]


class ModbusLine:
    """The bus as a job sees it, only in the owner's thread. A new one begins with each opening of the port."""

    def __init__(self, framing: Framing, timeout_s: float, statistics: ModbusStatistics) -> None:
        self._framing, self._timeout_s, self._statistics = framing, timeout_s, statistics

    def unit(self, device: str, unit_id: int, timeout_s: float | None = None) -> ModbusUnit:
        """The unit ``unit_id`` (1 to 255); ``device`` stands first in its errors."""
        if not 1 <= unit_id <= 255:
            raise ValueError(f"{device}: expected a unit id of 1 to 255, found {unit_id}; correct the configuration")
        return ModbusUnit(self, device, unit_id, self._timeout_s if timeout_s is None else timeout_s)

    def listen(self, for_s: float) -> bytes:
        """What comes in unasked within ``for_s``: a second answer, or a talker that is no Modbus device."""
        return self._framing.listen(for_s)

    def exchange(self, device: str, unit_id: int, request: pdu.Request, timeout_s: float) -> bytes:
        """The answer's function code and data. ``DeviceTimeout`` (silence), ``DeviceFault`` (garbled, exception)."""
        self._statistics.requests += 1
        try:
            payload = self._framing.exchange(unit_id, request, timeout_s)
        except Silence:
            self._statistics.silent += 1
            raise DeviceTimeout(
                device, f"an answer of unit {unit_id} within {timeout_s:g} s", "silence",
                "check its power, its cable, unit id and baud rate; its state is unknown",
            ) from None  # fmt: skip
        except Garbled as error:
            self._statistics.garbled += 1
            raise DeviceFault(
                device, f"a valid answer of unit {unit_id}", f"a garbled answer ({error})",
                "check the cable, its shield and termination, and that each unit id is there once",
            ) from None  # fmt: skip
        if payload[0] & pdu.ERROR_BIT:
            self._statistics.refused += 1
            raise ModbusRefusal(device, unit_id, request, payload[1])
        return payload


class ModbusRefusal(DeviceFault):
    """The unit answered with an exception of this ``code``."""

    def __init__(self, device: str, unit_id: int, request: pdu.Request, code: int) -> None:
        super().__init__(
            device, f"unit {unit_id} to obey function {request.function:02d}",
            f"the exception {code} ({pdu.exception_name(code)})",
            "check that the configuration names the right device",
        )  # fmt: skip
        self.code = code


class ModbusUnit:
    """One unit on the bus. Every method raises ``DeviceTimeout``, ``DeviceFault``, or ``OSError`` for a lost port."""

    def __init__(self, line: ModbusLine, device: str, unit_id: int, timeout_s: float) -> None:
        self._line, self._device, self._unit_id, self._timeout_s = line, device, unit_id, timeout_s

    def read_coils(self, address: int, count: int) -> list[bool]:
        return list(self._read(pdu.read_bits(pdu.READ_COILS, address, count)).bits)[:count]

    def read_discrete_inputs(self, address: int, count: int) -> list[bool]:
        return list(self._read(pdu.read_bits(pdu.READ_DISCRETE_INPUTS, address, count)).bits)[:count]

    def read_holding(self, address: int, count: int) -> list[int]:
        """16-bit words."""
        return list(self._read(pdu.read_words(pdu.READ_HOLDING, address, count)).registers)

    def read_input_registers(self, address: int, count: int) -> list[int]:
        """16-bit words."""
        return list(self._read(pdu.read_words(pdu.READ_INPUT_REGISTERS, address, count)).registers)

    def write_coil(self, address: int, value: int) -> None:
        """Function 05 with the raw 16-bit value: 0xFF00, 0x0000, or a time; the echo is checked in both."""
        self._ask(pdu.write_coil(address, value))

    def write_register(self, address: int, value: int) -> None:
        """Function 06; the echo is checked in address and value."""
        self._ask(pdu.write_register(address, value))

    def write_registers(self, address: int, values: Sequence[int]) -> None:
        """Function 16; the echo is checked in address and count."""
        self._ask(pdu.write_registers(address, values))

    def write_coils(self, address: int, values: Sequence[bool]) -> None:
        """Function 15; the echo is checked in address and count."""
        self._ask(pdu.write_coils(address, values))

    def send(self, request: pdu.Request) -> None:
        """Any write; the echo is checked."""
        self._ask(request)

    def _ask(self, request: pdu.Request) -> bytes:
        return self._line.exchange(self._device, self._unit_id, request, self._timeout_s)

    def _read(self, request: pdu.Request) -> ModbusPDU:
        answer = DecodePDU(is_server=False).decode(self._ask(request))
        assert answer is not None  # its function and length were checked
        return answer
