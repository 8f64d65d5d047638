"""One command at a time to a modem, each with its own time-out, in the thread that owns the port."""

from __future__ import annotations

import re
import time
from collections.abc import Callable

from drivers.errors import DeviceError, DeviceFault, DeviceLost, DeviceTimeout
from drivers.line import Line
from drivers.modem.at_parser import END_OF_TEXT, AtParser, Dialogue, Notice
from drivers.modem.at_words import ERROR_TABLES

DEVICE = "modem"
ESCAPE = b"\x1b"
_SECRET = re.compile(r"(\+CPIN=|\+CLCK=|\+CPWD=)[^;]+", re.IGNORECASE)
NO_ANSWER = "AT"  # the prefix of a command that has a result alone
QUIET_S = 0.1
RESYNC_S = 1.0
LOOK_UP_S = 0.2  # how often a long wait looks whether it is given up


class AtRefused(DeviceFault):
    """The modem answered that it cannot. ``code`` of ``kind`` ("+CME ERROR", "+CMS ERROR"), None when it gave none."""

    def __init__(self, command: str, final: str) -> None:
        self.kind, _, told = final.partition(":")
        self.code, words = _code_and_words(self.kind, told.strip())
        super().__init__(DEVICE, f"{without_secrets(command)} to be obeyed", words, "check the SIM and the network")


