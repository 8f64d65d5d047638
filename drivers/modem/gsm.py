"""A GSM modem on its AT port: texts in PDU mode, registration, signal."""

from __future__ import annotations

import asyncio
import secrets
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import TypeVar

from drivers.byte_trace import ByteTrace
from drivers.errors import DeviceError, DeviceLost
from drivers.line import Line, PortSettings
from drivers.modem.at_channel import DEVICE, AtChannel
from drivers.modem.at_parser import Notice
from drivers.modem.concatenation import split
from drivers.modem.delivery import Delivery
from drivers.modem.gsm_dialogue import GsmDialogue, not_taken, refused_text
from drivers.modem.gsm_settings import GsmSettings
from drivers.modem.inbox import Inbox, Stored
from drivers.modem.pdu import Submit, encode_submit
from drivers.modem.restart_ladder import RestartLadder, Rung
from drivers.modem.sim_lock import SimMemory
from drivers.modem.user_data import Part
from drivers.modem.values import DeliveryReport, ModemStatus, RejectedText, Sms
from drivers.serial_port import SerialPort

T = TypeVar("T")

STATUS_HOLDS_S = 90.0  # how old a status may be that is given while the network takes a text
MOST_NOTICES = 256
_RESTARTED = frozenset({"RDY", "+CFUN", "NORMAL POWER DOWN"})
_NEW_TEXT = frozenset({"+CMTI", "SMS Ready"})
_REGISTRATION = frozenset({"+CREG", "+CGREG", "+CEREG"})


