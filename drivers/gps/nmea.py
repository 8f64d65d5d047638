"""A GPS receiver that sends NMEA 0183 over a serial port."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from drivers.byte_trace import ByteTrace
from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceTimeout
from drivers.gps.epochs import Epoch, EpochAssembler
from drivers.gps.identify import identify
from drivers.gps.moments import EpochMoments
from drivers.gps.nmea_sentences import Sentence
from drivers.gps.sentence_reader import ReaderStatistics, SentenceReader
from drivers.gps.values import Fix
from drivers.line import Line, PortSettings
from drivers.serial_port import SerialPort

USER = "gps"
QUIET_S = 0.1  # silence that ends an epoch whose end is not known yet
LOOK_S = 0.25
TRUSTED_FOR = timedelta(days=365.25 * 20)


@dataclass(frozen=True, slots=True)
class NmeaSettings:
    """``output_delay_s``: from an epoch to the first bit of its sentences (of the receiver's make; 0.03 to 0.1).

    ``timeout_s``: silence that is an error. A time before ``earliest_utc`` or 20 years after it is not believed
    (receivers count weeks modulo 1024); the position is.
    """

    output_delay_s: float = 0.06
    timeout_s: float = 2.0
    earliest_utc: datetime = datetime(2026, 1, 1, tzinfo=UTC)


class NmeaGps:
    """Implements ``drivers.gps.interface.Gps``; ``clock`` gives loop time. The port is the driver's own.

    ``open`` only listens: ``DeviceMissing`` (silence), ``WrongDevice`` (no NMEA, no positions, another baud rate).
    """

    def __init__(
        self, settings: NmeaSettings, port: PortSettings, clock: Callable[[], float], trace: ByteTrace | None = None
    ) -> None:
        self.port = SerialPort(port, clock, on_bytes=self._hear, trace=trace)
        self._settings, self._clock = settings, clock
        self._loop: asyncio.AbstractEventLoop | None = None
        self._next: asyncio.Future[tuple[float, Epoch]] | None = None
        self._quiet: asyncio.TimerHandle | None = None
        self.heard_bytes = 0  # all that has been looked at, since the beginning
        self._begin()

    def _begin(self) -> None:
        """Nothing that was heard before belongs to what comes."""
        self._reader = SentenceReader(self.port.settings.byte_s)
        self._epochs = EpochAssembler(learn=True)
        self._moments = EpochMoments(self._settings.output_delay_s)

    @property
    def statistics(self) -> ReaderStatistics:
        """What was read since the port was opened last."""
        return self._reader.statistics

    async def open(self) -> None:
        self._loop = asyncio.get_running_loop()
        await self.port.attach(USER, self._greet)

    async def close(self) -> None:
        await self.port.detach(USER)
        if self._quiet is not None:
            self._quiet.cancel()
        if self._next is not None and not self._next.done():
            self._next.set_exception(DeviceLost(USER, "an open connection", "a closed one", "open the device first"))
            self._next.exception()
        self._next = None

    async def next_fix(self) -> Fix:
        stamp_s, epoch = await self._next_epoch()
        return self._fix(stamp_s, epoch)

    async def next_epoch(self) -> Epoch:
        """Like ``next_fix``, with all that the receiver said."""
        return (await self._next_epoch())[1]

    async def correct(self, rtcm: bytes) -> None:
        """Give corrections to the receiver. ``DeviceLost``, ``DeviceTimeout``."""
        await self.port.run(lambda line: line.write(rtcm))

    @property
    def last_gga(self) -> bytes:
        """The last GGA sentence with a position, without line end; b"" when there was none."""
        return self._reader.last_gga

    # --- waiting

    async def _next_epoch(self) -> tuple[float, Epoch]:
        await self._require_port()
        before = self._counts()
        deadline_s = self._clock() + self._settings.timeout_s
        while (left_s := deadline_s - self._clock()) > 0.0:
            if self._next is None or self._next.done():
                self._next = asyncio.get_running_loop().create_future()
            waited = self._next
            await asyncio.wait({waited}, timeout=min(left_s, LOOK_S))
            if waited.done():
                return waited.result()
            await self._require_port()
        raise self._nothing_came(before)

    async def _require_port(self) -> None:
        if not self.port.connected:
            await self.port.run(_nothing)  # raises what is to be said about it

    def _counts(self) -> tuple[int, int]:
        return self.port.statistics.bytes_in, self.statistics.sentences

    def _nothing_came(self, before: tuple[int, int]) -> DeviceError:
        count, sentences = (now - then for now, then in zip(self._counts(), before, strict=True))
        within = f"within {self._settings.timeout_s:g} s"
        if count <= 0:
            return DeviceTimeout(USER, f"sentences {within}", "silence", "check the receiver's power and its cable")
        if sentences <= 0:
            return DeviceFault(
                USER, f"valid sentences {within}", f"{count} bytes of garbled ones",
                "check the cable, its shield and the baud rate",
            )  # fmt: skip
        kinds = " ".join(sorted(self.statistics.kinds))
        return DeviceFault(USER, f"GGA or RMC {within}", f"other sentences only ({kinds})", "switch GGA and RMC on")

    # --- the owner's thread

    def _greet(self, line: Line) -> None:
        self._begin()
        identify(line, self._hear)

    def _hear(self, data: bytes) -> None:
        sentences = self._reader.feed(data, self._clock())
        loop = self._loop
        if sentences and loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self._take, self._epochs, sentences)
        self.heard_bytes += len(data)

    # --- the event loop

    def _take(self, epochs: EpochAssembler, sentences: list[tuple[float, Sentence]]) -> None:
        if epochs is not self._epochs:  # from before the connection was lost
            return
        for began_s, sentence in sentences:
            self._tell(epochs.add(sentence, began_s))
        if self._quiet is not None:
            self._quiet.cancel()
        self._quiet = asyncio.get_running_loop().call_later(QUIET_S, self._fall_quiet, epochs)

    def _fall_quiet(self, epochs: EpochAssembler) -> None:
        self._tell(epochs.quiet())

    def _tell(self, epochs: list[Epoch]) -> None:
        for epoch in epochs:
            stamp_s = self._moments.moment_s(epoch.began_s, epoch.day_s)
            if epoch.whole and self._next is not None and not self._next.done():
                self._next.set_result((stamp_s, epoch))

    def _fix(self, stamp_s: float, epoch: Epoch) -> Fix:
        earliest = self._settings.earliest_utc
        believed = epoch.utc is not None and earliest <= epoch.utc < earliest + TRUSTED_FOR
        return Fix(
            stamp_s=stamp_s,
            utc=epoch.utc if believed else None,
            quality=epoch.quality,
            latitude_deg=epoch.latitude_deg,
            longitude_deg=epoch.longitude_deg,
            altitude_m=epoch.altitude_m,
            accuracy_m=epoch.accuracy_m,
            satellites=epoch.satellites or 0,
            hdop=epoch.hdop,
            speed_m_s=epoch.speed_m_s,
            course_rad=_radians(epoch.course_deg),
            heading_rad=_radians(epoch.heading_deg),
        )


def _nothing(line: Line) -> None:
    """A job that only asks whether the device is there."""


def _radians(degrees: float | None) -> float | None:
    return None if degrees is None else math.radians(degrees) % math.tau
