"""What is said to a ZLAC8015D, in the owner thread of its port.

Every function raises ``DeviceTimeout``, ``DeviceFault``, or ``OSError`` when the port is gone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from drivers import modbus_pdu as pdu
from drivers.errors import DeviceFault, DeviceMissing, DeviceTimeout, WrongDevice
from drivers.modbus_master import ModbusRefusal, ModbusUnit
from drivers.wheels import zlac_registers as r
from drivers.wheels.zlac_settings import Zlac8015dSettings

DEVICE = "wheels"
TRIES = 2
FIRST_TRIES = 3
PLAUSIBLE_SUPPLY_V = (5.0, 75.0)

T = TypeVar("T")


def persist(ask: Callable[[], T], tries: int = TRIES) -> T:
    """Ask again when no answer or a garbled one came. What the controller refuses is not asked again."""
    while True:
        tries -= 1
        try:
            return ask()
        except ModbusRefusal:
            raise
        except (DeviceTimeout, DeviceFault):
            if tries <= 0:
                raise


def prove_identity(unit: ModbusUnit, unit_id: int) -> None:
    """Only reads. ``DeviceMissing`` when nothing answers, ``WrongDevice`` when it is no ZLAC8015D."""
    wanted = f"a ZLAC8015D as unit {unit_id}"
    try:
        told_id = persist(lambda: unit.read_holding(r.UNIT_ID.address, 1), FIRST_TRIES)[0]
        mode = persist(lambda: unit.read_holding(r.MODE.address, 1), FIRST_TRIES)[0]
        reading = persist(lambda: unit.read_holding(r.FIRST_READING, r.READING_WORDS), FIRST_TRIES)
    except DeviceTimeout as error:
        raise DeviceMissing(
            DEVICE, wanted, "silence", "check power, cable (A to A, B to B), unit id and baud rate"
        ) from error
    except ModbusRefusal as refusal:
        raise WrongDevice(
            DEVICE, wanted, f"something that answers its registers with {refusal.found}",
            "correct the port or the unit id in the configuration",
        ) from refusal  # fmt: skip
    except DeviceFault as fault:
        raise DeviceFault(
            DEVICE, wanted, fault.found, "check the baud rate, that nothing else is on this port, and the cable"
        ) from fault
    supply_v = 0.01 * reading[r.BUS_VOLTAGE.address - r.FIRST_READING]
    low_v, high_v = PLAUSIBLE_SUPPLY_V
    for ok, told in (
        (told_id == unit_id, f"something that calls itself unit {told_id}"),
        (mode <= r.MODE.high, f"something in mode {mode}"),
        (low_v <= supply_v <= high_v, f"something supplied with {supply_v:g} V"),
    ):
        if not ok:
            raise WrongDevice(DEVICE, wanted, told, "correct the port or the unit id in the configuration")


def require_no_faults(channel_words: Sequence[int], settings: Zlac8015dSettings) -> None:
    """``DeviceFault`` names wheel, fault and remedy. The words are those of the controller's left and right channel."""
    wheels = ("right", "left") if settings.swapped else ("left", "right")
    faults = [(wheel, fault) for wheel, word in zip(wheels, channel_words, strict=True) for fault in r.faults_in(word)]
    if not faults:
        return
    found = ", ".join(f"{fault.name} (0x{fault.bit:04X}) of the {wheel} wheel" for wheel, fault in faults)
    remedies = "; ".join(dict.fromkeys(fault.remedy for _, fault in faults))
    raise DeviceFault(
        DEVICE, "no fault", found, f"{remedies}; then clear the alarm or switch the controller off and on"
    )


def read_faults(unit: ModbusUnit) -> list[int]:
    """The fault words of both channels."""
    return persist(lambda: unit.read_holding(r.LEFT_FAULTS.address, 2))


def set_up(unit: ModbusUnit, settings: Zlac8015dSettings) -> None:
    """Wanted speed 0 first; then no fault, velocity mode, limits, time-out, all read back; then enabled.

    ``DeviceFault`` for a fault (which is never cleared here), or when a setting does not take.
    """
    command(unit, 0, 0)
    require_no_faults(read_faults(unit), settings)
    _set(unit, r.OFFLINE_TIME, (settings.timeout_ms,), "update the controller's firmware, or another command time-out")
    _set(unit, r.MODE, (r.VELOCITY_MODE,), "switch the controller off and on")
    _set(unit, r.MAX_SPEED, (settings.max_rpm,), "correct max_speed_m_s")
    rise, fall = settings.rise_ms, settings.fall_ms
    _set(unit, r.LEFT_RISE, (rise, rise, fall, fall), "correct max_acceleration_m_s2")
    control(unit, r.Control.ENABLE)


def still_set_up(unit: ModbusUnit, settings: Zlac8015dSettings) -> bool:
    """Whether the controller holds what ``set_up`` gave it: one that lost its power in between does not."""
    timeout = persist(lambda: unit.read_holding(r.OFFLINE_TIME.address, 1))
    mode = persist(lambda: unit.read_holding(r.MODE.address, 1))
    limit = persist(lambda: unit.read_holding(r.MAX_SPEED.address, 1))
    ramps = persist(lambda: unit.read_holding(r.LEFT_RISE.address, 4))
    rise, fall = settings.rise_ms, settings.fall_ms
    told = (*timeout, *mode, *limit, *ramps)
    return told == (settings.timeout_ms, r.VELOCITY_MODE, settings.max_rpm, rise, rise, fall, fall)


def command(unit: ModbusUnit, left_rpm: int, right_rpm: int) -> None:
    """Both channels in one frame."""
    request = command_request(left_rpm, right_rpm)
    persist(lambda: unit.send(request))


def command_request(left_rpm: int, right_rpm: int) -> pdu.Request:
    return pdu.write_registers(r.LEFT_TARGET.address, [r.word_of(left_rpm), r.word_of(right_rpm)])


def control(unit: ModbusUnit, word: r.Control) -> None:
    persist(lambda: unit.write_register(r.CONTROL.address, word))


def halt(unit: ModbusUnit) -> None:
    """Speed 0 by the deceleration set; the controller's emergency stop when that is not acknowledged."""
    try:
        command(unit, 0, 0)
    except (DeviceTimeout, DeviceFault):
        unit.write_register(r.CONTROL.address, r.Control.EMERGENCY_STOP)


def _set(unit: ModbusUnit, first: r.Register, values: tuple[int, ...], remedy: str) -> None:
    """Write, read back, compare."""
    wanted = f"register 0x{first.address:04X} ({first.name}) to take {', '.join(map(str, values))}"
    try:
        if len(values) == 1:
            persist(lambda: unit.write_register(first.address, values[0]))
        else:
            persist(lambda: unit.write_registers(first.address, values))
        told = persist(lambda: unit.read_holding(first.address, len(values)))
    except ModbusRefusal as refusal:
        raise DeviceFault(DEVICE, wanted, refusal.found, remedy) from refusal
    if tuple(told) != values:
        raise DeviceFault(DEVICE, wanted, f"it at {', '.join(map(str, told))}", remedy)
