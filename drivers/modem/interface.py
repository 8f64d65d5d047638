"""The contract of a GSM modem."""

from __future__ import annotations

from typing import Protocol

from drivers.modem.values import DeliveryReport, ModemStatus, RejectedText, Sms


class Modem(Protocol):
    """Text messages and signal. Every method raises a ``DeviceError``; every wait ends in ``DeviceTimeout``."""

    async def open(self) -> None: ...

    async def close(self) -> None: ...

    async def status(self) -> ModemStatus: ...

    async def send(self, number: str, text: str) -> None:
        """Returns when the network has taken the text; ``DeviceFault`` when it has not."""
        ...

    async def receive(self) -> tuple[Sms, ...]:
        """Texts that came since the last call, oldest first, taken off the modem's store; () when there are none."""
        ...

    def reports(self) -> tuple[DeliveryReport, ...]:
        """What became of sent texts, since the last call; () from a back end that is not told to ask the network."""
        ...

    def rejected(self) -> tuple[RejectedText, ...]:
        """What came in since the last call and is no text: broken, for machines, too long, or never whole."""
        ...
