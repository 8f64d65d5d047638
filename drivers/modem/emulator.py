"""A SIM800-like modem on the twin's network, behind its AT port."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable

from drivers.emulation.bad_line import BadLine
from drivers.modem import at_words
from drivers.modem.at_words import ERROR_TABLES
from drivers.modem.emulated_commands import (
    GENERAL,
    LTE,
    AtError,
    Handler,
    registration_notice,
    registration_state,
)
from drivers.modem.emulated_line import CommandLine, split_commands
from drivers.modem.emulated_post import EmulatedPost
from drivers.modem.emulated_sim import MODEM_SLOTS, RECEIVED_UNREAD, EmulatedSim, StoredPdu, TextStore
from drivers.modem.emulated_state import ModemState
from drivers.modem.emulated_texts import TEXTS, TextHandler
from drivers.modem.mock import SENDING_S, WRONG_DBM
from drivers.modem.pdu import Submit
from drivers.twin.bus import SLOW_FACTOR
from drivers.twin.faults import Verb
from drivers.twin.machine import Twin

ANSWER_S = 0.008
BOOT_S = 3.0
REGISTERING_S = 2.0
TICK_S = 0.5
STATUS_REPORT = 2


class ModemEmulator:
    """Strict and stateful. ``awkward``: what nobody asked for comes between echo and result, or prompt and reference.

    ``clock`` is the running loop's time; ``sending_s`` is how long the network takes over a text. ``serve`` lets it
    say by itself what happens in the network.
    """

    def __init__(
        self,
        twin: Twin,
        clock: Callable[[], float],
        sim: EmulatedSim | None = None,
        *,
        awkward: bool = False,
        lte: bool = False,
        sending_s: float = SENDING_S,
    ) -> None:
        self._twin, self._clock = twin, clock
        self.sim = EmulatedSim() if sim is None else sim
        self.memory = TextStore(MODEM_SLOTS)
        self.state = ModemState()
        self._post = EmulatedPost(twin, clock, self.sim.smsc)
        self._handlers: dict[str, Handler | TextHandler] = {**GENERAL, **TEXTS, **(LTE if lte else {})}
        self._awkward, self.sending_s = awkward, sending_s
        self._input = CommandLine(self)
        self._line: BadLine | None = None
        self._held: deque[str] = deque()
        self._booting: asyncio.TimerHandle | None = None
        self._ready_s = clock()
        self._reference = 0
        self._frozen_signal: int | None = None
        self.hung = self.radio_lost = False
        self.restarts = 0
        self._shown_registration = registration_state(self)

    # --- its line

    def connect(self, line: BadLine) -> None:
        self._line = line

    def receive(self, data: bytes) -> None:
        if self._line is not None and self._line.hears and not self.hung and self._booting is None:
            self._input.feed(data)

    def say(self, text: str, delay_s: float = ANSWER_S, heard: int = 0) -> None:
        if self._line is not None and not self.hung:
            self._line.say(text.encode("latin-1"), delay_s, heard)

    async def serve(self) -> None:
        """Until it is cancelled."""
        while True:
            await asyncio.sleep(TICK_S)
            self.look_around()

    def look_around(self) -> None:
        """See what the network has brought, and tell the host as far as it wants to know."""
        if self._booting is not None or self.hung:
            return
        state = registration_state(self)
        if state != self._shown_registration:
            self._shown_registration = state
            for name, wanted in (("CREG", self.state.registration), ("CGREG", self.state.packet_registration)):
                if wanted:
                    self.notify(registration_notice(name, wanted, state))
        if self.registered and self._verb is not Verb.STUCK:
            self._post.fetch()
            self._take_in()
            self._report()

    def notify(self, line: str) -> None:
        """Tell the host what it has not asked for, now or at the next awkward moment."""
        if self._awkward:
            self._held.append(line)
        else:
            self.say(f"\r\n{line}\r\n")

    def awkward_moment(self) -> None:
        while self._held:
            self.say(f"\r\n{self._held.popleft()}\r\n", 0.0)

    # --- commands

    def execute(self, line: str) -> None:
        """One command line, without its end."""
        lines: list[str] = []
        final = "OK"
        try:
            for name, form in split_commands(line):
                lines += self._basic(name, form) if not name.startswith("+") else self._extended(name, form)
        except AtError as error:
            final = self._error(error)
        if self._input.prompts and final == "OK":
            self.say("\r\n> ", heard=len(line))
            return
        self._input.forget_prompt()
        self.say("".join(f"\r\n{each}\r\n" for each in (*lines, final) if each), heard=len(line))

    def _extended(self, name: str, form: str) -> list[str]:
        handler = self._handlers.get(name)
        if handler is None:
            raise AtError
        if form == "=?" and name in ("+CIMI", "+SPIC", "+CNUM"):
            return []
        reply = handler(self, form)
        if reply.prompt is not None:
            self._input.prompt(reply.prompt)
        return reply.lines

    def _basic(self, name: str, form: str) -> list[str]:
        match name:
            case "E":
                self.state.echo = form == "1"
            case "Z" | "&F":
                functional = self.state.functional
                self.state = ModemState()
                self.state.functional = functional
            case "I":
                return ["SIM800 R14.18"]
            case "" | "V" | "Q" | "X" | "S" | "&W" | "&D" | "&C" | "H" | "L" | "M":
                pass
            case "D":
                raise AtError(3)
            case _:
                raise AtError
        return []

    def finish(self, use: Callable[[str], None], body: str) -> None:
        """The text after a prompt is there."""
        try:
            use(body)
        except AtError as error:
            self.result(self._error(error))

    def result(self, *lines: str) -> None:
        self.say("".join(f"\r\n{line}\r\n" for line in lines))

    def _error(self, error: AtError) -> str:
        table = ERROR_TABLES[error.kind]
        if error.code is None or (self.state.errors == 0 and error.kind == "+CME ERROR"):
            return "ERROR"
        return f"{error.kind}: {table.get(error.code, 'unknown') if self.state.errors == 2 else error.code}"

    # --- what the commands see

    @property
    def registered(self) -> bool:
        settled = self._clock() >= self._ready_s and self.state.functional == 1 and not self.radio_lost
        return settled and self.sim.ready and self._twin.registered

    @property
    def operator(self) -> str:
        return self._twin.nominal.modem_operator

    def signal(self) -> int:
        status = self._twin.modem_status(self._clock())
        if self._verb is Verb.STUCK and self._frozen_signal is not None:
            return self._frozen_signal
        dbm = WRONG_DBM if self._verb is Verb.WRONG else status.signal_dbm
        self._frozen_signal = 99 if dbm is None or not self.registered else max(0, min(31, round((dbm + 113.0) / 2.0)))
        return self._frozen_signal

    def sim_unlocked(self) -> None:
        self._ready_s = self._clock() + REGISTERING_S
        self.notify("+CPIN: READY")

    def store(self, use: int) -> TextStore:
        return self.store_named(self.state.stores[use])

    def store_named(self, name: str) -> TextStore:
        return self.sim.texts if name == "SM" else self.memory

    def transmit(self, submit: Submit) -> None:
        """The network takes its time; what the host says meanwhile waits."""
        self._input.hold()
        slow = SLOW_FACTOR if self._verb is Verb.SLOW else 1.0
        asyncio.get_running_loop().call_later(self.sending_s * slow, self._transmitted, submit, self.restarts)

    def _transmitted(self, submit: Submit, restarts: int) -> None:
        if restarts != self.restarts:
            return
        if self.registered:
            self._reference = self._reference % 255 + 1
            self._post.take_out(submit, self._reference)
            self.awkward_moment()
            self.result(f"+CMGS: {self._reference}", "OK")
        else:
            self.result(self._error(AtError(at_words.NO_SERVICE, "+CMS ERROR")))
        self._input.go_on()

    def store_draft(self, entry: StoredPdu) -> None:
        slot = self.store(1).store(entry)
        if slot is None:
            raise AtError(at_words.MEMORY_FULL, "+CMS ERROR")
        self.result(f"+CMGW: {slot}", "OK")

    def deleted(self) -> None:
        stored = [*self.sim.texts.slots.values(), *self.memory.slots.values()]
        self._post.gone({entry.text for entry in stored if entry.text is not None})
        if self.registered and self._verb is not Verb.STUCK:
            self._take_in()

    # --- power

    def restart(self) -> None:
        """By command or by its supply: all that it was told is gone, the SIM is locked, the store stays."""
        self.restarts += 1
        self.hung = self.radio_lost = False
        if self._booting is not None:
            self._booting.cancel()
        loop = asyncio.get_running_loop()
        loop.call_soon(self._go_down)
        self._booting = loop.call_later(BOOT_S, self._boot)

    def ring(self, caller: str) -> None:
        """Somebody calls."""
        self.notify("RING")
        if self.state.caller_shown:
            self.notify(f'+CLIP: "{caller}",145,"",0,"",0')

    def _go_down(self) -> None:
        self.state = ModemState()
        self._input.reset()
        self._held.clear()
        self._ready_s = self._clock() + BOOT_S + REGISTERING_S
        self.sim.power_up()

    def _boot(self) -> None:
        self._booting = None
        pin = [f"+CPIN: {self.sim.state}"] if self.sim.inserted else ["+CPIN: NOT INSERTED"]
        ready = ["Call Ready", "SMS Ready"] if self.sim.ready else []
        self.result("RDY", "+CFUN: 1", *pin, *ready)

    # --- texts in

    def _take_in(self) -> None:
        """What the network holds, as far as there is room."""
        wanted = self.state.notices[1]
        while self._post.waiting and (self.store(2).free or wanted == 2):
            incoming = self._post.waiting.popleft()
            if wanted == 2:
                self.notify(f"+CMT: ,{incoming.octets}\r\n{incoming.pdu}")
                self.deleted()
                continue
            entry = StoredPdu(RECEIVED_UNREAD, incoming.pdu, incoming.octets, incoming.text)
            slot = self.store(2).store(entry)
            if wanted == 1:
                self.notify(f'+CMTI: "{self.state.stores[2]}",{slot}')

    def _report(self) -> None:
        while self._post.reports and self._post.reports[0].due_s <= self._clock():
            report = self._post.reports.popleft()
            wanted = self.state.notices[3]
            if wanted == 1:
                self.notify(f"+CDS: {report.octets}\r\n{report.pdu}")
            elif wanted == STATUS_REPORT and self.store(2).free:
                slot = self.store(2).store(StoredPdu(RECEIVED_UNREAD, report.pdu, report.octets))
                self.notify(f'+CDSI: "{self.state.stores[2]}",{slot}')

    @property
    def _verb(self) -> Verb:
        return self._twin.verb("modem", self._clock())