class GsmModem:
    """Implements ``drivers.modem.interface.Modem``. ``channel.overhear`` is the port's ``on_bytes``.

    ``power_cycle`` switches the modem's supply off and on, where that can be done. A text is deleted from the store
    only when ``receive`` has handed it over; after a crash in between it comes once more.
    """

    def __init__(
        self,
        settings: GsmSettings,
        port: SerialPort,
        channel: AtChannel,
        clock: Callable[[], float],
        power_cycle: Callable[[], Awaitable[None]] | None = None,
    ) -> None:
        self._settings, self._port, self._channel, self._clock = settings, port, channel, clock
        self._power_cycle = power_cycle
        self._sim = SimMemory()
        self._inbox = Inbox(settings.parts_keep_s)
        self._delivery = Delivery()
        self._ladder = RestartLadder()
        self._capacity: int | None = None
        self._is_set_up = False
        self._echoes = False
        self._status: ModemStatus | None = None
        self._notices: deque[Notice] = deque(maxlen=MOST_NOTICES)
        self._wake = asyncio.Event()
        self._turn = asyncio.Lock()
        self._keeper: asyncio.Task[None] | None = None
        self._sendings: set[asyncio.Task[None]] = set()
        self.model = ""
        self.trouble: DeviceError | None = None

    @classmethod
    def on_port(
        cls,
        settings: GsmSettings,
        port: PortSettings,
        clock: Callable[[], float],
        power_cycle: Callable[[], Awaitable[None]] | None = None,
        trace: ByteTrace | None = None,
    ) -> GsmModem:
        """With a port of its own."""
        channel = AtChannel()
        return cls(
            settings, SerialPort(port, clock, on_bytes=channel.overhear, trace=trace), channel, clock, power_cycle
        )

    @property
    def port(self) -> SerialPort:
        return self._port

    # --- the contract

    async def open(self) -> None:
        """``DeviceMissing``, ``WrongDevice``, or ``DeviceFault`` for a SIM that is locked, within 3 s."""
        if self._keeper is not None:
            return
        loop = asyncio.get_running_loop()
        self._channel.give_up(False)
        self._channel.on_notice = lambda notice: _tell(loop, self._on_notice, notice)
        await self._port.attach(DEVICE, self._greet)
        self._keeper = loop.create_task(self._keep(), name="modem keeper")

    async def close(self) -> None:
        keeper, self._keeper = self._keeper, None
        tasks = [*([keeper] if keeper else []), *self._sendings]
        for task in tasks:
            task.cancel()
        self._channel.give_up()
        if tasks:
            await asyncio.wait(tasks)
        await self._port.detach(DEVICE)
        self._channel.on_notice = None

    async def status(self) -> ModemStatus:
        """Of now; while the network takes a text, the latest before that, with its own stamp."""
        self._require_keeper()
        known = self._status
        if self._sendings and known is not None and self._clock() - known.stamp_s <= STATUS_HOLDS_S:
            return known
        return await self._look()

    async def send(self, number: str, text: str) -> None:
        """``DeviceRefused`` for a text or number that cannot be sent; ``DeviceTimeout``: it may have been sent.

        A text that has begun to be sent is sent to its end even when the caller is cancelled.
        """
        self._require_keeper()
        try:
            parts = _parts(number, text, self._settings)
        except ValueError as why:
            refused_text(why)
        sending = asyncio.get_running_loop().create_task(self._send(number, text, parts), name="modem sending")
        self._sendings.add(sending)
        sending.add_done_callback(self._sent)
        await asyncio.shield(sending)

    async def receive(self) -> tuple[Sms, ...]:
        self._require_keeper()
        try:
            await self._collect()
        except DeviceError:
            if not self._inbox.has_ready:
                raise
        texts = self._inbox.take()
        if texts:
            self._wake.set()  # they may leave the store
        return texts

    def reports(self) -> tuple[DeliveryReport, ...]:
        """What became of sent texts, since the last call; only with ``delivery_reports``."""
        return self._delivery.take()

    def rejected(self) -> tuple[RejectedText, ...]:
        """What came in since the last call and is no text: broken, for machines, too long, or never whole."""
        return self._inbox.take_rejected()

    # --- in the background

    async def _keep(self) -> None:
        while True:
            self._wake.clear()
            await self._tend()
            with suppress(TimeoutError):
                async with asyncio.timeout(self._settings.poll_s):
                    await self._wake.wait()

    async def _tend(self) -> None:
        """Settings after a restart, state, store; and the ladder when that does not go."""
        healthy = False
        try:
            if not self._is_set_up:
                await self._port.run(self._greet)
            status = await self._look()
            await self._collect()
            healthy = status.registered
            self.trouble = None
        except DeviceError as error:
            self.trouble = error
        rung = self._ladder.due(self._clock(), healthy)
        if rung is not None:
            await self._climb(rung)

    async def _climb(self, rung: Rung) -> None:
        try:
            if rung is Rung.RESET:
                await self._port.run(lambda line: self._dialogue(line).restart())
            elif rung is Rung.POWER and self._power_cycle is not None:
                await self._power_cycle()
        except DeviceError as error:
            self.trouble = error
        self._is_set_up = False

    def _on_notice(self, notice: Notice) -> None:
        if notice.name in _RESTARTED:
            self._is_set_up = False
        elif notice.name == "+CMT" and notice.body is not None:
            self._inbox.add_direct(notice.body, self._clock())
        elif notice.name == "+CDS" and notice.body is not None:
            self._delivery.report(notice.body, self._clock())
        elif notice.name in _NEW_TEXT or notice.name in _REGISTRATION:
            self._wake.set()

    def _require_keeper(self) -> None:
        """A background task that has failed is told to whoever asks next."""
        if self._keeper is None:
            raise DeviceLost(DEVICE, "an open connection", "a closed one", "open the device first")
        if self._keeper.done():
            self._keeper.result()

    # --- jobs

    def _dialogue(self, line: Line) -> GsmDialogue:
        return GsmDialogue(line, self._channel, self._settings, self._sim, self._clock)

    def _greet(self, line: Line) -> None:
        """In the owner's thread, at every opening and after a restart of the modem."""
        dialogue = self._dialogue(line)
        self.model = dialogue.identify()
        self._echoes = self._channel.echo_seen
        self._capacity = dialogue.set_up()
        self._is_set_up = self._capacity is not None

    async def _look(self) -> ModemStatus:
        status = await self._port.run(lambda line: self._dialogue(line).status())
        self._status = status
        if self._channel.echo_seen and not self._echoes:  # its settings are gone: it has restarted
            self._is_set_up = False
        return status

    async def _collect(self) -> None:
        async with self._turn:
            reading = asyncio.ensure_future(self._read_store())
            reading.add_done_callback(_retrieve)
            await asyncio.shield(reading)

    async def _read_store(self) -> None:
        deletable = self._inbox.deletable

        def job(line: Line) -> tuple[tuple[Stored, ...], DeviceError | None]:
            return self._dialogue(line).tidy(deletable)

        stored, trouble = await self._port.run(job)
        self._inbox.update(stored, self._capacity, self._clock())
        if trouble is not None:
            self.trouble = trouble
        elif self._inbox.deletable:
            self._wake.set()

    async def _send(self, number: str, text: str, parts: tuple[tuple[str, int], ...]) -> None:
        expected = self._delivery.expect(number, text, len(parts)) if self._settings.delivery_reports else None
        for pdu, octets in parts:

            def job(line: Line, pdu: str = pdu, octets: int = octets) -> int:
                dialogue = self._dialogue(line)
                status = dialogue.status()
                self._status = status
                if not status.registered:
                    raise not_taken("no network: the modem is not registered")
                return dialogue.send(pdu, octets)

            reference = await self._port.run(job)
            if expected is not None:
                self._delivery.sent(expected, reference, self._clock())

    def _sent(self, sending: asyncio.Task[None]) -> None:
        self._sendings.discard(sending)
        _retrieve(sending)


def _parts(number: str, text: str, settings: GsmSettings) -> tuple[tuple[str, int], ...]:
    """The PDUs of a text and the octets that each is announced with. ``ValueError`` for what cannot be sent."""
    if not number.removeprefix("+").isdigit():
        raise ValueError(f"expected a number of digits, found {number!r}")
    alphabet, pieces = split(text)
    reference = secrets.randbelow(256)
    return tuple(
        encode_submit(
            Submit(
                number,
                piece,
                alphabet,
                Part(reference, len(pieces), place) if len(pieces) > 1 else None,
                settings.smsc,
                report=settings.delivery_reports,
            )
        )
        for place, piece in enumerate(pieces, start=1)
    )


def _retrieve(task: asyncio.Task[None]) -> None:
    """A caller that was cancelled does not ask for the outcome any more."""
    if not task.cancelled():
        task.exception()


def _tell(loop: asyncio.AbstractEventLoop, hear: Callable[[Notice], None], notice: Notice) -> None:
    with suppress(RuntimeError):  # a loop that has ended hears nothing any more
        loop.call_soon_threadsafe(hear, notice)
