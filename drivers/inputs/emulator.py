"""The input modules of the reference rig, each a unit on an emulated Modbus bus, reading the twin's sensors."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from drivers.emulation.bad_line import BadLine
from drivers.emulation.modbus_answers import bits, words
from drivers.emulation.modbus_slave import ILLEGAL_FUNCTION, ModbusException, ModbusSlaves, SlaveUnit
from drivers.inputs.mock import miscalibrated
from drivers.inputs.values import InputState
from drivers.twin.bus import STALE_S
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin

STEP_UA = 5  # 12 bits of 20 mA
ZERO_UA, SPAN_UA = 4000.0, 16000.0


class Sampler:
    """The sensors as the modules see them: true, frozen, miscalibrated, late, or with a cut wire."""

    def __init__(self, twin: Twin, clock: Callable[[], float]) -> None:
        self.cut: set[str] = set()
        """Quantities whose wire is cut."""
        self._twin, self._clock = twin, clock
        self._frozen: InputState | None = None
        self._seen: deque[InputState] = deque()

    def sample(self) -> InputState:
        now_s = self._clock()
        state = self._twin.inputs(now_s)
        self._seen.append(state)
        while len(self._seen) > 1 and self._seen[1].stamp_s <= now_s - STALE_S:
            self._seen.popleft()
        verb = self._twin.verb("inputs", now_s)
        if verb is Verb.STUCK:
            self._frozen = self._frozen or state
            return self._frozen
        self._frozen = None
        if verb is Verb.DELAYED:
            return self._seen[0]
        return miscalibrated(state) if verb is Verb.WRONG else state


class AnalogModule:
    """Waveshare Modbus RTU Analog Input 8CH: channels 1 to 3 carry level, pressure and battery, the others nothing."""

    def __init__(self, sampler: Sampler, unit_id: int, full: dict[str, float]) -> None:
        self._sampler, self._full = sampler, full
        self._settings = {0x4000: unit_id, 0x8000: 200} | {0x1000 + place: 3 for place in range(8)}

    def answer(self, function: int, data: bytes) -> bytes | None:
        address, count = int.from_bytes(data[:2], "big"), int.from_bytes(data[2:4], "big")
        if function == 3:
            return words(self._settings, address, count)
        if function == 4:
            return words(self._currents(), address, count)
        raise ModbusException(ILLEGAL_FUNCTION)

    def _currents(self) -> dict[int, int]:
        state = self._sampler.sample()
        currents = dict.fromkeys(range(8), 0)
        for place, (quantity, full) in enumerate(self._full.items()):
            if quantity not in self._sampler.cut:
                exact = ZERO_UA + SPAN_UA * float(getattr(state, quantity)) / full
                currents[place] = round(min(max(exact, 0.0), 22_000.0) / STEP_UA) * STEP_UA
        return currents


class DigitalModule:
    """Contacts 1 (e-stop) and 2 (bumper), closed while released; pulses of the flow meter, counted and timed."""

    def __init__(self, sampler: Sampler, unit_id: int, pulses_per_ml: float, first_count: int = 0) -> None:
        self._sampler, self._pulses_per_ml, self._first_count = sampler, pulses_per_ml, first_count
        self._settings = {0x4000: unit_id, 0x8000: 200}

    def answer(self, function: int, data: bytes) -> bytes | None:
        address, count = int.from_bytes(data[:2], "big"), int.from_bytes(data[2:4], "big")
        if function == 2:
            return bits(self._contacts(), address, count)
        if function == 3:
            return words(self._settings, address, count)
        if function == 4:
            return words(self._counter(), address, count)
        raise ModbusException(ILLEGAL_FUNCTION)

    def _contacts(self) -> list[bool]:
        state = self._sampler.sample()
        closed = [not state.estop_pressed, not state.bumper_pressed]
        whole = [quantity not in self._sampler.cut for quantity in ("estop_pressed", "bumper_pressed")]
        return [a and b for a, b in zip(closed, whole, strict=True)] + [False] * 6

    def _counter(self) -> dict[int, int]:
        state = self._sampler.sample()
        count = (self._first_count + round(state.flow_total_ml * self._pulses_per_ml)) % (1 << 32)
        tenths_hz = min(0xFFFF, round(10.0 * state.flow_ml_s * self._pulses_per_ml))
        return {0: count >> 16, 1: count & 0xFFFF, 2: tenths_hz}


class Inclinometer:
    """WitMotion: roll and pitch at 0x3D and 0x3E, 32768 for 180 degrees."""

    def __init__(self, sampler: Sampler, unit_id: int) -> None:
        self._sampler, self._unit_id = sampler, unit_id

    def answer(self, function: int, data: bytes) -> bytes | None:
        if function != 3:
            raise ModbusException(ILLEGAL_FUNCTION)
        state = self._sampler.sample()
        registers = {0x1A: self._unit_id, 0x3D: _turned(state.roll_rad), 0x3E: _turned(state.pitch_rad), 0x3F: 0}
        return words(registers, int.from_bytes(data[:2], "big"), int.from_bytes(data[2:4], "big"))


def _turned(angle_rad: float) -> int:
    return round(min(max(angle_rad / math.pi, -1.0), 0.99996) * 0x8000) & 0xFFFF


class EmulatedInputs:
    """The three modules of the reference rig."""

    def __init__(
        self,
        twin: Twin,
        clock: Callable[[], float],
        analog_unit: int = 2,
        digital_unit: int = 3,
        tilt_unit: int = 80,
        pressure_full_bar: float = 10.0,
        battery_full_v: float = 40.0,
        first_count: int = 0,
    ) -> None:
        """``first_count``: where the flow meter's counter stood before."""
        self.sampler = Sampler(twin, clock)
        full = {
            "tank_level_ml": twin.nominal.tank_ml, "pressure_bar": pressure_full_bar, "battery_v": battery_full_v,
        }  # fmt: skip
        pulses_per_ml = 1e-3 * twin.nominal.flow_meter_pulses_per_l
        self.units: dict[int, SlaveUnit] = {
            analog_unit: AnalogModule(self.sampler, analog_unit, full),
            digital_unit: DigitalModule(self.sampler, digital_unit, pulses_per_ml, first_count),
            tilt_unit: Inclinometer(self.sampler, tilt_unit),
        }

    def join(self, slaves: ModbusSlaves, line: BadLine) -> None:
        """Put the modules on a bus; ``line`` is the one of device "inputs"."""
        for unit_id, unit in self.units.items():
            slaves.add(unit_id, unit, line)
