"""Relay boards as their makers built them, each a unit on an emulated Modbus bus.

Written from the makers' register maps and not from the driver's profiles, so that one is a test of the other.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from drivers.emulation.modbus_answers import bits, words
from drivers.emulation.modbus_slave import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE, ModbusException
from drivers.relay.emulated_outputs import Outputs
from drivers.relay.values import Channel
from drivers.twin.machine import Twin

COIL_ON, COIL_OFF, COIL_FLIP = 0xFF00, 0x0000, 0x5500


class CoilBoard:
    """Coils 0.. by functions 01, 05 and 15, and nothing else."""

    def __init__(self, outputs: Outputs) -> None:
        self.outputs = outputs

    def answer(self, function: int, data: bytes) -> bytes | None:
        address, value = int.from_bytes(data[:2], "big"), int.from_bytes(data[2:4], "big")
        if function == 1:
            return bits(self.outputs.contacts(), address, value)
        if function == 5:
            self.write_coil(address, value)
            return data
        if function == 15:
            if address + value > self.outputs.count:
                raise ModbusException(ILLEGAL_ADDRESS)
            for place in range(value):
                self.outputs.switch(address + place + 1, bool(data[5 + place // 8] >> place % 8 & 1))
            return data[:4]
        return self.other(function, address, value, data)

    def write_coil(self, address: int, value: int) -> None:
        """Function 05."""
        if address >= self.outputs.count:
            raise ModbusException(ILLEGAL_ADDRESS)
        if value not in (COIL_ON, COIL_OFF):
            raise ModbusException(ILLEGAL_VALUE)
        self.outputs.switch(address + 1, value == COIL_ON)

    def other(self, function: int, address: int, value: int, data: bytes) -> bytes | None:
        """A function that is not of coils."""
        raise ModbusException(ILLEGAL_FUNCTION)

    def power_cycle(self) -> None:
        """Power goes and comes back: every coil is off, running pulses are forgotten."""
        self.outputs.all_off()


class WaveshareBoard(CoilBoard):
    """Function 05 at 0x0200 + n is a pulse of value x 100 ms, whatever the value; at 0x00FF it is for all coils."""

    FLASH_ON, ALL = 0x0200, 0x00FF
    QUANTUM_S = 0.1

    def __init__(self, outputs: Outputs, unit_id: int, version: int = 200) -> None:
        super().__init__(outputs)
        self._words = {0x4000: unit_id, 0x2000: 1, 0x8000: version}

    def write_coil(self, address: int, value: int) -> None:
        number = address - self.FLASH_ON + 1
        if 1 <= number <= self.outputs.count:
            self.outputs.pulse(number, value * self.QUANTUM_S)
            return
        if value not in (COIL_ON, COIL_OFF, COIL_FLIP):
            raise ModbusException(ILLEGAL_VALUE)
        if address == self.ALL:
            numbers = range(1, self.outputs.count + 1)
        elif address < self.outputs.count:
            numbers = range(address + 1, address + 2)
        else:
            raise ModbusException(ILLEGAL_ADDRESS)
        contacts = self.outputs.contacts()
        for number in numbers:
            self.outputs.switch(number, not contacts[number - 1] if value == COIL_FLIP else value == COIL_ON)

    def other(self, function: int, address: int, value: int, data: bytes) -> bytes | None:
        if function == 3:
            return words(self._words, address, value)
        raise ModbusException(ILLEGAL_FUNCTION)


class LcBoard(CoilBoard):
    """Registers from 3 on, five a relay: mode (2 is flash on) and time of 100 ms, written together by function 16."""

    FIRST, STRIDE, FLASH_ON = 3, 5, 2
    QUANTUM_S = 0.1

    def __init__(self, outputs: Outputs, unit_id: int) -> None:
        super().__init__(outputs)
        self._words = {0: unit_id} | {
            self.FIRST + self.STRIDE * place + part: 0 for place in range(outputs.count) for part in (0, 1)
        }

    def other(self, function: int, address: int, value: int, data: bytes) -> bytes | None:
        if function == 2:
            return bits([False] * self.outputs.count, address, value)
        if function == 3:
            return words(self._words, address, value)
        if function == 16:
            place, beside = divmod(address - self.FIRST, self.STRIDE)
            if value != 2 or beside or not 0 <= place < self.outputs.count:
                raise ModbusException(ILLEGAL_ADDRESS)
            mode, quanta = int.from_bytes(data[5:7], "big"), int.from_bytes(data[7:9], "big")
            if mode != self.FLASH_ON:
                raise ModbusException(ILLEGAL_VALUE)
            self._words |= {address: mode, address + 1: quanta}
            self.outputs.pulse(place + 1, quanta * self.QUANTUM_S)
            return data[:4]
        raise ModbusException(ILLEGAL_FUNCTION)


class DelayBoard:
    """R4D8A08 and its kin: a register a relay, command in the high byte. While a delay runs, on, off and all-off are
    acknowledged and change nothing; only a new delay does, 0 s among them.
    """

    ON, OFF, TOGGLE, LATCH, MOMENTARY, DELAY, ALL_ON, ALL_OFF = range(1, 9)

    def __init__(self, outputs: Outputs, first: int, unit_id: int) -> None:
        self.outputs = outputs
        self._first = first
        self._unit_id = unit_id

    def answer(self, function: int, data: bytes) -> bytes | None:
        address, value = int.from_bytes(data[:2], "big"), int.from_bytes(data[2:4], "big")
        if function == 3:
            return words(self.registers(), address, value)
        if function == 6:
            self.command(address, value)
            return data
        if function == 16:
            for place in range(value):
                self.command(address + place, int.from_bytes(data[5 + 2 * place : 7 + 2 * place], "big"))
            return data[:4]
        raise ModbusException(ILLEGAL_FUNCTION)

    def registers(self) -> dict[int, int]:
        """What can be read."""
        return {self._first + place: int(on) for place, on in enumerate(self.outputs.contacts())}

    def command(self, address: int, value: int) -> None:
        """One register written."""
        verb, seconds = value >> 8, value & 0xFF
        number = address - self._first + 1
        if address == 0 and verb in (self.ALL_ON, self.ALL_OFF):
            for each in range(1, self.outputs.count + 1):
                self._switch(each, verb == self.ALL_ON)
        elif not 1 <= number <= self.outputs.count:
            raise ModbusException(ILLEGAL_ADDRESS)
        elif verb in (self.ON, self.OFF):
            self._switch(number, verb == self.ON)
        elif verb == self.TOGGLE:
            self._switch(number, not self.outputs.contacts()[number - 1])
        elif verb == self.LATCH:
            for each in range(1, self.outputs.count + 1):
                self._switch(each, each == number)
        elif verb == self.MOMENTARY:
            self.outputs.pulse(number, 1.0)
        elif verb == self.DELAY:
            self.outputs.pulse(number, float(seconds))
        else:
            raise ModbusException(ILLEGAL_VALUE)

    def power_cycle(self) -> None:
        """Power goes and comes back: every relay is off."""
        self.outputs.all_off()

    def _switch(self, number: int, on: bool) -> None:
        if not self.outputs.timed(number):
            self.outputs.switch(number, on)


class Ryn408fBoard(DelayBoard):
    """The same commands from register 0 on, its settings readable, and its relays as coils too."""

    BITMAP, ADDRESS, BAUD, PARITY = 0x0080, 0x00FD, 0x00FE, 0x00FF

    def __init__(self, outputs: Outputs, unit_id: int) -> None:
        super().__init__(outputs, 0, unit_id)

    def answer(self, function: int, data: bytes) -> bytes | None:
        address, value = int.from_bytes(data[:2], "big"), int.from_bytes(data[2:4], "big")
        if function == 1:
            return bits(self.outputs.contacts(), address, value)
        if function == 5:
            if not address < self.outputs.count:
                raise ModbusException(ILLEGAL_ADDRESS)
            if value not in (COIL_ON, COIL_OFF):
                raise ModbusException(ILLEGAL_VALUE)
            self._switch(address + 1, value == COIL_ON)
            return data
        return super().answer(function, data)

    def registers(self) -> dict[int, int]:
        bitmap = sum(on << place for place, on in enumerate(self.outputs.contacts()))
        told = dict.fromkeys(range(0x100), 0) | super().registers()
        return told | {self.BITMAP: bitmap, self.ADDRESS: self._unit_id}

    def command(self, address: int, value: int) -> None:
        if address != self.BITMAP:
            super().command(address, value)
            return
        if value > 0xFF:
            raise ModbusException(ILLEGAL_VALUE)
        for number in range(1, self.outputs.count + 1):
            self._switch(number, bool(value >> number - 1 & 1))


class WirenboardBoard(CoilBoard):
    """Holding 8: everything off after so many seconds without a request to it, 0 is never. Holding 6: whether the coils
    come back as they were when power does. Both are kept without power.
    """

    RESTORE, SAFE_AFTER, UNIT_ID, MODEL = 6, 8, 128, 200

    def __init__(self, outputs: Outputs, unit_id: int, model: str = "WBMR6C", restore: int = 0) -> None:
        super().__init__(outputs)
        self.held = {self.RESTORE: restore, self.SAFE_AFTER: 0}
        self._fixed = {self.UNIT_ID: unit_id} | {self.MODEL + place: ord(sign) for place, sign in enumerate(model)}
        self._silence: asyncio.TimerHandle | None = None

    def answer(self, function: int, data: bytes) -> bytes | None:
        try:
            return super().answer(function, data)
        finally:
            self._listen_anew()

    def other(self, function: int, address: int, value: int, data: bytes) -> bytes | None:
        if function in (3, 4):
            return words(self.held | self._fixed, address, value)
        if function == 6:
            if address not in self.held:
                raise ModbusException(ILLEGAL_ADDRESS)
            self.held[address] = value
            return data
        raise ModbusException(ILLEGAL_FUNCTION)

    def power_cycle(self) -> None:
        before = self.outputs.contacts()
        self.outputs.all_off()
        if self.held[self.RESTORE]:
            for number, on in enumerate(before, start=1):
                self.outputs.switch(number, on)

    def _listen_anew(self) -> None:
        if self._silence is not None:
            self._silence.cancel()
            self._silence = None
        if seconds := self.held[self.SAFE_AFTER]:
            self._silence = asyncio.get_running_loop().call_later(float(seconds), self.outputs.all_off)


EmulatedBoard = CoilBoard | DelayBoard

_CHANNELS = {"waveshare-16": 16, "waveshare-32": 32, "wb-mr6": 6}


def emulated_board(
    profile: str, unit_id: int, twin: Twin, clock: Callable[[], float], wired: Mapping[Channel, int]
) -> EmulatedBoard:
    """The board that a profile of this name is for. ``ValueError`` when there is none."""
    outputs = Outputs(twin, clock, _CHANNELS.get(profile, 8), wired)
    if profile.startswith("waveshare"):
        return WaveshareBoard(outputs, unit_id)
    if profile == "lc-8":
        return LcBoard(outputs, unit_id)
    if profile == "r4d8a08":
        return DelayBoard(outputs, 1, unit_id)
    if profile == "ryn408f":
        return Ryn408fBoard(outputs, unit_id)
    if profile == "wb-mr6":
        return WirenboardBoard(outputs, unit_id)
    if profile == "generic-coils":
        return CoilBoard(outputs)
    raise ValueError(f"relay: no emulated board for the profile {profile!r}")
