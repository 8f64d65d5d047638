"""Servos that share a bus: who obeys which instruction, who answers, in what order and how late."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from drivers.arm.emulated_servo import EmulatedServo, Refused
from drivers.arm.protocol2 import (
    BROADCAST,
    HEADER,
    Broken,
    Instruction,
    Packet,
    PacketReader,
    StatusError,
    crc16,
    status,
)

SLOT_S = 0.003  # of each id in the answers to a broadcast ping
FIRST_PRESENT_ADDRESS = 120
READS = (Instruction.SYNC_READ, Instruction.BULK_READ, Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ)
WRITES = (Instruction.SYNC_WRITE, Instruction.BULK_WRITE)


@dataclass(frozen=True, slots=True)
class Answer:
    """Bytes from the servos, ``delay_s`` after a request of ``heard_bytes``."""

    data: bytes
    delay_s: float
    heard_bytes: int


@dataclass(frozen=True, slots=True)
class _Part:
    """What an instruction to several asks of, or gives to, one of them. ``data`` is empty for a read."""

    servo_id: int
    address: int
    size: int
    data: bytes = b""


class ServoBus:
    """``refresh(servos, now_s)`` brings registers up to date before a read; ``settle()`` follows after a write.

    In a read of several each answers after the one before it; behind a silent one all others stay silent.
    """

    def __init__(
        self,
        servos: list[EmulatedServo],
        clock: Callable[[], float],
        refresh: Callable[[Iterable[EmulatedServo], float], None],
        settle: Callable[[], None],
        host_baud: Callable[[], int | None],
    ) -> None:
        self.servos = servos
        self._clock, self._refresh, self._settle, self._host_baud = clock, refresh, settle, host_baud
        self._reader = PacketReader()

    def forget(self) -> None:
        """What was heard of a packet so far is lost."""
        self._reader = PacketReader()

    def hear(self, data: bytes, now_s: float) -> list[Answer]:
        answers = []
        for packet in self._reader.feed(data):
            if isinstance(packet, Packet):
                answers += self._obey(packet, now_s)
                self._settle()
            elif isinstance(packet, Broken) and packet.because == "the checksum is wrong":
                answers += self._complain(packet, now_s)
        return answers

    def _listening(self, now_s: float) -> list[EmulatedServo]:
        baud = self._host_baud()
        return [servo for servo in self.servos if servo.hears(now_s, baud)]

    def _complain(self, packet: Broken, now_s: float) -> list[Answer]:
        """A servo that finds its own id in a packet with a wrong checksum says so."""
        return [
            Answer(status(servo.servo_id, StatusError.CRC | servo.alert), servo.return_delay_s, packet.wire_bytes)
            for servo in self._listening(now_s)
            if servo.servo_id == packet.servo_id and servo.answers_level == 2
        ]

    def _obey(self, packet: Packet, now_s: float) -> list[Answer]:
        servos = self._listening(now_s)
        if packet.instruction in READS or packet.instruction in WRITES:
            return self._obey_several(packet, servos, now_s) if packet.servo_id == BROADCAST else []
        asked = [servo for servo in servos if packet.servo_id in (servo.servo_id, BROADCAST)]
        said = []
        for servo in asked:
            servo.feed(now_s)
            servo_id = servo.servo_id  # before a write may change it
            level, delay_s = servo.answers_level, servo.return_delay_s
            try:
                error, data = StatusError.NONE, self._do(servo, packet, now_s)
            except Refused as refused:
                error, data = refused.error, b""
            if packet.instruction == Instruction.PING:
                slot_s = SLOT_S * servo_id if packet.servo_id == BROADCAST else 0.0
                said.append(Answer(status(servo_id, error | servo.alert, data), delay_s + slot_s, packet.wire_bytes))
            elif packet.servo_id != BROADCAST and level >= (1 if packet.instruction == Instruction.READ else 2):
                said.append(Answer(status(servo_id, error | servo.alert, data), delay_s, packet.wire_bytes))
        return said if packet.servo_id == BROADCAST else _over_each_other(said)

    def _do(self, servo: EmulatedServo, packet: Packet, now_s: float) -> bytes:
        """One instruction for one servo; what it answers."""
        data = packet.data
        match packet.instruction:
            case Instruction.PING:
                return servo.read(0, 2) + servo.read(6, 1)
            case Instruction.READ:
                if len(data) != 4:
                    raise Refused(StatusError.DATA_LENGTH)
                address, size = _word(data), _word(data[2:])
                self._look(address + size, [servo], now_s)
                return servo.read(address, size)
            case Instruction.WRITE:
                servo.write(_word(data), data[2:])
            case Instruction.REG_WRITE:
                servo.keep_for_action(_word(data), data[2:])
            case Instruction.ACTION:
                servo.act()
            case Instruction.REBOOT:
                servo.reboot(now_s)
            case Instruction.FACTORY_RESET:
                if packet.servo_id == BROADCAST or len(data) != 1:
                    raise Refused(StatusError.RESULT_FAIL)
                servo.factory_reset(data[0], now_s)
            case Instruction.CLEAR:
                servo.clear(data)
            case _:
                raise Refused(StatusError.INSTRUCTION)
        return b""

    # --- instructions to several

    def _obey_several(self, packet: Packet, servos: Sequence[EmulatedServo], now_s: float) -> list[Answer]:
        parts = _parts(packet)
        if parts is None:
            return []
        by_id = {servo.servo_id: servo for servo in servos}
        for part in parts:
            if part.servo_id in by_id:
                by_id[part.servo_id].feed(now_s)
        if packet.instruction in WRITES:
            for part in parts:
                if part.servo_id in by_id:
                    _write_silently(by_id[part.servo_id], part)
            return []
        chain: list[tuple[EmulatedServo, _Part]] = []
        for part in parts:
            servo = by_id.get(part.servo_id)
            if servo is None or servo.answers_level == 0:
                break
            chain.append((servo, part))
        if not chain:
            return []
        self._look(max(part.address + part.size for part in parts), [servo for servo, _ in chain], now_s)
        delay_s = sum(servo.return_delay_s for servo, _ in chain)
        if packet.instruction in (Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ):
            return [Answer(_fast_status(parts, chain), delay_s, packet.wire_bytes)]
        return [Answer(b"".join(_read_status(servo, part) for servo, part in chain), delay_s, packet.wire_bytes)]

    def _look(self, end: int, servos: Sequence[EmulatedServo], now_s: float) -> None:
        """Registers that show the present are brought up to date when they are asked for."""
        if end > 64:
            self._refresh(servos, now_s)


def _parts(packet: Packet) -> list[_Part] | None:
    """An instruction to several, taken apart; None when it is not well formed."""
    data = packet.data
    match packet.instruction:
        case Instruction.SYNC_READ | Instruction.FAST_SYNC_READ:
            address, size = _word(data), _word(data[2:])
            return [_Part(servo_id, address, size) for servo_id in data[4:]] if len(data) > 4 else None
        case Instruction.SYNC_WRITE:
            address, size = _word(data), _word(data[2:])
            each = size + 1
            if len(data) <= 4 or size == 0 or (len(data) - 4) % each:
                return None
            starts = range(4, len(data), each)
            return [_Part(data[k], address, size, data[k + 1 : k + each]) for k in starts]
        case Instruction.BULK_READ | Instruction.FAST_BULK_READ:
            if not data or len(data) % 5:
                return None
            return [_Part(data[k], _word(data[k + 1 :]), _word(data[k + 3 :])) for k in range(0, len(data), 5)]
    return _bulk_write_parts(data)


def _bulk_write_parts(data: bytes) -> list[_Part] | None:
    parts = []
    while data:
        size = _word(data[3:])
        if len(data) < 5 + size or size == 0:
            return None
        parts.append(_Part(data[0], _word(data[1:]), size, data[5 : 5 + size]))
        data = data[5 + size :]
    return parts


def _write_silently(servo: EmulatedServo, part: _Part) -> None:
    """Nobody answers to a write to several: what cannot be done is not done."""
    try:
        servo.write(part.address, part.data)
    except Refused:
        return


def _read(servo: EmulatedServo, part: _Part) -> tuple[int, bytes]:
    try:
        return servo.alert, servo.read(part.address, part.size)
    except Refused as refused:
        return refused.error | servo.alert, b""


def _read_status(servo: EmulatedServo, part: _Part) -> bytes:
    error, data = _read(servo, part)
    return status(servo.servo_id, error, data)


def _fast_status(parts: Sequence[_Part], chain: Sequence[tuple[EmulatedServo, _Part]]) -> bytes:
    """One packet from all: error, id, data and the CRC so far of each in turn; cut short where one is silent."""
    length = sum(part.size + 4 for part in parts) + 1
    out = bytearray(HEADER + bytes([BROADCAST]) + length.to_bytes(2, "little") + bytes([Instruction.STATUS]))
    for servo, part in chain:
        error, data = _read(servo, part)
        out += bytes([error, servo.servo_id]) + (data or bytes(part.size))
        out += crc16(bytes(out)).to_bytes(2, "little")
    return bytes(out)


def _over_each_other(said: Sequence[Answer]) -> list[Answer]:
    """Two with one id drive the line at once, a byte apart: a 0 of either wins."""
    if len(said) < 2:
        return list(said)
    data = bytearray(b"\xff" * max(len(answer.data) + k for k, answer in enumerate(said)))
    for k, answer in enumerate(said):
        for j, byte in enumerate(answer.data):
            data[j + k] &= byte
    return [Answer(bytes(data), said[0].delay_s, said[0].heard_bytes)]


def _word(data: bytes) -> int:
    return int.from_bytes(data[:2], "little")
