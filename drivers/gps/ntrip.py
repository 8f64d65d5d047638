"""A client of an NTRIP caster: corrections for RTK over the internet, for as long as it runs."""

from __future__ import annotations

import asyncio
import random
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import aclosing, suppress
from dataclasses import dataclass, replace

from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceMissing, DeviceTimeout
from drivers.gps.ntrip_talk import (
    DEVICE,
    LINE_BYTES,
    NotUnderstood,
    NtripSettings,
    body,
    check,
    ended,
    read_answer,
    request,
)
from drivers.gps.rtcm import RtcmFramer, RtcmStatistics

FIRST_PAUSE_S = 1.0
LONGEST_PAUSE_S = 60.0
CONNECT_S = 10.0

__all__ = ["NtripClient", "NtripSettings", "NtripStatus"]


@dataclass(frozen=True, slots=True)
class NtripStatus:
    """``connected`` is True while frames flow. ``error`` is the last one, "" when there was none since.

    ``last_frame_s`` is in the clock's time; ``undelivered`` frames found no receiver.
    """

    connected: bool = False
    version: int = 2
    connections: int = 0
    frames: int = 0
    undelivered: int = 0
    last_frame_s: float | None = None
    error: str = ""


class NtripClient:
    """``feed`` takes frames of RTCM 3 to the receiver, only whole ones whose checksum is right; ``position`` gives the
    receiver's last GGA sentence (b"" for none). ``clock`` gives loop time.
    """

    def __init__(
        self,
        settings: NtripSettings,
        feed: Callable[[bytes], Awaitable[None]],
        position: Callable[[], bytes],
        clock: Callable[[], float],
    ) -> None:
        self._settings, self._feed, self._position, self._clock = settings, feed, position, clock
        self._framer = RtcmFramer()
        self._dice = random.Random()
        self.status = NtripStatus()

    @property
    def rtcm(self) -> RtcmStatistics:
        """What came in this connection."""
        return self._framer.statistics

    async def run(self) -> None:
        """Connect, and connect anew with growing pauses (1 to 60 s, with jitter). Ends by cancellation only."""
        pause_s = FIRST_PAUSE_S
        while True:
            before = self.status.frames
            try:
                await self._connection()
            except NotUnderstood:
                other = 1 if self.status.version == 2 else 2
                self.status = replace(self.status, version=other, error="the caster hung up without an answer")
                if other == 1:
                    continue
            except DeviceError as error:
                self.status = replace(self.status, error=str(error))
            finally:
                self.status = replace(self.status, connected=False)
            if self.status.frames > before:
                pause_s = FIRST_PAUSE_S
            await asyncio.sleep(pause_s * self._dice.uniform(0.5, 1.0))
            pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)

    async def _connection(self) -> None:
        reader, writer = await self._connect()
        reporting: asyncio.Task[None] | None = None
        try:
            async with asyncio.timeout(CONNECT_S):
                writer.write(request(self._settings, self.status.version, self._position()))
                await writer.drain()
                answer = await read_answer(reader)
                await check(self._settings, answer, reader)
            self.status = replace(self.status, connections=self.status.connections + 1)
            reporting = asyncio.create_task(self._report(writer))
            async with aclosing(body(reader, answer)) as stream:
                await self._pass_on(stream)
        except TimeoutError:
            raise DeviceTimeout(
                DEVICE, f"an answer of {self._settings.place} within {CONNECT_S:g} s", "silence",
                "check the modem's data connection; it is tried again",
            ) from None  # fmt: skip
        except OSError as error:
            raise DeviceLost(
                DEVICE, f"a connection to {self._settings.place}", str(error.strerror or error), "it is connected anew"
            ) from error
        finally:
            if reporting is not None:
                reporting.cancel()
                with suppress(asyncio.CancelledError, OSError):  # a lost connection has been seen by the reader
                    await reporting
            writer.transport.abort()

    async def _connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        settings = self._settings
        remedy = "check its name, its port and the modem's data connection; it is tried again"
        try:
            context = ssl.create_default_context(cafile=settings.tls_ca_file) if settings.tls else None
            async with asyncio.timeout(CONNECT_S):
                return await asyncio.open_connection(settings.host, settings.port, ssl=context, limit=LINE_BYTES)
        except TimeoutError:
            raise DeviceTimeout(DEVICE, f"a caster at {settings.host}:{settings.port}", "silence", remedy) from None
        except ssl.SSLError as error:
            raise DeviceFault(
                DEVICE, f"a trusted certificate of {settings.host}", str(getattr(error, "verify_message", error)),
                "correct the host's name or tls_ca_file, or the caster's port is one without TLS",
            ) from error  # fmt: skip
        except OSError as error:
            found = error.strerror or str(error)
            raise DeviceMissing(DEVICE, f"a caster at {settings.host}:{settings.port}", found, remedy) from error

    async def _pass_on(self, stream: AsyncIterator[bytes]) -> None:
        """Frames to the receiver until none come any more."""
        self._framer = RtcmFramer()
        deadline_s = self._clock() + self._settings.timeout_s
        while True:
            try:
                async with asyncio.timeout(deadline_s - self._clock()):
                    data = await anext(stream)
            except StopAsyncIteration:
                raise ended(self._settings) from None
            except TimeoutError:
                raise self._silent() from None
            frames = self._framer.feed(data)
            if frames:
                deadline_s = self._clock() + self._settings.timeout_s
                await self._deliver(frames)

    async def _deliver(self, frames: list[bytes]) -> None:
        undelivered, error = 0, ""
        try:
            await self._feed(b"".join(frames))
        except DeviceError as lost:  # the receiver's own driver says so too; corrections wait for it to come back
            undelivered, error = len(frames), str(lost)
        self.status = replace(
            self.status,
            connected=True,
            frames=self.status.frames + len(frames),
            undelivered=self.status.undelivered + undelivered,
            last_frame_s=self._clock(),
            error=error,
        )

    def _silent(self) -> DeviceError:
        settings, statistics = self._settings, self.rtcm
        within = f"corrections of {settings.place} within {settings.timeout_s:g} s"
        if statistics.bytes == 0:
            remedy = "it is connected anew; a virtual station speaks only once the receiver has a position"
            return DeviceTimeout(DEVICE, within, "silence", remedy)
        found = f"{statistics.stray_bytes} bytes that are not RTCM 3"
        return DeviceFault(DEVICE, within, found, "choose a mountpoint with RTCM 3; it is connected anew")

    async def _report(self, writer: asyncio.StreamWriter) -> None:
        """Say where we are, now and then."""
        while self._settings.gga_every_s > 0.0:
            if gga := self._position():
                writer.write(gga + b"\r\n")
                await writer.drain()
                await asyncio.sleep(self._settings.gga_every_s)
            else:
                await asyncio.sleep(min(1.0, self._settings.gga_every_s))
