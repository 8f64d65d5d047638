"""The inputs on the twin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from drivers.inputs.values import InputState
from drivers.twin.bus import Bus
from drivers.twin.machine import Twin

TIMEOUT_S = 0.3
WRONG_SCALE = 1.2


class MockInputs:
    """Implements ``drivers.inputs.interface.Inputs``; ``clock`` gives loop time."""

    def __init__(self, twin: Twin, clock: Callable[[], float]) -> None:
        self._twin, self._clock = twin, clock
        self._bus = Bus(twin, clock, "inputs", twin.nominal.inputs_round_trip_s, TIMEOUT_S)

    async def open(self) -> None:
        await self._bus.connect()

    async def close(self) -> None:
        self._bus.disconnect()

    async def read(self) -> InputState:
        state = await self._bus.exchange(lambda: self._twin.inputs(self._clock()))
        return self._bus.seen(state, miscalibrated)


def miscalibrated(state: InputState) -> InputState:
    """The liquid as sensors of a wrong calibration see it."""
    return replace(
        state,
        tank_level_ml=state.tank_level_ml * WRONG_SCALE,
        flow_ml_s=state.flow_ml_s * WRONG_SCALE,
        flow_total_ml=state.flow_total_ml * WRONG_SCALE,
        pressure_bar=state.pressure_bar * WRONG_SCALE,
    )