class AtChannel:
    """Parses all that comes over the port: commands run in its owner thread, ``overhear`` gets what comes between.

    ``on_notice`` is called in the owner thread.
    """

    def __init__(self) -> None:
        self.on_notice: Callable[[Notice], None] | None = None
        self.echo_seen = False
        self._parser = AtParser(self._notice)
        self._is_unsure = False
        self._is_given_up = False

    def give_up(self, given_up: bool = True) -> None:
        """From any thread: the command that runs ends in ``DeviceLost``, and so does any other until further notice."""
        self._is_given_up = given_up

    def overhear(self, data: bytes) -> None:
        """Bytes that came while no command ran."""
        self._parser.feed(data)

    def ask(self, line: Line, command: str, prefix: str | None = None, timeout_s: float = 5.0) -> tuple[str, ...]:
        """The lines of the answer, () for a bare OK. ``AtRefused``, ``DeviceTimeout``, ``DeviceFault``."""
        self._settle(line, timeout_s)
        return self._run(line, self._parser.begin(command, prefix), timeout_s)

    def ask_one(self, line: Line, command: str, prefix: str, timeout_s: float = 5.0) -> str:
        """What stands behind the prefix in an answer of one line.

        A result without it belongs to an earlier command that was given up: the question is put once more.
        """
        lines = self.ask(line, command, prefix, timeout_s)
        if not lines:
            self._is_unsure = True
            lines = self.ask(line, command, prefix, timeout_s)
        if not lines:
            raise garbled(f"an answer {prefix} to {command}", self._parser.strange)
        return lines[0].partition(":")[2].strip()

    def submit(
        self, line: Line, command: str, payload: str, prefix: str, prompt_timeout_s: float, timeout_s: float
    ) -> str:
        """A command that prompts for ``payload``; what stands behind the prefix in its answer.

        ``DeviceTimeout`` after the payload has been written: whether it took effect is unknown.
        """
        self._settle(line, prompt_timeout_s)
        running = self._parser.begin(command, prefix, payload)
        try:
            line.write(command.encode("ascii") + b"\r")
            self._await(line, running, prompt_timeout_s, lambda: running.prompted)
            if running.final is None:
                line.write(payload.encode("ascii") + END_OF_TEXT.encode("ascii"))
                self._await(line, running, timeout_s, lambda: False)
        except DeviceError:
            line.write(ESCAPE)
            self._is_unsure = True
            raise
        finally:
            self._parser.end()
        self._judge(running)
        if not running.lines:
            line.write(ESCAPE)
            self._is_unsure = True
            raise garbled(f"an answer {prefix} to {command}", self._parser.strange)
        return running.lines[0].partition(":")[2].strip()

    def leave_prompt(self, line: Line) -> None:
        """A modem that still waits for a text, from before, gives up on it; another passes the character over."""
        line.write(ESCAPE)
        self._parser.forget()
        self._is_unsure = False
        self._clear(line)

    def attention(self, line: Line, timeout_s: float) -> bool:
        """Whether a bare AT has any result: some modems answer it with ERROR."""
        running = self._parser.begin("AT", NO_ANSWER)
        try:
            line.write(b"AT\r")
            self._await(line, running, timeout_s, lambda: False)
        except DeviceTimeout:
            self._is_unsure = True
            return False
        finally:
            self._parser.end()
        self._clear(line)  # it may have been the result of something before
        return True

    @property
    def strange(self) -> bytes:
        """The last that was no line of a modem, since the last command began."""
        return self._parser.strange or self._parser.half_line

    def _run(self, line: Line, running: Dialogue, timeout_s: float) -> tuple[str, ...]:
        try:
            line.write(running.command.encode("ascii") + b"\r")
            self._await(line, running, timeout_s, lambda: False)
        except DeviceError:
            self._is_unsure = True
            raise
        finally:
            self._parser.end()
        self._judge(running)
        return tuple(running.lines)

    def _judge(self, running: Dialogue) -> None:
        self.echo_seen = self.echo_seen or running.echoed
        assert running.final is not None
        if running.final != "OK":
            raise AtRefused(running.command, running.final)

    def _await(self, line: Line, running: Dialogue, timeout_s: float, done: Callable[[], bool]) -> None:
        """Read until there is a final result or ``done``."""
        deadline_s = time.monotonic() + timeout_s
        while running.final is None and not done():
            left_s = deadline_s - time.monotonic()
            if self._is_given_up:
                raise DeviceLost(DEVICE, "an open connection", "a closed one", "open the device first")
            if left_s <= 0.0:
                raise self._silence(running, timeout_s)
            self._parser.feed(line.read_some(min(left_s, LOOK_UP_S)))

    def _silence(self, running: Dialogue, timeout_s: float) -> DeviceFault | DeviceTimeout:
        command = without_secrets(running.command)
        if self.strange:
            return garbled(f"an answer to {command}", self.strange)
        return DeviceTimeout(
            DEVICE, f"an answer to {command} within {timeout_s:g} s", "silence",
            "check its power and its cable; its state is unknown",
        )  # fmt: skip

    def _settle(self, line: Line, timeout_s: float) -> None:
        """Hear what has come in the meantime; after a command without a result, be sure the next result is its own."""
        if not self._is_unsure:
            while line.waiting():
                self._parser.feed(line.read_some(0.0))
            return
        line.write(ESCAPE)
        self._clear(line)
        running = self._parser.begin("AT", NO_ANSWER)
        try:
            line.write(b"AT\r")
            self._await(line, running, min(RESYNC_S, timeout_s), lambda: False)
        finally:
            self._parser.end()
        self._clear(line)
        self._is_unsure = False

    def _clear(self, line: Line) -> None:
        """Until the line is quiet, a second at most."""
        deadline_s = time.monotonic() + RESYNC_S
        while time.monotonic() < deadline_s and (data := line.read_some(QUIET_S)):
            self._parser.feed(data)

    def _notice(self, notice: Notice) -> None:
        if self.on_notice is not None:
            self.on_notice(notice)


def garbled(expected: str, found: bytes) -> DeviceFault:
    return DeviceFault(DEVICE, expected, f"a garbled answer ({found[:40]!r})", "check the cable and its shield")


def _code_and_words(kind: str, told: str) -> tuple[int | None, str]:
    table = ERROR_TABLES.get(kind)
    if table is None:
        return None, kind
    if told.isascii() and told.isdigit():
        code = int(told[:9])
        return code, f"{kind} {code} ({table.get(code, 'not in the standard')})"
    known = {words.lower(): code for code, words in table.items()}
    return known.get(told.lower()), f"{kind} ({told[:60]})"


def without_secrets(command: str) -> str:
    """A command as it may be shown: PIN and PUK are not."""
    return _SECRET.sub(r"\1...", command)
