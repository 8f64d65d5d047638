"""The rover's inputs on a Modbus bus, by a map of points."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers import modbus_pdu as pdu
from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceMissing, DeviceTimeout
from drivers.inputs.points import QUANTITIES, Block, Module, Point, blocks
from drivers.inputs.readings import Readings
from drivers.inputs.values import InputState
from drivers.modbus_master import TIMEOUT_S, ModbusLine, ModbusMaster, ModbusRefusal
from drivers.modbus_probe import TRIES, prove


@dataclass(frozen=True, slots=True)
class InputsSettings:
    """The modules on the bus and one point for each quantity of ``InputState``. ``ValueError`` for what cannot be."""

    modules: tuple[Module, ...]
    points: tuple[Point, ...]
    reply_timeout_s: float = TIMEOUT_S

    def __post_init__(self) -> None:
        told = [point.quantity for point in self.points]
        missing = [quantity for quantity in QUANTITIES if quantity not in told]
        if missing:
            raise ValueError(f"points: expected each quantity, found none for {', '.join(missing)}; add them")
        twice = sorted({quantity for quantity in told if told.count(quantity) > 1})
        if twice:
            raise ValueError(f"points: expected each quantity once, found two for {', '.join(twice)}; remove one")
        known = [module.unit_id for module in self.modules]
        if len(set(known)) < len(known):
            raise ValueError("modules: expected a unit id for each, found one twice; correct it")
        strange = sorted({point.unit_id for point in self.points} - set(known))
        if strange:
            raise ValueError(f"points: unit {strange[0]} is none of the modules; name its module")
        if not 0.0 < self.reply_timeout_s < math.inf:
            raise ValueError(f"reply_timeout_s: expected a positive number, found {self.reply_timeout_s}; correct it")


class ModbusInputs:
    """Implements ``drivers.inputs.interface.Inputs``; ``clock`` gives loop time.

    Each frame of a poll is a job of its own on the bus, tried up to three times: a stop waits for one frame only.
    """

    def __init__(self, settings: InputsSettings, bus: ModbusMaster, clock: Callable[[], float]) -> None:
        self._settings, self._bus, self._clock = settings, bus, clock
        self._blocks = blocks(settings.points)
        self._readings = Readings(settings.points)
        self._greeted: ModbusLine | None = None
        self._is_open = False

    async def open(self) -> None:
        self._is_open = False
        await self._bus.attach("inputs", self._on_connection)
        self._is_open = True

    async def close(self) -> None:
        if self._is_open:
            self._is_open = False
            self._greeted = None
            await self._bus.detach("inputs")

    async def read(self) -> InputState:
        """Stamped when the first frame is sent: nothing in it is older."""
        if not self._is_open:
            raise DeviceLost("inputs", "an open connection", "a closed one", "open the device first")
        stamp_s = math.nan
        polled: dict[Block, list[int]] = {}
        for block in self._blocks:
            asked_s, polled[block] = await self._poll(block)
            stamp_s = asked_s if math.isnan(stamp_s) else stamp_s
        told: dict[str, Any] = self._readings.quantities(polled)
        return InputState(stamp_s=stamp_s, **told)

    async def _poll(self, block: Block) -> tuple[float, list[int]]:
        for _ in range(TRIES - 1):
            try:
                return await self._bus.run(lambda line: self._read(line, block))
            except ModbusRefusal:
                raise
            except (DeviceTimeout, DeviceFault):
                continue
        return await self._bus.run(lambda line: self._read(line, block))

    # --- in the owner's thread

    def _read(self, line: ModbusLine, block: Block) -> tuple[float, list[int]]:
        if line is not self._greeted:
            try:
                self._greet(line)
            except DeviceMissing as error:  # the port is there, and the module was
                raise DeviceTimeout(error.device, error.expected, error.found, error.remedy) from error
        unit = line.unit("inputs", block.unit_id, self._settings.reply_timeout_s)
        asked_s = self._clock()
        if block.function == pdu.READ_COILS:
            return asked_s, [int(bit) for bit in unit.read_coils(block.address, block.count)]
        if block.function == pdu.READ_DISCRETE_INPUTS:
            return asked_s, [int(bit) for bit in unit.read_discrete_inputs(block.address, block.count)]
        if block.function == pdu.READ_HOLDING:
            return asked_s, unit.read_holding(block.address, block.count)
        return asked_s, unit.read_input_registers(block.address, block.count)

    def _on_connection(self, line: ModbusLine) -> None:
        """The greeting. While the inputs are open others use the line too: the next reading greets again, and says why
        it cannot.
        """
        self._greeted = None
        try:
            self._greet(line)
        except DeviceError:
            if not self._is_open:
                raise

    def _greet(self, line: ModbusLine) -> None:
        for module in self._settings.modules:
            prove(line, "inputs", module.unit_id, module.title, module.probes, self._settings.reply_timeout_s)
        self._greeted = line
