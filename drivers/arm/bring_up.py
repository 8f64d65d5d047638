"""Looking for servos and into one of them, before there is an arm: jobs for a port that nobody else uses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from drivers.arm import register_blocks as blocks
from drivers.arm.control_tables import BAUDS, MODEL_NAMES, MODELS, TABLE_BYTES, Model, Register
from drivers.arm.servo_line import DEVICE, Pinged, ServoLine
from drivers.errors import DeviceError, DeviceFault, DeviceRefused, DeviceTimeout
from drivers.line import Line

SEARCH_PATIENCE_S = 0.015
READ_BYTES = 64  # at a time


@dataclass(frozen=True, slots=True)
class FoundServo:
    """A servo that answered, and at which rate."""

    servo_id: int
    model_number: int
    firmware: int
    baud: int

    @property
    def model(self) -> str | None:
        """Its name; None when it is a model that is not known here."""
        return MODEL_NAMES.get(self.model_number)


def scan(line: Line, ids: Iterable[int] | None = None, bauds: Sequence[int] | None = None) -> list[FoundServo]:
    """Who answers: to a broadcast, or each of ``ids`` asked alone; at the line's rate, or at each of ``bauds``.

    A broadcast takes 0.8 s a rate, an id that is silent some 15 ms. Two servos with one id answer over each other and
    are not found.
    """
    servos, here = ServoLine(line), line.settings.baud
    wanted = None if ids is None else tuple(ids)
    found = []
    try:
        for baud in bauds or (here,):
            line.set_baud(baud)
            line.drain()
            pinged = servos.ping_all() if wanted is None else _ping_each(servos, wanted)
            found += [FoundServo(p.servo_id, p.model_number, p.firmware, baud) for p in pinged]
    finally:
        line.set_baud(here)
    return found


def known_bauds() -> tuple[int, ...]:
    """All rates that X-series servos can have, the likeliest first."""
    return tuple(sorted(BAUDS, key=lambda baud: (baud not in (57_600, 1_000_000), baud)))


def read_registers(line: Line, servo_id: int, names: Sequence[str] = ()) -> list[tuple[Register, int]]:
    """Registers of one servo by name, all of its model without names. ``DeviceRefused`` for a name it does not have."""
    servos = ServoLine(line)
    model = model_of(servos, servo_id)
    unknown = [name for name in names if name not in model.registers]
    if unknown:
        raise DeviceRefused(
            DEVICE, f"a register of the {model.name}", unknown[0], f"known are {', '.join(model.registers)}"
        )
    table = b"".join(
        servos.read(servo_id, at, min(READ_BYTES, TABLE_BYTES - at)) for at in range(0, TABLE_BYTES, READ_BYTES)
    )
    registers = [model.registers[name] for name in names] or list(model.registers.values())
    return [(register, register.decode(table[register.address : register.end])) for register in registers]


def set_torque(line: Line, servo_ids: Sequence[int], on: bool) -> None:
    """Torque of some servos; on takes each one's place as its goal first. Off goes on past those that do not answer.

    ``DeviceTimeout`` or ``DeviceFault`` names the first that failed, after all have been tried.
    """
    servos, failed = ServoLine(line), []
    for servo_id in servo_ids:
        try:
            if on:
                _hold_place(servos, servo_id)
            servos.write(servo_id, blocks.TORQUE_ADDRESS, bytes([on]))
        except (DeviceTimeout, DeviceFault) as error:
            failed.append(error)
    if failed:
        raise failed[0]


def _hold_place(servos: ServoLine, servo_id: int) -> None:
    """Goal is place, if the servo has no torque yet."""
    if servos.read(servo_id, blocks.TORQUE_ADDRESS, 1) != b"\0":
        return
    place = servos.read(servo_id, blocks.POSITION_ADDRESS, blocks.POSITION_BYTES)
    servos.write(servo_id, blocks.GOAL_ADDRESS, place)


def model_of(servos: ServoLine, servo_id: int) -> Model:
    """``DeviceFault`` when the servo's model is not known here."""
    number = servos.ping(servo_id).model_number
    name = MODEL_NAMES.get(number)
    if name is None:
        raise DeviceFault(
            DEVICE, f"servo {servo_id} to be one of {', '.join(MODELS)}", f"model number {number}",
            "its registers are not known; use a servo of these models",
        )  # fmt: skip
    return MODELS[name]


def _ping_each(servos: ServoLine, ids: Iterable[int]) -> list[Pinged]:
    found = []
    with servos.patience(SEARCH_PATIENCE_S):
        for servo_id in ids:
            try:
                found.append(servos.ping(servo_id))
            except DeviceError:
                continue
    return found
