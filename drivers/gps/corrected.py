"""A receiver that is fed corrections from an NTRIP caster for as long as it is open."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from drivers.errors import DeviceFault
from drivers.gps.nmea import NmeaGps
from drivers.gps.ntrip import NtripClient, NtripSettings, NtripStatus
from drivers.gps.values import Fix


class CorrectedGps:
    """Implements ``drivers.gps.interface.Gps``. A caster out of reach costs accuracy, no fix; see ``ntrip``."""

    def __init__(self, receiver: NmeaGps, settings: NtripSettings, clock: Callable[[], float]) -> None:
        self.receiver = receiver
        self._client = NtripClient(settings, receiver.correct, lambda: receiver.last_gga, clock)
        self._life: asyncio.Task[None] | None = None

    @property
    def ntrip(self) -> NtripStatus:
        """How the corrections are doing."""
        return self._client.status

    async def open(self) -> None:
        await self.receiver.open()
        if self._life is None:
            self._life = asyncio.create_task(self._client.run(), name="ntrip client")

    async def close(self) -> None:
        life, self._life = self._life, None
        if life is not None:
            life.cancel()
            await asyncio.wait({life})
        await self.receiver.close()

    async def next_fix(self) -> Fix:
        """``DeviceFault`` when the task that fetches corrections has died, which it must not."""
        life = self._life
        if life is not None and life.done() and not life.cancelled() and (error := life.exception()) is not None:
            raise DeviceFault(
                "gps", "corrections to be fetched", f"that to have ended ({error!r})", "open the receiver again"
            ) from error
        return await self.receiver.next_fix()
