"""The bytes of an arm's port as text: a line for each packet, registers by name and value."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

from drivers.arm.control_tables import MODELS, Model, Register, hardware_error_text, model_text
from drivers.arm.protocol2 import (
    ALERT,
    BROADCAST,
    HIGHEST_ID,
    Broken,
    Instruction,
    Noise,
    Packet,
    PacketReader,
    status_error_text,
)
from drivers.trace_decoder import Wrong

SHOWN_BYTES = 16
_MODEL = MODELS["XM430-W350"]  # its registers lie where those of all models lie, but for current and load
_BULK = (Instruction.BULK_READ, Instruction.FAST_BULK_READ)
_SYNC = (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ)


class DynamixelDecoder:
    """Fed with the chunks of a trace in order. What an answer holds is known from the request before it."""

    def __init__(self, model: Model = _MODEL) -> None:
        self._model = model
        self._readers = {"out": PacketReader(), "in": PacketReader()}
        self._asked: dict[int, tuple[int, int]] = {}  # id -> address and size of what it was asked for
        self._asked_fast: tuple[int, ...] = ()

    def feed(self, direction: Literal["out", "in"], data: bytes) -> list[str]:
        """The lines for what is complete now; "out" is from the host."""
        lines: list[str] = []
        for item in self._readers[direction].feed(data):
            match item:
                case Noise(noise):
                    lines.append(Wrong(f"noise {_shown(noise)}"))
                case Broken(servo_id, instruction, because, _):
                    lines.append(Wrong(f"BROKEN {_who(servo_id)} {_verb(instruction)}: {because}"))
                case Packet() if item.instruction == Instruction.STATUS:
                    lines.append(self._answer(item))
                case Packet():
                    lines.append(self._request(item))
        return lines

    def rest(self) -> list[str]:
        """What never was completed."""
        return [Wrong(f"incomplete: {_shown(reader.held)}") for reader in self._readers.values() if reader.held]

    # --- from the host

    def _request(self, packet: Packet) -> str:
        self._asked.clear()
        self._asked_fast = ()
        text = f"{_who(packet.servo_id)} {_verb(packet.instruction)}"
        detail = self._detail(packet)
        return f"{text} {detail}" if detail else text

    def _detail(self, packet: Packet) -> str:
        data = packet.data
        match packet.instruction:
            case Instruction.READ if len(data) == 4:
                return self._asks([packet.servo_id], _word(data), _word(data[2:]))
            case Instruction.WRITE | Instruction.REG_WRITE if len(data) > 2:
                return self._values(_word(data), data[2:])
            case instruction if instruction in _SYNC and len(data) > 4:
                if instruction == Instruction.FAST_SYNC_READ:
                    self._asked_fast = tuple(data[4:])
                ids = ", ".join(str(servo_id) for servo_id in data[4:])
                return f"{self._asks(data[4:], _word(data), _word(data[2:]))} of {ids}"
            case Instruction.SYNC_WRITE if len(data) > 4:
                address, each = _word(data), _word(data[2:]) + 1
                parts = (data[k : k + each] for k in range(4, len(data), each))
                return "; ".join(f"{part[0]}: {self._values(address, part[1:])}" for part in parts)
            case instruction if instruction in _BULK and data:
                if instruction == Instruction.FAST_BULK_READ:
                    self._asked_fast = tuple(data[::5])
                return "; ".join(
                    f"{part[0]}: {self._asks([part[0]], _word(part[1:]), _word(part[3:]))}"
                    for part in (data[k : k + 5] for k in range(0, len(data), 5))
                )
            case Instruction.BULK_WRITE:
                return "; ".join(self._bulk_values(data))
        return data.hex(" ")

    def _asks(self, servo_ids: Sequence[int], address: int, size: int) -> str:
        for servo_id in servo_ids:
            self._asked[servo_id] = (address, size)
        names = [register.name for register in self._registers(address, size)]
        return ", ".join(names) if 0 < len(names) <= 4 else f"{size} bytes at {address}"

    def _bulk_values(self, data: bytes) -> Iterator[str]:
        while len(data) > 5:
            size = _word(data[3:])
            yield f"{data[0]}: {self._values(_word(data[1:]), data[5 : 5 + size])}"
            data = data[5 + size :]

    # --- from the servos

    def _answer(self, packet: Packet) -> str:
        if packet.servo_id == BROADCAST:
            return self._fast_answer(packet.data)
        if not packet.data:
            return Wrong(f"{_who(packet.servo_id)} status without an error byte")
        error, data = packet.data[0], packet.data[1:]
        told = f"{_who(packet.servo_id)} {self._told(packet.servo_id, error, data)}"
        return Wrong(told) if error else told

    def _fast_answer(self, data: bytes) -> str:
        parts, errors = [], 0
        for servo_id in self._asked_fast:
            size = self._asked[servo_id][1]
            part, data = data[: size + 2], data[size + 4 :]
            if len(part) == size + 2:
                errors |= part[0]
                parts.append(f"{part[1]}: {self._told(part[1], part[0], part[2:])}")
        told = "servos " + ("; ".join(parts) if parts else data.hex(" "))
        return Wrong(told) if errors else told

    def _told(self, servo_id: int, error: int, data: bytes) -> str:
        words = []
        if error & ALERT:
            words.append("HARDWARE ALERT")
        if error & ~ALERT:
            words.append(f"ERROR {status_error_text(error)}")
        asked = self._asked.get(servo_id)
        if asked is not None and asked[1] == len(data):
            words.append(self._values(asked[0], data))
        elif len(data) == 3 and asked is None:
            words.append(f"{model_text(_word(data))}, firmware {data[2]}")
        elif data:
            words.append(data.hex(" "))
        return " ".join(words) or "ok"

    # --- registers

    def _registers(self, address: int, size: int) -> list[Register]:
        """Those that lie wholly inside."""
        return [r for r in self._model.registers.values() if address <= r.address and r.end <= address + size]

    def _values(self, address: int, data: bytes) -> str:
        registers = self._registers(address, len(data))
        if not registers:
            return f"{address}: {data.hex(' ')}"
        words = []
        for register in registers:
            value = register.decode(data[register.address - address : register.end - address])
            text = hardware_error_text(value) if register.name == "hardware_error_status" else str(value)
            words.append(f"{register.name}={text}")
        return " ".join(words)


def _shown(data: bytes) -> str:
    more = "" if len(data) <= SHOWN_BYTES else f" and {len(data) - SHOWN_BYTES} more"
    return data[:SHOWN_BYTES].hex(" ") + more


def _who(servo_id: int) -> str:
    if servo_id == BROADCAST:
        return "all"
    return f"servo {servo_id}" if servo_id <= HIGHEST_ID else f"id {servo_id}"


def _verb(instruction: int) -> str:
    try:
        return Instruction(instruction).name.lower().replace("_", " ")
    except ValueError:
        return f"instruction 0x{instruction:02x}"


def _word(data: bytes) -> int:
    return int.from_bytes(data[:2], "little")
