"""What a person at the terminal types: lines, from a pipe as well, and single keys."""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from robot.clock import work
from robot.errors import UsageError

ANSWER_S = 5.0        # modelled duration of an answer in virtual time
LOOK_EVERY_S = 0.1    # how soon a reader notices that nobody waits for it any more
CHUNK_BYTES = 4096
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}


class Answers:
    """Reads lines from the standard input without ever holding up the end of the program."""

    def __init__(self) -> None:
        self._rest = b""
        self._ended = False

    def ask_at_once(self, prompt: str) -> str:
        """Before there is an event loop. "" when the input has ended."""
        return self._line(prompt, threading.Event())

    async def ask(self, prompt: str) -> str:
        """One line, stripped; "" when the input has ended. Cancelled, the reader lets go of the input."""
        nobody_waits = threading.Event()
        try:
            return await work(lambda: self._line(prompt, nobody_waits), ANSWER_S)
        finally:
            nobody_waits.set()

    @property
    def from_terminal(self) -> bool:
        """Whether a person types, who can be asked again."""
        number = _descriptor()
        return number is not None and os.isatty(number)

    @property
    def ended(self) -> bool:
        return self._ended and not self._rest

    def _line(self, prompt: str, nobody_waits: threading.Event) -> str:
        _say(prompt)
        number = _descriptor()
        if number is None:
            line = sys.stdin.readline()
            self._ended = line == ""
        else:
            line = self._line_from(number, nobody_waits)
        if number is None or not os.isatty(number):
            _say("\n")  # nobody pressed Enter
        return line.strip()

    def _line_from(self, number: int, nobody_waits: threading.Event) -> str:
        while b"\n" not in self._rest and not self._ended and not nobody_waits.is_set():
            if select.select([number], [], [], LOOK_EVERY_S)[0]:
                data = os.read(number, CHUNK_BYTES)
                self._ended = data == b""
                self._rest += data
        line, _, self._rest = self._rest.partition(b"\n")
        return line.decode("utf-8", "replace")


class TerminalKeys:
    """Single keys: letters as they are, arrows by name. ``at_terminal`` makes one."""

    def __init__(self, number: int) -> None:
        self._number = number

    def within(self, timeout_s: float) -> tuple[str, ...] | None:
        """The keys of the first batch within the time-out; None when the terminal is gone. Blocks."""
        if not select.select([self._number], [], [], timeout_s)[0]:
            return ()
        try:
            data = os.read(self._number, CHUNK_BYTES)
        except OSError:
            return None
        return keys_of(data) if data else None


@contextmanager
def at_terminal(remedy: str) -> Iterator[TerminalKeys]:
    """Keys without Enter and echo while the block lasts. ``UsageError`` with the remedy when there is no terminal."""
    number = require_terminal(remedy)
    before = termios.tcgetattr(number)
    tty.setcbreak(number)
    try:
        yield TerminalKeys(number)
    finally:
        with suppress(termios.error):  # the terminal is gone, and its settings with it
            termios.tcsetattr(number, termios.TCSADRAIN, before)


def require_terminal(remedy: str) -> int:
    """The number of the terminal's file; ``UsageError`` with the remedy when the standard input is no terminal."""
    number = _descriptor()
    if number is None or not os.isatty(number):
        raise UsageError(f"keys need a terminal, and the standard input is none; {remedy}")
    return number


def keys_of(data: bytes) -> tuple[str, ...]:
    """Names of the keys in what a terminal sent; a sequence that is no arrow is one key named ``other``."""
    keys: list[str] = []
    text = data.decode("ascii", "replace")
    while text:
        if text[0] == "\x1b":
            arrow = _ARROWS.get(text[2:3], "other") if text[1:2] in ("[", "O") else "other"
            keys.append(arrow)
            text = text[3:] if arrow != "other" else ""
        else:
            keys.append(text[0].lower())
            text = text[1:]
    return tuple(keys)


def _descriptor() -> int | None:
    """The number of the standard input's file, None when it is no file."""
    try:
        return sys.stdin.fileno()
    except (OSError, ValueError, AttributeError):
        return None


def _say(prompt: str) -> None:
    sys.stdout.write(prompt)
    sys.stdout.flush()
