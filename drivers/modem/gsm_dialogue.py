"""What is said to a GSM modem, in the thread that owns its port (3GPP 27.005, 27.007)."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from typing import NoReturn

from drivers.errors import DeviceFault, DeviceMissing, DeviceRefused, DeviceTimeout, WrongDevice
from drivers.line import Line
from drivers.modem import at_words
from drivers.modem.at_channel import DEVICE, AtChannel, AtRefused, garbled
from drivers.modem.at_figures import figures_of
from drivers.modem.gsm_settings import GsmSettings
from drivers.modem.inbox import Stored
from drivers.modem.sim_lock import READY, SimLock, SimMemory, without_sim
from drivers.modem.values import ModemStatus

IDENTITY_S = 2.2  # a modem that finds the baud rate by itself needs several attempts
ATTENTION_S = 0.7
GREETING_S = 2.9  # of the 3 s in which a wrong or missing device must be named
LISTING_S = 20.0  # a full store at a low baud rate
STORE_S = 25.0  # deleting from a slow SIM
PROMPT_S = 5.0
RESET_S = 10.0
SET_UP_S = 0.5
SIM_PATIENCE_S = 1.5  # for a SIM that is still starting


class GsmDialogue:
    """Made for one job; ``clock`` gives loop time."""

    def __init__(
        self, line: Line, channel: AtChannel, settings: GsmSettings, sim: SimMemory, clock: Callable[[], float]
    ) -> None:
        self._line, self._channel, self._settings, self._clock = line, channel, settings, clock
        self._deadline_s = float("inf")
        self._is_starting = False  # the SIM has only now been unlocked
        self._lock = SimLock(line, channel, sim, settings.pin, self._within)

    # --- at the beginning

    def identify(self) -> str:
        """Maker and model. ``DeviceMissing`` for silence, ``WrongDevice`` for what is no modem; all within 3 s.

        Echo off, errors in numbers, and the SIM unlocked if it can be: ``DeviceFault`` names a SIM that is locked.
        """
        begun_s = time.monotonic()
        self._deadline_s = begun_s + GREETING_S
        self._channel.leave_prompt(self._line)
        strange = b""
        while not self._attends(begun_s):
            strange = strange or self._channel.strange
            if time.monotonic() - begun_s > IDENTITY_S:
                raise self._nobody(strange)
        self._obeys("ATE0V1")
        self._channel.echo_seen = False
        tells_errors = self._obeys("AT+CMEE=1")
        model = self._model()
        try:
            state = self._lock.state(self._settings.answer_timeout_s, SIM_PATIENCE_S)
        except AtRefused as refused:
            if refused.code is None and not tells_errors:
                raise WrongDevice(
                    DEVICE, "a modem with a SIM", f"a device that answers AT and knows none ({model})",
                    "correct the port: a modem with several has the SIM's commands on its AT port",
                ) from refused  # fmt: skip
            raise without_sim(refused) from refused
        self._lock.open(state, self._settings.answer_timeout_s)
        self._is_starting = state != READY
        return model

    def set_up(self) -> int | None:
        """PDU mode, store, notices. The store's capacity, None while there is no time or no ready SIM: ask again."""
        if self._within(SET_UP_S) < SET_UP_S:
            return None
        self._ask("AT+CMGF=0")
        for detail in ("AT+CREG=1", 'AT+CSCS="GSM"', "AT+COPS=3,0"):
            self._obeys(detail)
        store = self._settings.storage
        try:
            told = self._ask_one(f'AT+CPMS="{store}","{store}","{store}"', "+CPMS")
        except AtRefused as refused:
            if self._is_starting or refused.code in (at_words.SIM_BUSY, at_words.STORE_BUSY):
                return None
            raise
        report = 1 if self._settings.delivery_reports else 0
        for notices in (f"2,1,0,{report},0", f"1,1,0,{report},0", "2,1"):
            if self._obeys(f"AT+CNMI={notices}"):
                break
        return figures_of(told, 2)[1]

    # --- later

    def status(self) -> ModemStatus:
        """SIM, registration, operator, signal: four exchanges."""
        try:
            sim_ready = self._lock.state(self._settings.answer_timeout_s) == READY
        except AtRefused:
            sim_ready = False
        state = self.registration()
        registered = state in at_words.REGISTERED
        operator = self._operator() if registered else None
        rssi = figures_of(self._ask_one("AT+CSQ", "+CSQ"), 1)[0]
        return ModemStatus(
            self._clock(), sim_ready, registered, operator, at_words.signal_dbm(rssi) if registered else None
        )

    def registration(self) -> int:
        """The state of 27.007, 7.2; of the packet network when there is none for calls."""
        state = figures_of(self._ask_one("AT+CREG?", "+CREG"), 2)[1]
        if state in at_words.REGISTERED:
            return state
        try:
            wide = figures_of(self._ask_one("AT+CEREG?", "+CEREG"), 2)[1]
        except AtRefused:  # a modem of the second or third generation
            return state
        return wide if wide in at_words.REGISTERED else state

    def send(self, pdu: str, octets: int) -> int:
        """The reference that the network gave. ``DeviceFault`` when it does not take the text."""
        try:
            told = self._channel.submit(
                self._line, f"AT+CMGS={octets}", pdu, "+CMGS", PROMPT_S, self._settings.send_timeout_s
            )
        except AtRefused as refused:
            raise not_taken(refused.found) from refused
        except DeviceTimeout as silence:
            raise DeviceTimeout(
                DEVICE, silence.expected, silence.found,
                "it is not known whether the network took the text; look at power, cable and signal",
            ) from silence  # fmt: skip
        return figures_of(told, 1)[0]

    def listing(self) -> tuple[Stored, ...]:
        """All that lies in the store."""
        lines = self._channel.ask(self._line, "AT+CMGL=4", "+CMGL", LISTING_S)
        stored: list[Stored] = []
        for at, head in enumerate(lines):
            if not head.startswith("+CMGL"):
                continue
            body = lines[at + 1] if at + 1 < len(lines) else ""
            if body.startswith("+CMGL") or not body:
                raise garbled("a PDU behind each +CMGL", head.encode("latin-1"))
            slot, state = figures_of(head.partition(":")[2], 2)
            stored.append(Stored(slot, state, body.upper()))
        return tuple(stored)

    def delete(self, slot: int) -> None:
        self._channel.ask(self._line, f"AT+CMGD={slot}", None, STORE_S)

    def tidy(self, deletable: Collection[str]) -> tuple[tuple[Stored, ...], DeviceFault | None]:
        """Delete what may go, from a listing made for it. What is left, and what hindered the deleting."""
        left: list[Stored] = []
        trouble: DeviceFault | None = None
        for entry in self.listing():
            if entry.pdu in deletable and trouble is None:
                try:
                    self.delete(entry.slot)
                    continue
                except DeviceFault as fault:
                    trouble = fault
            left.append(entry)
        return tuple(left), trouble

    def restart(self) -> None:
        """The modem begins from its power-up; it is silent for some seconds."""
        self._channel.ask(self._line, "AT+CFUN=1,1", None, RESET_S)

    # --- in small

    def _attends(self, begun_s: float) -> bool:
        try:
            left_s = begun_s + IDENTITY_S - time.monotonic()
            return self._channel.attention(self._line, max(0.1, min(ATTENTION_S, left_s)))
        except DeviceFault:
            return False  # what it said is kept as strange

    def _nobody(self, strange: bytes) -> DeviceMissing | WrongDevice:
        path = self._line.settings.path
        if strange:
            return WrongDevice(
                DEVICE, f"a modem that answers AT at {path}", f"something that says {strange[:40]!r}",
                f"correct the port, or the baud rate ({self._line.settings.baud})",
            )  # fmt: skip
        return DeviceMissing(
            DEVICE, f"a modem that answers AT at {path}", "silence",
            "check its power and its cable, and that this is its AT port",
        )  # fmt: skip

    def _model(self) -> str:
        told: list[str] = []
        for command in ("AT+CGMI", "AT+CGMM"):
            try:
                told += self._ask(command)[:1]
            except AtRefused:
                continue
        return " ".join(told)[:80] or "maker and model not told"

    def _operator(self) -> str | None:
        parts = self._ask_one("AT+COPS?", "+COPS").split('"')
        return parts[1] if len(parts) >= 3 and parts[1] else None

    def _obeys(self, command: str) -> bool:
        """For what some modems do not know and can do without."""
        try:
            self._ask(command)
        except AtRefused:
            return False
        return True

    def _ask(self, command: str) -> tuple[str, ...]:
        return self._channel.ask(self._line, command, None, self._within(self._settings.answer_timeout_s))

    def _ask_one(self, command: str, prefix: str) -> str:
        return self._channel.ask_one(self._line, command, prefix, self._within(self._settings.answer_timeout_s))

    def _within(self, timeout_s: float) -> float:
        return max(0.1, min(timeout_s, self._deadline_s - time.monotonic()))


def not_taken(found: str) -> DeviceFault:
    return DeviceFault(DEVICE, "a network that takes the text", found, "check antenna, SIM, credit and coverage")


def refused_text(why: ValueError) -> NoReturn:
    raise DeviceRefused(DEVICE, "a text that can be sent", str(why), "shorten the text or correct the number") from why
