"""Who is on the arm's bus, against who should be: told side by side, before anything is written that moves."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from drivers.arm import protocol2
from drivers.arm.control_tables import BAUDS, OperatingMode, model_text
from drivers.arm.joints import DynamixelSettings, JointSettings, ServoSettings
from drivers.arm.servo_line import DEVICE, QUIET_S, Pinged, ServoLine
from drivers.errors import DeviceError, DeviceFault, DeviceMissing, DeviceTimeout, WrongDevice

LONGEST_S = 2.6  # for all of it, the search for what is missing included
SEARCH_PATIENCE_S = 0.012
PING_ATTEMPTS = 3
EEPROM_BYTES = 64
DISABLED_ID = 253  # a secondary id from here on is none
_COLUMNS = ("id", "joint", "model", "firmware", "baud", "settings", "found model", "firmware", "baud", "settings")


@dataclass(slots=True)
class Identity:
    """One servo, expected and found. ``wrong`` says what differs, in words; empty when all is as it should be."""

    joint: JointSettings
    expected: ServoSettings
    found: Pinged | None = None
    baud: int | None = None
    settings: dict[str, int] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)

    @property
    def servo_id(self) -> int:
        return self.expected.servo_id


class ServoMismatch(WrongDevice):
    """The bus holds other servos, or otherwise set ones, than the configuration says. ``rows`` has each of them."""

    rows: tuple[Identity, ...] = ()


class ServosMissing(DeviceMissing):
    """Servos of the configuration do not answer. ``rows`` has each of them."""

    rows: tuple[Identity, ...] = ()


def identify(servos: ServoLine, settings: DynamixelSettings) -> tuple[Identity, ...]:
    """Every servo of the configuration, found and set as it says.

    ``ServosMissing``, ``ServoMismatch``, or ``WrongDevice`` when what answers is no Dynamixel. Writes nothing.
    """
    began_s = time.monotonic()
    baud = servos.line.settings.baud
    rows = tuple(Identity(joint, servo) for joint in settings.joints for servo in joint.servos)
    noise = b""
    for row in rows:
        noise = _ping(servos, row) or noise
        row.baud = baud if row.found else None
    if not any(row.found for row in rows):
        _search_bauds(servos, rows, began_s)
        raise _nobody(rows, baud, noise)
    for row in rows:
        _compare_identity(row, settings)
    if not any(row.wrong for row in rows):
        for row in rows:
            _compare_settings(servos, row, settings)
    if any(row.wrong for row in rows):
        strangers = _strangers(servos, rows, began_s)
        _search_bauds(servos, [row for row in rows if row.found is None and not row.wrong[1:]], began_s)
        raise _mismatch(rows, settings, baud, strangers)
    return rows


def _ping(servos: ServoLine, row: Identity) -> bytes:
    """Fill in who answers; what came when nobody did. Two with one id answer over each other, or in turn."""
    noise, silent, doubled = b"", 0, 0
    for _ in range(PING_ATTEMPTS):
        try:
            found = servos.ping(row.servo_id)
        except DeviceTimeout:
            silent += 1
            if silent == 2 and not doubled:
                return noise
            continue
        except DeviceFault:
            noise, doubled = servos.heard, doubled + 1
            continue
        again = servos.line.read_some(QUIET_S)
        if again:
            noise, doubled = again, doubled + 1
            servos.line.drain(QUIET_S)
            continue
        row.found = found
        return b""
    row.wrong.append(f"garbled or double answers ({noise.hex(' ')}): two servos may have the id {row.servo_id}")
    return noise


def _compare_identity(row: Identity, settings: DynamixelSettings) -> None:
    table, found = row.expected.table, row.found
    if found is None:
        if not row.wrong:
            row.wrong.append("no answer")
        return
    if found.model_number != table.number:
        row.wrong.append(f"is an {model_text(found.model_number)}, not an {table.name}")
    least = settings.minimum_firmware
    if least is not None and found.firmware < least:
        row.wrong.append(f"firmware {found.firmware} is older than {least}")


def _compare_settings(servos: ServoLine, row: Identity, settings: DynamixelSettings) -> None:
    table = row.expected.table
    data = servos.read_surely(row.servo_id, 0, EEPROM_BYTES)
    found = {
        name: register.decode(data[register.address : register.end])
        for name, register in table.registers.items()
        if register.in_eeprom
    }
    found["status_return_level"] = servos.read_register(row.servo_id, table.register("status_return_level"))
    row.settings = found
    for name, value in expected_settings(settings).items():
        if found[name] != value:
            row.wrong.append(f"{name} is {found[name]}, not {value}")
    if found["secondary_id"] < DISABLED_ID:
        row.wrong.append(f"secondary_id is {found['secondary_id']}, not off (255): it would obey another's id too")
    row.baud = BAUDS[found["baud_rate"]] if found["baud_rate"] < len(BAUDS) else None
    if settings.operating_mode is OperatingMode.POSITION:
        ticks = sorted((row.expected.tick_of(row.joint.low_rad), row.expected.tick_of(row.joint.high_rad)))
        low, high = found["min_position_limit"], found["max_position_limit"]
        if low > max(ticks[0], 0) or high < min(ticks[1], settings.tick_range[1]):
            row.wrong.append(f"position limits are {low} to {high}, and the joint needs {ticks[0]} to {ticks[1]}")


def expected_settings(settings: DynamixelSettings) -> dict[str, int]:
    """Registers that must hold just this value."""
    return {
        "operating_mode": int(settings.operating_mode),
        "drive_mode": 0,
        "homing_offset": settings.homing_offset_ticks,
        "status_return_level": 2,
    }


def _search_bauds(servos: ServoLine, rows: Sequence[Identity], began_s: float) -> None:
    """At which other rate do those answer that do not at this one?"""
    line = servos.line
    here = line.settings.baud
    try:
        with servos.patience(SEARCH_PATIENCE_S):
            for baud in (rate for rate in (57_600, *reversed(BAUDS)) if rate != here):
                silent = [row for row in rows if row.found is None]
                if not silent or time.monotonic() - began_s > LONGEST_S:
                    return
                line.set_baud(baud)
                for row in silent:
                    _try_at(servos, row, baud)
    finally:
        line.set_baud(here)


def _try_at(servos: ServoLine, row: Identity, baud: int) -> None:
    try:
        found = servos.ping(row.servo_id)
    except (DeviceTimeout, DeviceFault):
        return
    row.found, row.baud = found, baud
    row.wrong = [f"answers at {baud} baud"]


def _strangers(servos: ServoLine, rows: Sequence[Identity], began_s: float) -> tuple[Pinged, ...]:
    """Who else is on the bus, when somebody is missing and the time allows."""
    missing = any(row.found is None for row in rows)
    if not missing or time.monotonic() - began_s > LONGEST_S - 1.0:
        return ()
    own = {row.servo_id for row in rows}
    return tuple(found for found in servos.ping_all() if found.servo_id not in own)


def _nobody(rows: Sequence[Identity], baud: int, noise: bytes) -> DeviceError:
    ids = ", ".join(str(row.servo_id) for row in rows)
    elsewhere = {row.baud for row in rows if row.baud is not None}
    expected = f"Dynamixel servos with the ids {ids} at {baud} baud"
    if elsewhere:
        rates = " and ".join(str(rate) for rate in sorted(elsewhere))
        return _told(ServoMismatch, rows, expected, f"them at {rates} baud", f"set arm.baud = {min(elsewhere)}")
    if noise and protocol2.HEADER[:3] in noise:
        return _mismatch(rows, None, baud, ())
    if noise:
        return WrongDevice(
            DEVICE, expected, f"bytes that no Dynamixel sends: {noise[:16].hex(' ')} ({_text(noise[:16])})",
            "another device is on this port: correct arm.port, or its baud",
        )  # fmt: skip
    return _told(
        ServosMissing, rows, expected, "silence at every baud",
        "check the arm's power, the cable and that arm.port is the servos' adapter",
    )  # fmt: skip


def _text(data: bytes) -> str:
    return "".join(chr(byte) if 32 <= byte < 127 else "." for byte in data)


def _mismatch(
    rows: Sequence[Identity], settings: DynamixelSettings | None, baud: int, strangers: Sequence[Pinged]
) -> DeviceError:
    kind: Callable[..., DeviceError] = ServoMismatch
    wrong = [row for row in rows if row.wrong]
    if all(row.found is None and row.wrong == ["no answer"] for row in wrong):
        kind = ServosMissing
    found = "; ".join(f"{row.joint.name} (servo {row.servo_id}): {', '.join(row.wrong)}" for row in wrong)
    if strangers:
        found += "; also there: " + ", ".join(
            f"servo {pinged.servo_id} ({model_text(pinged.model_number)})" for pinged in strangers
        )
    found += "\n" + table_text(rows, settings, baud)
    remedy = "correct arm.servos in the configuration, or set the servo (its EEPROM, with torque off)"
    return _told(kind, rows, "the servos of the configuration", found, remedy)


def _told(
    kind: Callable[..., DeviceError], rows: Sequence[Identity], expected: str, found: str, remedy: str
) -> DeviceError:
    error = kind(DEVICE, expected, found, remedy)
    assert isinstance(error, ServoMismatch | ServosMissing)
    error.rows = tuple(rows)
    return error


def table_text(rows: Sequence[Identity], settings: DynamixelSettings | None, baud: int) -> str:
    """Expected and found of every servo, side by side, one line each."""
    lines = [_COLUMNS, *(_cells(row, settings, baud) for row in rows)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(_COLUMNS))]
    return "\n".join(
        "  " + "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines
    )


def _cells(row: Identity, settings: DynamixelSettings | None, baud: int) -> tuple[str, ...]:
    least = settings.minimum_firmware if settings else None
    found = row.found
    asked = {} if settings is None else expected_settings(settings)
    return (
        str(row.servo_id),
        row.joint.name,
        row.expected.model,
        "any" if least is None else f">= {least}",
        str(baud),
        _short(asked),
        "-" if found is None else model_text(found.model_number),
        "-" if found is None else str(found.firmware),
        "-" if row.baud is None else str(row.baud),
        _short({name: row.settings[name] for name in asked if name in row.settings}),
    )


_SHORT = {"operating_mode": "mode", "drive_mode": "drive", "homing_offset": "homing", "status_return_level": "answers"}


def _short(values: dict[str, int]) -> str:
    return " ".join(f"{_SHORT[name]}={value}" for name, value in values.items()) or "-"
