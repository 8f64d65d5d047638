"""How an emulated modem hears: characters, echo, command lines, and the text after a prompt (V.250, section 5)."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Protocol

from drivers.modem.emulated_commands import AtError
from drivers.modem.emulated_state import ModemState

LONGEST_COMMAND = 556
LONGEST_TEXT = 1024
MOST_HELD_BYTES = 4096
_ESCAPE, _END, _BACKSPACE = "\x1b", "\x1a", "\x08"
_BASIC = re.compile(r"&?[A-Z]")
_EXTENDED = re.compile(r'([+^$*#%!][A-Z0-9]+)((?:"[^"]*"|[^";])*)')


class Executes(Protocol):
    """What a command line is given to."""

    state: ModemState

    def say(self, text: str, delay_s: float = 0.0, heard: int = 0) -> None: ...

    def execute(self, line: str) -> None: ...

    def finish(self, use: Callable[[str], None], body: str) -> None: ...

    def awkward_moment(self) -> None: ...


class CommandLine:
    """Bytes in, command lines out; bounded. While ``hold`` is in force bytes wait for ``go_on``."""

    def __init__(self, modem: Executes) -> None:
        self._modem = modem
        self._text = self._echo = ""
        self._overlong = False
        self._use: Callable[[str], None] | None = None
        self._waiting: bytearray | None = None

    @property
    def prompts(self) -> bool:
        return self._use is not None

    def prompt(self, use: Callable[[str], None]) -> None:
        self._use = use

    def forget_prompt(self) -> None:
        self._use = None

    def hold(self) -> None:
        self._waiting = bytearray()

    def go_on(self) -> None:
        waiting, self._waiting = self._waiting, None
        if waiting:
            self.feed(bytes(waiting))

    def reset(self) -> None:
        self._text = self._echo = ""
        self._overlong, self._use, self._waiting = False, None, None

    def feed(self, data: bytes) -> None:
        for place, octet in enumerate(data):
            if self._waiting is not None:
                self._waiting += data[place:][: MOST_HELD_BYTES - len(self._waiting)]
                break
            character = chr(octet)
            if self._modem.state.echo and character not in (_ESCAPE, "\n"):
                self._echo += character
            if self._use is not None:
                self._text_character(character)
            else:
                self._command_character(character)
        self._say_echo()

    def _say_echo(self) -> None:
        if self._echo:
            self._modem.say(self._echo, 0.0)
            self._echo = ""

    def _command_character(self, character: str) -> None:
        if character == "\r":
            line, self._text = self._text.strip(), ""
            overlong, self._overlong = self._overlong, False
            self._run(line, overlong)
        elif character == _BACKSPACE:
            self._text = self._text[:-1]
        elif character not in (_ESCAPE, _END, "\n", "\0"):
            self._overlong = self._overlong or len(self._text) >= LONGEST_COMMAND
            self._text += "" if self._overlong else character
            if self._text.upper()[:2] not in ("A", "AT"):  # whatever is not an attention is passed over
                self._text = self._text[1:] if self._text[1:].upper() == "A" else ""

    def _run(self, line: str, overlong: bool) -> None:
        if line[:2].upper() != "AT":
            return
        self._say_echo()
        self._modem.awkward_moment()
        self._modem.execute("AT!" if overlong else line)

    def _text_character(self, character: str) -> None:
        if character == _ESCAPE:
            self._text, self._use = "", None
            self._say_echo()
            self._modem.say("\r\nOK\r\n")
        elif character == _END:
            use, self._use = self._use, None
            body, self._text = self._text, ""
            assert use is not None  # only asked for while there is a prompt
            self._say_echo()
            self._modem.awkward_moment()
            self._modem.finish(use, body)
        elif character == "\r" and self._modem.state.format == 1:
            self._text += character
            self._say_echo()
            self._modem.say("\r\n> ")
        elif len(self._text) < LONGEST_TEXT:
            self._text += character


def split_commands(line: str) -> list[tuple[str, str]]:
    """The commands of one line: name and what follows it (``?``, ``=?``, ``=...``, a digit). Raises ``AtError``."""
    commands: list[tuple[str, str]] = []
    rest = line[2:].strip()
    while rest:
        if rest[0] == ";":
            rest = rest[1:].lstrip()
        elif match := _EXTENDED.match(rest.upper()):
            name = match[1]
            form = rest[len(name) : match.end()].strip()
            if form not in ("", "?") and not form.startswith("="):
                raise AtError
            commands.append((name, form))
            rest = rest[match.end() :].lstrip()
        elif match := _BASIC.match(rest.upper()):
            name, rest = match[0], rest[match.end() :]
            digits = re.match(r"[\d?=]*", rest)
            assert digits is not None  # matches nothing at least
            if name == "D":
                return [*commands, (name, rest)]
            commands.append((name, digits[0]))
            rest = rest[digits.end() :].lstrip()
        else:
            raise AtError
    return commands
