"""What a Modbus unit must answer to be the one that the configuration names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from drivers import modbus_pdu as pdu
from drivers.errors import DeviceFault, DeviceMissing, DeviceTimeout, WrongDevice
from drivers.modbus_master import ModbusLine, ModbusRefusal, ModbusUnit

T = TypeVar("T")

TRIES = 3
SECOND_ANSWER_S = 0.02

_AREAS = {
    pdu.READ_COILS: "coil",
    pdu.READ_DISCRETE_INPUTS: "discrete input",
    pdu.READ_HOLDING: "holding register",
    pdu.READ_INPUT_REGISTERS: "input register",
}


@dataclass(frozen=True, slots=True)
class Probe:
    """``count`` bits or words from ``address`` on must be readable, and say ``what``.

    ``own_id``: the unit's own id. ``text``: stands in what they spell, one character a word. ``absent``: they are not
    to be readable. Otherwise each lies within ``low`` and ``high``.
    """

    what: str
    function: int
    address: int
    count: int = 1
    low: int = 0
    high: int = 0xFFFF
    own_id: bool = False
    text: str = ""
    absent: bool = False

    @property
    def place(self) -> str:
        return f"{_AREAS[self.function]} {self.address:#06x}"

    def read(self, unit: ModbusUnit) -> list[int]:
        if self.function == pdu.READ_COILS:
            return [int(bit) for bit in unit.read_coils(self.address, self.count)]
        if self.function == pdu.READ_DISCRETE_INPUTS:
            return [int(bit) for bit in unit.read_discrete_inputs(self.address, self.count)]
        if self.function == pdu.READ_HOLDING:
            return unit.read_holding(self.address, self.count)
        return unit.read_input_registers(self.address, self.count)

    def mismatch(self, words: Sequence[int], unit_id: int) -> tuple[str, str] | None:
        """(expected, found), None when all is well."""
        if self.text:
            spelt = "".join(chr(word) for word in words if 32 <= word < 127)
            return None if self.text in spelt else (f"{self.text!r}", f"{spelt!r}")
        low, high = (unit_id, unit_id) if self.own_id else (self.low, self.high)
        if all(low <= word <= high for word in words):
            return None
        return (str(low) if low == high else f"{low} to {high}"), " ".join(map(str, words))


def prove(line: ModbusLine, device: str, unit_id: int, kind: str, probes: Sequence[Probe], timeout_s: float) -> None:
    """Ask every probe. ``DeviceMissing`` (silence), ``WrongDevice`` (something else, or two of them), ``OSError``."""
    unit = line.unit(device, unit_id, timeout_s)
    for number, probe in enumerate(probes):
        if probe.absent:
            _prove_absent(unit, device, unit_id, kind, probe)
            continue
        expected = f"a {kind} with unit id {unit_id}: {probe.what} at {probe.place}"
        try:
            words = insist(lambda probe=probe: probe.read(unit))  # type: ignore[misc]
        except DeviceTimeout as error:
            if number == 0:
                raise DeviceMissing(
                    device, f"a {kind} that answers as unit {unit_id}", "silence",
                    "check its power, its cable, unit id and baud rate",
                ) from error  # fmt: skip
            raise _wrong(device, expected, "silence, though it answered before") from error
        except ModbusRefusal as error:
            raise _wrong(device, expected, error.found) from error
        except DeviceFault as error:
            raise WrongDevice(
                device, f"a {kind} that answers as unit {unit_id}", error.found,
                "check what is plugged in there, the baud rate, and that each unit id is there once",
            ) from error  # fmt: skip
        if mismatch := probe.mismatch(words, unit_id):
            raise _wrong(device, f"{expected} to be {mismatch[0]}", mismatch[1])
        if number == 0 and (stray := line.listen(SECOND_ANSWER_S)):
            raise WrongDevice(
                device, f"one unit {unit_id} on the bus", f"a second answer ({stray[:16].hex(' ')})",
                "give each unit on the bus an id of its own",
            )  # fmt: skip


def _prove_absent(unit: ModbusUnit, device: str, unit_id: int, kind: str, probe: Probe) -> None:
    try:
        words = insist(lambda: probe.read(unit))
    except (ModbusRefusal, DeviceTimeout):
        return
    expected = f"a {kind} with unit id {unit_id}, which has nothing at {probe.place}"
    raise _wrong(device, expected, f"{probe.what}: {' '.join(map(str, words))}")


def insist(read: Callable[[], T], tries: int = TRIES) -> T:
    """A reading, asked again when the answer is missing or garbled; an exception reply is an answer."""
    for _ in range(tries - 1):
        try:
            return read()
        except ModbusRefusal:
            raise
        except (DeviceTimeout, DeviceFault):
            continue
    return read()


def _wrong(device: str, expected: str, found: str) -> WrongDevice:
    return WrongDevice(device, expected, found, "correct the device's profile, or connect the right device")
