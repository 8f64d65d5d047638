"""Pulses that the host keeps up: by renewed short pulses of the board's timer, or under the board's watchdog.

A lease: the board is never told to stay on for longer than ``lease_s``; the host renews while the pulse lasts and ends
it to the moment. When the host dies, the coil opens within one lease. Under a watchdog the host switches on and off and
gives signs of life; when it dies, the coil opens within the watchdog's time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.errors import DeviceError, DeviceFault
from drivers.modbus_master import ModbusLine, ModbusMaster
from drivers.relay.board import Board
from drivers.serial_port import Timer

RENEW_SHARE = 0.5  # of a lease, between renewals
MARGIN_S = 0.03  # so long before the board's own end a renewal may still be under way
AGAIN_S = 0.05  # between two tries to switch off
BEATS = 3  # signs of life in the watchdog's time


@dataclass(slots=True)
class _Held:
    number: int
    end_s: float
    lapses_s: float = math.inf  # when the board's own timer opens the coil
    watchdog_s: float | None = None  # of a board without timers
    timers: list[Timer] = field(default_factory=list)
    error: DeviceError | None = None


class HeldPulses:
    """Belongs to the owner thread of ``bus``. ``board`` is the board on a line, ``tell`` hears of pulses cut short."""

    def __init__(
        self,
        bus: ModbusMaster,
        clock: Callable[[], float],
        board: Callable[[ModbusLine], Board],
        tell: Callable[[DeviceError], None],
    ) -> None:
        self._bus, self._clock, self._board, self._tell = bus, clock, board, tell
        self._held: dict[int, _Held] = {}
        self._on: set[int] = set()
        self._beat: Timer | None = None
        self._alive_s = 0.0  # when the board was last known to hear
        self._abandoned: dict[int, DeviceError] = {}

    def lease(self, number: int, quantum_s: float, lease_quanta: int, sent_s: float, end_s: float) -> None:
        """A first pulse of ``lease_quanta`` was sent at ``sent_s``; keep it up until ``end_s``."""
        held = _Held(number, end_s, sent_s + lease_quanta * quantum_s)
        self._held[number] = held
        self._renew_at(held, sent_s + RENEW_SHARE * lease_quanta * quantum_s, quantum_s, lease_quanta)
        held.timers.append(self._bus.at(end_s, lambda line: self._end(held, line)))

    def watched(self, number: int, end_s: float, watchdog_s: float) -> None:
        """The coil was switched on; switch it off at ``end_s`` and keep the watchdog quiet until then."""
        held = _Held(number, end_s, watchdog_s=watchdog_s)
        self._held[number] = held
        held.timers.append(self._bus.at(end_s, lambda line: self._end(held, line)))
        self._keep_alive(watchdog_s)

    def stays_on(self, number: int, watchdog_s: float) -> None:
        """The coil is on until further notice: keep the watchdog quiet."""
        self._on.add(number)
        self._keep_alive(watchdog_s)

    def drop(self, number: int) -> None:
        """The channel has got another command."""
        self._on.discard(number)
        self._abandoned.pop(number, None)
        if (held := self._held.pop(number, None)) is not None:
            for timer in held.timers:
                timer.cancelled = True
        if not self._held and not self._on and self._beat is not None:
            self._beat.cancelled = True
            self._beat = None

    def drop_all(self) -> None:
        for number in (*self._held, *self._on):
            self.drop(number)

    def require_no_vigil(self) -> None:
        """Raises while a coil that would not go off is left to the watchdog, which only silence sets off."""
        for error in self._abandoned.values():
            raise error

    # --- leases

    def _renew_at(self, held: _Held, due_s: float, quantum_s: float, most: int) -> None:
        held.timers = [timer for timer in held.timers if not timer.cancelled]
        held.timers.append(self._bus.at(due_s, lambda line: self._renew(held, line, quantum_s, most)))

    def _renew(self, held: _Held, line: ModbusLine, quantum_s: float, most: int) -> None:
        if self._held.get(held.number) is not held:
            return
        now_s = self._clock()
        if now_s + MARGIN_S > held.lapses_s:
            self._cut_short(held, line)
            return
        quanta = min(most, math.ceil((held.end_s - now_s) / quantum_s - 1e-9))
        if quanta <= 0:
            return
        try:
            self._board(line).pulse(held.number, quanta)
        except DeviceError as error:
            held.error = error
            self._renew_at(held, max(self._clock(), 0.5 * (now_s + held.lapses_s)), quantum_s, most)
            return
        held.error = None
        held.lapses_s = now_s + quanta * quantum_s
        if held.lapses_s < held.end_s:
            self._renew_at(held, now_s + RENEW_SHARE * most * quantum_s, quantum_s, most)

    def _cut_short(self, held: _Held, line: ModbusLine) -> None:
        """The board's timer may have run out: to renew now would open again what is shut."""
        self.drop(held.number)
        found = f"{held.end_s - self._clock():.1f} s of it left, " + (
            "the host too busy to renew" if held.error is None else held.error.found
        )
        self._tell(
            DeviceFault(
                "relay", f"the pulse on channel {held.number} to be kept up to its end", found,
                "count it as given in full; check the load of the host and the cable of the board",
            )
        )  # fmt: skip
        try:
            self._board(line).cancel(held.number)
        except DeviceError as error:
            self._tell(error)

    def _end(self, held: _Held, line: ModbusLine) -> None:
        if self._held.get(held.number) is not held:
            return
        try:
            self._board(line).cancel(held.number)
        except DeviceError as error:
            self._tell(error)
            if held.watchdog_s is not None:  # no timer of the board will do it
                self._end_later(held, held.watchdog_s, error)
                return
        self.drop(held.number)

    def _end_later(self, held: _Held, watchdog_s: float, error: DeviceError) -> None:
        """Try again for as long as the watchdog would take, then leave the coil to it."""
        if self._clock() < held.end_s + watchdog_s:
            held.timers = [self._bus.at(self._clock() + AGAIN_S, lambda line: self._end(held, line))]
            return
        self._abandoned[held.number] = DeviceFault(
            "relay", f"channel {held.number} to go off", error.found,
            f"stay away: the board is kept in silence, in which its watchdog opens the coil after {watchdog_s:g} s",
        )  # fmt: skip

    # --- the watchdog

    def _keep_alive(self, watchdog_s: float) -> None:
        self._alive_s = self._clock()
        if self._beat is None:
            self._beat_at(self._alive_s + watchdog_s / BEATS, watchdog_s)

    def _beat_at(self, due_s: float, watchdog_s: float) -> None:
        self._beat = self._bus.at(due_s, lambda line: self._beat_once(line, watchdog_s))

    def _beat_once(self, line: ModbusLine, watchdog_s: float) -> None:
        began_s = self._clock()
        silent_s = began_s - self._alive_s
        pause_s, found = watchdog_s / BEATS, "silence for longer"
        if self._abandoned:
            self._beat = None
            return
        try:
            self._board(line).read()
            self._alive_s = began_s
        except DeviceError as error:
            pause_s, found = 0.5 * pause_s, error.found
        if silent_s > watchdog_s:
            self._tell(
                DeviceFault(
                    "relay", f"a sign of life to the board every {watchdog_s:g} s", found,
                    "count what ran as given in full; check the load of the host and the cable of the board",
                )
            )  # fmt: skip
        self._beat_at(self._clock() + pause_s, watchdog_s)
