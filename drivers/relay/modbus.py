"""A relay board on a Modbus bus, driven by its profile."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceMissing, DeviceRefused, DeviceTimeout
from drivers.modbus_master import ModbusLine, ModbusMaster, ModbusRefusal
from drivers.modbus_probe import TRIES, prove
from drivers.relay.board import Board
from drivers.relay.held_pulses import HeldPulses
from drivers.relay.modbus_settings import RelaySettings
from drivers.relay.profiles import profile_named
from drivers.relay.values import BoardCapability, Channel, PulseReceipt, RelayState, refusal_for_automatic
from drivers.stop_lane import StopLane

__all__ = ["ModbusRelay", "RelaySettings"]

T = TypeVar("T")

HOST_QUANTUM_S = 0.001

_PULSED_ONLY = frozenset({Channel.VALVE, Channel.PUMP})
_FIRST_OFF = (Channel.VALVE, Channel.PUMP)


class ModbusRelay:
    """Implements ``drivers.relay.interface.RelayBoard``; ``clock`` gives loop time.

    Closing goes through the bus's STOP lane and is tried three times, reading is tried three times, opening once. The
    board proves what it is before any other frame, at opening and after each reconnection; then everything is off.
    """

    def __init__(self, settings: RelaySettings, bus: ModbusMaster, clock: Callable[[], float]) -> None:
        self._settings, self._bus, self._clock = settings, bus, clock
        self._profile = profile_named(settings.profile)
        self._held = HeldPulses(bus, clock, self._board, self._note)
        self._greeted: ModbusLine | None = None
        self._is_open = False
        self._trouble: DeviceError | None = None
        self._shuts = 0  # how often something was to be shut
        self.stop_lane = StopLane("relay", self.post_all_off, self._force_all_off)
        first = [channel for channel in _FIRST_OFF if channel in settings.channels]
        self._numbers = {channel: settings.channels[channel] for channel in (*first, *sorted(settings.channels))}

    @property
    def capability(self) -> BoardCapability:
        watchdog_s = self._watchdog_s
        longest_s = self._settings.longest_pulse_s
        if self._profile.pulse is not None:
            quantum_s = self._profile.pulse.quantum_s
            return BoardCapability(quantum_s, math.floor(longest_s / quantum_s + 1e-9) * quantum_s, watchdog_s)
        if watchdog_s is not None:
            return BoardCapability(HOST_QUANTUM_S, longest_s, watchdog_s, host_timed=True)
        return BoardCapability(HOST_QUANTUM_S, 0.0, None)

    @property
    def channels(self) -> frozenset[Channel]:
        return frozenset(self._numbers)

    async def open(self) -> None:
        self._is_open = False
        self._trouble = None
        await self._bus.attach("relay", self._on_connection)
        self._is_open = True

    async def close(self) -> None:
        if not self._is_open:
            return
        try:
            await self.all_off()
        finally:
            self._is_open = False
            self._greeted = None
            await self._bus.detach("relay")

    async def switch(self, channel: Channel, on: bool) -> None:
        number = self._wired(channel)
        if not on:
            await self.cancel(channel)
            return
        if channel in _PULSED_ONLY:
            raise DeviceRefused("relay", f"a pulse for {channel}", "a switching on for good", "use pulse()")

        def job(line: ModbusLine) -> None:
            board = self._greeted_board(line)
            self._held.drop(number)
            if self._watchdog_s is not None:
                self._held.stays_on(number, self._watchdog_s)
            board.on(number)

        self._raise_trouble()
        await self._open_unless_shut(job)

    async def pulse(self, channel: Channel, duration_s: float) -> PulseReceipt:
        number = self._wired(channel)
        capability = self.capability
        if capability.pulse_max_s <= 0.0:
            raise DeviceRefused(
                "relay", "a board that can end a pulse without the host", f"a {self._profile.title}",
                refusal_for_automatic(capability) or "use another board",
            )  # fmt: skip
        if not 0.0 < duration_s <= capability.pulse_max_s + 1e-9:
            raise DeviceRefused(
                "relay", f"a pulse above 0 s, to {capability.pulse_max_s:g} s", f"{duration_s:g} s",
                "ask for a shorter pulse",
            )  # fmt: skip
        quanta = math.ceil(duration_s / capability.pulse_quantum_s - 1e-9)
        self._raise_trouble()
        start = self._start_watched if capability.host_timed else self._start_timed
        sent_s, accepted_s = await self._open_unless_shut(lambda line: start(line, number, quanta))
        return PulseReceipt(channel, sent_s, accepted_s, quanta * capability.pulse_quantum_s)

    async def cancel(self, channel: Channel) -> None:
        number = self._wired(channel)
        self._shuts += 1
        await self._bus.stop(lambda line: self._shut(line, number))

    async def all_off(self) -> None:
        self._require_open()
        self._shuts += 1
        await self._bus.stop(self._shut_all)

    def post_all_off(self) -> Future[None]:
        """Like ``all_off``, from any thread and without waiting."""
        self._shuts += 1
        return self._bus.post_stop(self._shut_all)

    def _force_all_off(self) -> None:
        """Beside an owner that hangs; what it does when it goes on is none of this."""
        numbers = tuple(self._numbers.values())
        self._bus.write_beside(
            self._settings.unit_id, [write.request() for write in self._profile.all_off(numbers)]
        )

    async def read(self) -> RelayState:
        self._require_open()
        self._raise_trouble()
        for _ in range(TRIES - 1):
            try:
                return await self._bus.run(self._read_once)
            except ModbusRefusal:
                raise
            except (DeviceTimeout, DeviceFault):
                continue
        return await self._bus.run(self._read_once)

    async def _open_unless_shut(self, job: Callable[[ModbusLine], T]) -> T:
        """Run a job that opens; it does nothing when its caller is gone, or something was shut since, by its turn."""
        self.stop_lane.require_released()
        shuts = self._shuts
        wanted = True

        def opening(line: ModbusLine) -> T:
            if not wanted or shuts != self._shuts:
                raise DeviceRefused(
                    "relay",
                    "an opening that is still wanted",
                    "a stop since it was asked for",
                    "ask again after the stop",
                )
            return job(line)

        try:
            return await self._bus.run(opening)
        except asyncio.CancelledError:
            wanted = False
            raise

    # --- in the owner's thread

    def _shut(self, line: ModbusLine, number: int) -> None:
        self._held.drop(number)
        board = self._greeted_board(line)
        try:
            board.cancel(number)
        except DeviceError:
            self._shut_later((number,))
            raise

    def _shut_all(self, line: ModbusLine) -> None:
        self._held.drop_all()
        board = self._greeted_board(line)
        try:
            board.all_off(tuple(self._numbers.values()))
        except DeviceError:
            self._shut_later(tuple(self._numbers.values()))
            raise

    def _shut_later(self, numbers: tuple[int, ...]) -> None:
        """A board that times nothing by itself is told to shut again and again, or left to its watchdog."""
        if self._watchdog_s is not None:
            for number in numbers:
                self._held.watched(number, self._clock(), self._watchdog_s)

    def _read_once(self, line: ModbusLine) -> RelayState:
        board = self._greeted_board(line)
        self._held.require_no_vigil()
        stamp_s = self._clock()
        contacts = board.read()
        return RelayState(stamp_s, {channel: contacts[number - 1] for channel, number in self._numbers.items()})

    def _start_timed(self, line: ModbusLine, number: int, quanta: int) -> tuple[float, float]:
        timer = self._profile.pulse
        assert timer is not None
        lease_quanta = min(timer.most, math.floor(self._settings.lease_s / timer.quantum_s + 1e-9))
        first = min(quanta, lease_quanta)
        board = self._greeted_board(line)
        self._held.drop(number)
        sent_s = self._clock()
        board.pulse(number, first)
        accepted_s = self._clock()
        if first < quanta:
            self._held.lease(number, timer.quantum_s, first, sent_s, sent_s + quanta * timer.quantum_s)
        return sent_s, accepted_s

    def _start_watched(self, line: ModbusLine, number: int, quanta: int) -> tuple[float, float]:
        assert self._watchdog_s is not None
        board = self._greeted_board(line)
        self._held.drop(number)
        sent_s = self._clock()
        try:
            board.on(number)
        except DeviceError:
            self._held.watched(number, sent_s, self._watchdog_s)  # it may be on: off at once, and again until it is
            raise
        self._held.watched(number, sent_s + quanta * HOST_QUANTUM_S, self._watchdog_s)
        return sent_s, self._clock()

    def _on_connection(self, line: ModbusLine) -> None:
        """The greeting. While the relay is open others use the line too: the next call greets again, and says why it
        cannot.
        """
        self._greeted = None
        try:
            self._greet(line)
        except DeviceError:
            if not self._is_open:
                raise

    def _greeted_board(self, line: ModbusLine) -> Board:
        """The board on this line, once it has proved what it is on it."""
        if line is not self._greeted:
            try:
                self._greet(line)
            except DeviceMissing as error:  # the port is there, and the board was
                raise DeviceTimeout(error.device, error.expected, error.found, error.remedy) from error
        return self._board(line)

    def _greet(self, line: ModbusLine) -> None:
        self._held.drop_all()
        settings, profile = self._settings, self._profile
        prove(line, "relay", settings.unit_id, profile.title, profile.probes, settings.reply_timeout_s)
        board = self._board(line)
        board.all_off(range(1, profile.channels + 1))
        if profile.power_on is not None:
            board.stay_off_at_power_on(profile.power_on)
        if profile.watchdog is not None and self._watchdog_s is not None:
            board.arm(profile.watchdog, self._watchdog_s)
        self._require_all_off(board)
        self._greeted = line

    def _require_all_off(self, board: Board) -> None:
        for attempt in range(TRIES):
            try:
                contacts = board.read()
                break
            except (DeviceTimeout, DeviceFault):
                if attempt == TRIES - 1:
                    raise
        names = {number: str(channel) for channel, number in self._numbers.items()}
        closed = [names.get(number, f"channel {number}") for number, on in enumerate(contacts, start=1) if on]
        if closed:
            raise DeviceFault(
                "relay", "all coils off", f"{', '.join(closed)} on", "cut the board's power and change the relay"
            )

    def _board(self, line: ModbusLine) -> Board:
        return Board(line.unit("relay", self._settings.unit_id, self._settings.reply_timeout_s), self._profile)

    def _note(self, error: DeviceError) -> None:
        self._trouble = self._trouble or error

    # ---

    @property
    def _watchdog_s(self) -> float | None:
        """The time that the watchdog is armed with: what was asked for, up to the next step."""
        if (watchdog := self._profile.watchdog) is None:
            return None
        return min(watchdog.most, math.ceil(self._settings.watchdog_s / watchdog.unit_s - 1e-9)) * watchdog.unit_s

    def _raise_trouble(self) -> None:
        """What went wrong while nobody asked."""
        if (trouble := self._trouble) is not None:
            self._trouble = None
            raise trouble

    def _wired(self, channel: Channel) -> int:
        self._require_open()
        if channel not in self._numbers:
            known = ", ".join(sorted(self._numbers))
            raise DeviceRefused("relay", f"one of {known}", str(channel), "wire the channel in the configuration")
        return self._numbers[channel]

    def _require_open(self) -> None:
        if not self._is_open:
            raise DeviceLost("relay", "an open connection", "a closed one", "open the device first")
