"""Requests to Dynamixel servos on one line: every answer's error byte is looked at, late answers are drained."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from dynamixel_sdk.protocol2_packet_handler import (
    COMM_RX_TIMEOUT,
    COMM_SUCCESS,
    INST_PING,
    INST_REBOOT,
    PKT_ERROR,
    PKT_ID,
    PKT_INSTRUCTION,
    PKT_LENGTH_L,
    PKT_PARAMETER0,
)

from drivers.arm import protocol2
from drivers.arm.control_tables import Register
from drivers.arm.sdk_port import PacketHandler, SdkPort
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout
from drivers.line import Line

DEVICE = "arm"
SURE_TRIES = 3
PATIENCE_S = 0.030  # beyond the bytes' own time: USB latency, the servo's return delay, a busy host
QUIET_S = 0.003  # silence after which no late answer is expected any more
_STATUS_BYTES = 11  # of a status packet without data
_PING_STATUS_BYTES = 14
_SLOT_S = 0.003  # of each id in the answers to a broadcast ping


@dataclass(frozen=True, slots=True)
class Pinged:
    """What a servo says of itself."""

    servo_id: int
    model_number: int
    firmware: int


@dataclass(slots=True)
class Answers:
    """What came to a read of several servos. ``alerts``: those with a hardware error; ``garbled``: some came broken."""

    data: dict[int, bytes] = field(default_factory=dict)
    alerts: set[int] = field(default_factory=set)
    missing: tuple[int, ...] = ()
    garbled: bool = False


class ServoLine:
    """Belongs to the line's thread. ``DeviceTimeout``: silence; ``DeviceFault``: garbled, or the servo cannot."""

    def __init__(self, line: Line, patience_s: float = PATIENCE_S) -> None:
        self.line = line
        self._port = SdkPort(line, patience_s)
        self._handler = PacketHandler()

    @property
    def heard(self) -> bytes:
        """The first bytes that came after the last request."""
        return self._port.heard

    @contextmanager
    def patience(self, patience_s: float) -> Iterator[None]:
        """For a while servos may take another time beyond the bytes' own."""
        usual_s, self._port.patience_s = self._port.patience_s, patience_s
        try:
            yield
        finally:
            self._port.patience_s = usual_s

    def ping(self, servo_id: int) -> Pinged:
        packet = self._instruction(servo_id, INST_PING)
        self._port.is_using = False
        answer, result, _ = self._handler.txRxPacket(self._port, packet)
        self._require(result, servo_id, "a ping")
        assert answer is not None
        if len(answer) < _PING_STATUS_BYTES:
            raise self._garbled(servo_id, "a ping")
        model = answer[PKT_PARAMETER0 + 1] | answer[PKT_PARAMETER0 + 2] << 8
        return Pinged(servo_id, model, answer[PKT_PARAMETER0 + 3])

    def ping_all(self, highest_id: int = protocol2.HIGHEST_ID) -> tuple[Pinged, ...]:
        """Everybody who answers to a broadcast; takes 3 ms for each id up to ``highest_id``."""
        line, reader = self.line, protocol2.PacketReader()
        line.drain()
        line.write(protocol2.packet(protocol2.BROADCAST, protocol2.Instruction.PING))
        end_s = time.monotonic() + (highest_id + 1) * _SLOT_S + self._port.patience_s
        found: dict[int, Pinged] = {}
        while (rest_s := end_s - time.monotonic()) > 0.0:
            for packet in reader.feed(line.read_some(rest_s)):
                if isinstance(packet, protocol2.Packet) and len(packet.data) >= 4:
                    model = packet.data[1] | packet.data[2] << 8
                    found[packet.servo_id] = Pinged(packet.servo_id, model, packet.data[3])
        return tuple(found[servo_id] for servo_id in sorted(found))

    def read_surely(self, servo_id: int, address: int, size: int) -> bytes:
        """Like ``read``, at the second or third attempt if need be: for what is asked once only."""
        for _ in range(SURE_TRIES - 1):
            try:
                return self.read(servo_id, address, size)
            except DeviceTimeout:
                continue
        return self.read(servo_id, address, size)

    def read(self, servo_id: int, address: int, size: int) -> bytes:
        self._port.is_using = False
        data, result, error = self._handler.readTxRx(self._port, servo_id, address, size)
        what = f"a read of {size} bytes at {address}"
        self._require(result, servo_id, what)
        self._require_done(error, servo_id, what)
        if len(data) != size:
            raise self._garbled(servo_id, what)
        return bytes(data)

    def read_register(self, servo_id: int, register: Register) -> int:
        return register.decode(self.read(servo_id, register.address, register.size))

    def write(self, servo_id: int, address: int, data: bytes) -> None:
        self._port.is_using = False
        result, error = self._handler.writeTxRx(self._port, servo_id, address, len(data), list(data))
        what = f"a write of {data.hex(' ')} at {address}"
        self._require(result, servo_id, what)
        self._require_done(error, servo_id, what)

    def write_surely(self, servo_id: int, address: int, data: bytes) -> None:
        """Like ``write``, at the second or third attempt if need be: for what may be written twice."""
        for _ in range(SURE_TRIES - 1):
            try:
                return self.write(servo_id, address, data)
            except DeviceTimeout:
                continue
        return self.write(servo_id, address, data)

    def write_register(self, servo_id: int, register: Register, value: int) -> None:
        self.write(servo_id, register.address, register.encode(value))

    def reboot(self, servo_id: int) -> None:
        packet = self._instruction(servo_id, INST_REBOOT)
        self._port.is_using = False
        _, result, error = self._handler.txRxPacket(self._port, packet)
        self._require(result, servo_id, "a reboot")
        self._require_done(error, servo_id, "a reboot")

    def sync_write(self, address: int, data: Mapping[int, bytes], *, with_next: bool = False) -> None:
        """The same registers of several servos at once; nobody answers. ``with_next``: goes with the next request."""
        size = len(next(iter(data.values())))
        parameters = [byte for servo_id, values in data.items() for byte in (servo_id, *values)]
        self._port.is_using, self._port.holds = False, with_next
        try:
            self._handler.syncWriteTxOnly(self._port, address, size, parameters, len(parameters))
        finally:
            self._port.holds = False

    def sync_read(self, address: int, size: int, servo_ids: Sequence[int], *, fast: bool = False) -> Answers:
        """The same registers of several servos. Never raises for what does not come: see ``Answers``."""
        self._port.is_using = False
        self._handler.syncReadTx(self._port, address, size, list(servo_ids), len(servo_ids), fast)
        answers = self._fast_answer(size, servo_ids) if fast else self._answers(size, servo_ids)
        answers.missing = tuple(servo_id for servo_id in servo_ids if servo_id not in answers.data)
        if answers.missing:
            self.line.drain(QUIET_S)
        return answers

    def _answers(self, size: int, servo_ids: Sequence[int]) -> Answers:
        """One status packet a servo; those of others, and of a wrong length, are passed over."""
        answers, awaited = Answers(), set(servo_ids)
        while awaited:
            packet, result = self._handler.rxPacket(self._port, False)
            if result != COMM_SUCCESS:
                answers.garbled = result != COMM_RX_TIMEOUT
                break
            servo_id, length = packet[PKT_ID], packet[PKT_LENGTH_L]
            if servo_id not in awaited or length != size + 4:
                answers.garbled |= servo_id in awaited
                continue
            awaited.discard(servo_id)
            self._take(answers, servo_id, packet[PKT_ERROR], packet[PKT_ERROR + 1 : PKT_ERROR + 1 + size])
        return answers

    def _fast_answer(self, size: int, servo_ids: Sequence[int]) -> Answers:
        """One packet from all: error, id, data, CRC of each in turn."""
        answers, each = Answers(), size + 4
        data, result, _ = self._handler.fastSyncReadRx(self._port, protocol2.BROADCAST, each * len(servo_ids))
        if result != COMM_SUCCESS:
            answers.garbled = result != COMM_RX_TIMEOUT
            return answers
        for start in range(0, len(data) - size - 1, each):
            self._take(answers, data[start + 1], data[start], data[start + 2 : start + 2 + size])
        return answers

    @staticmethod
    def _take(answers: Answers, servo_id: int, error: int, data: Iterable[int]) -> None:
        if error & protocol2.ALERT:
            answers.alerts.add(servo_id)
        if error & ~protocol2.ALERT == 0:
            answers.data[servo_id] = bytes(data)

    @staticmethod
    def _instruction(servo_id: int, instruction: int) -> list[int]:
        """A packet without parameters, as the SDK wants it."""
        packet = [0] * 10
        packet[PKT_ID], packet[PKT_LENGTH_L], packet[PKT_INSTRUCTION] = servo_id, 3, instruction
        return packet

    def _require(self, result: int, servo_id: int, what: str) -> None:
        if result == COMM_SUCCESS:
            return
        self.line.drain(QUIET_S)
        if result == COMM_RX_TIMEOUT:
            raise DeviceTimeout(
                DEVICE, f"an answer of servo {servo_id} to {what}", "silence", "check its power and its cable"
            )
        raise self._garbled(servo_id, what)

    def _garbled(self, servo_id: int, what: str) -> DeviceError:
        return DeviceFault(
            DEVICE, f"a valid answer of servo {servo_id} to {what}", f"a garbled answer ({self.heard.hex(' ')})",
            "check the cable and its shield",
        )  # fmt: skip

    @staticmethod
    def _require_done(error: int, servo_id: int, what: str) -> None:
        if error & ~protocol2.ALERT:
            raise DeviceFault(
                DEVICE, f"servo {servo_id} to do {what}", protocol2.status_error_text(error),
                "check the value against the servo's limits, and whether its torque is on",
            )  # fmt: skip
