"""A GSM modem on the twin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from drivers.errors import DeviceFault
from drivers.modem.values import ModemStatus, Sms
from drivers.twin.bus import Bus
from drivers.twin.commands import ModemSend, ModemTake
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin

ROUND_TRIP_S = 0.02
SENDING_S = 2.5
TIMEOUT_S = 5.0
WRONG_DBM = -113.0


class MockModem:
    """Implements ``drivers.modem.interface.Modem``; ``clock`` gives loop time."""

    def __init__(self, twin: Twin, clock: Callable[[], float]) -> None:
        self._twin, self._clock = twin, clock
        self._bus = Bus(twin, clock, "modem", ROUND_TRIP_S, TIMEOUT_S)
        self._radio = Bus(twin, clock, "modem", SENDING_S, TIMEOUT_S)

    async def open(self) -> None:
        await self._bus.connect()
        await self._radio.connect()

    async def close(self) -> None:
        self._bus.disconnect()
        self._radio.disconnect()

    async def status(self) -> ModemStatus:
        status = await self._bus.exchange(lambda: self._twin.modem_status(self._clock()))
        return self._bus.seen(status, lambda wrong: replace(wrong, signal_dbm=WRONG_DBM))

    async def send(self, number: str, text: str) -> None:
        await self._radio.exchange(lambda: self._submit(number, text))

    async def receive(self) -> tuple[Sms, ...]:
        await self._bus.exchange(lambda: None)
        return self._take()  # only once the answer is here, so that a cancelled caller loses no text

    def _submit(self, number: str, text: str) -> None:
        if not self._twin.registered:
            raise DeviceFault("modem", "a network that takes the text", "no network", "check antenna, SIM and coverage")
        self._twin.apply(self._clock(), ModemSend(number, text))

    def _take(self) -> tuple[Sms, ...]:
        if self._bus.verb is Verb.STUCK:
            return ()
        texts = self._twin.texts(self._clock())
        if texts:
            self._twin.apply(self._clock(), ModemTake())
        return texts
