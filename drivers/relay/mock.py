"""A relay board on the twin."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from drivers.errors import DeviceFault, DeviceRefused
from drivers.relay.values import BoardCapability, Channel, PulseReceipt, RelayState
from drivers.twin.bus import Bus
from drivers.twin.commands import RelayAllOff, RelayPulse, RelaySwitch
from drivers.twin.machine import Twin

TIMEOUT_S = 0.1

_PULSED_ONLY = frozenset({Channel.VALVE, Channel.PUMP})


class MockRelay:
    """Implements ``drivers.relay.interface.RelayBoard``; ``clock`` gives loop time."""

    stop_lane = None

    def __init__(self, twin: Twin, clock: Callable[[], float]) -> None:
        self._twin, self._clock = twin, clock
        self._bus = Bus(twin, clock, "relay", twin.nominal.relay_round_trip_s, TIMEOUT_S)

    @property
    def capability(self) -> BoardCapability:
        return BoardCapability(self._twin.nominal.pulse_quantum_s, self._twin.nominal.pulse_max_s, None)

    @property
    def channels(self) -> frozenset[Channel]:
        return self._twin.nominal.channels

    async def open(self) -> None:
        await self._bus.connect()
        try:
            await self.all_off()
            state = await self.read()
        except BaseException:
            self._bus.disconnect()
            raise
        closed = sorted(channel for channel, on in state.coils.items() if on)
        if closed:
            self._bus.disconnect()
            raise DeviceFault(
                "relay", "all coils off", f"{', '.join(closed)} on", "cut the board's power and change the relay"
            )

    async def close(self) -> None:
        try:
            await self.all_off()
        finally:
            self._bus.disconnect()

    async def switch(self, channel: Channel, on: bool) -> None:
        self._require_wired(channel)
        if on and channel in _PULSED_ONLY:
            raise DeviceRefused("relay", f"a pulse for {channel}", "a switching on for good", "use pulse()")
        await self._bus.exchange(lambda: None, lambda at_s: self._send(RelaySwitch(channel, on, at_s)))

    async def pulse(self, channel: Channel, duration_s: float) -> PulseReceipt:
        self._require_wired(channel)
        longest_s, quantum_s = self._twin.nominal.pulse_max_s, self._twin.nominal.pulse_quantum_s
        if not 0.0 < duration_s <= longest_s:
            raise DeviceRefused(
                "relay", f"a pulse above 0 s, to {longest_s:g} s", f"{duration_s:g} s", "ask for a shorter pulse"
            )
        rounded_s = math.ceil(duration_s / quantum_s - 1e-9) * quantum_s
        sent_s: list[float] = []

        def send(at_s: float) -> None:
            sent_s.append(self._clock())
            self._send(RelayPulse(channel, rounded_s, at_s))

        await self._bus.exchange(lambda: None, send)
        return PulseReceipt(channel, sent_s[0], self._clock(), rounded_s)

    async def cancel(self, channel: Channel) -> None:
        await self.switch(channel, False)

    async def all_off(self) -> None:
        await self._bus.exchange(lambda: None, lambda at_s: self._send(RelayAllOff(at_s)))

    async def read(self) -> RelayState:
        state = await self._bus.exchange(lambda: RelayState(self._clock(), self._twin.coils(self._clock())))
        return self._bus.seen(state, _first_coil_inverted)

    def _send(self, command: RelaySwitch | RelayPulse | RelayAllOff) -> None:
        self._twin.apply(self._clock(), command)

    def _require_wired(self, channel: Channel) -> None:
        if channel not in self.channels:
            known = ", ".join(sorted(self.channels))
            raise DeviceRefused("relay", f"one of {known}", str(channel), "wire the channel in the configuration")


def _first_coil_inverted(state: RelayState) -> RelayState:
    first = min(state.coils)
    return replace(state, coils={**state.coils, first: not state.coils[first]})
