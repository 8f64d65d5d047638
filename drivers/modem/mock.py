"""A GSM modem on the twin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from drivers.errors import DeviceFault
from drivers.modem.values import DeliveryReport, ModemStatus, RejectedText, Sms
from drivers.twin.bus import Bus
from drivers.twin.commands import ModemSend, ModemTake
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin
from drivers.twin.network import DELIVERY_S

ROUND_TRIP_S = 0.02
SENDING_S = 2.5
TIMEOUT_S = 5.0
WRONG_DBM = -113.0


class MockModem:
    """Implements ``drivers.modem.interface.Modem``; ``clock`` gives loop time."""

    def __init__(self, twin: Twin, clock: Callable[[], float], delivery_reports: bool = False) -> None:
        self._asks_for_reports = delivery_reports
        self._under_way: list[DeliveryReport] = []
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

    def reports(self) -> tuple[DeliveryReport, ...]:
        due = tuple(report for report in self._under_way if report.stamp_s <= self._clock())
        self._under_way = self._under_way[len(due) :]
        return due

    def rejected(self) -> tuple[RejectedText, ...]:
        """The twin's network brings texts alone."""
        return ()

    def _submit(self, number: str, text: str) -> None:
        if not self._twin.registered:
            raise DeviceFault("modem", "a network that takes the text", "no network", "check antenna, SIM and coverage")
        self._twin.apply(self._clock(), ModemSend(number, text))
        if self._asks_for_reports:
            self._under_way.append(DeliveryReport(number, text, True, self._clock() + DELIVERY_S))

    def _take(self) -> tuple[Sms, ...]:
        if self._bus.verb is Verb.STUCK:
            return ()
        texts = self._twin.texts(self._clock())
        if texts:
            self._twin.apply(self._clock(), ModemTake())
        return texts
