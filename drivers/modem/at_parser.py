"""What a modem says, line by line: echo, answer, final result, prompt, or a notice that nobody asked for.

A line is known by its class, never by its place: notices may stand between an echo and its result, or between the
prompt and the reference of a text.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.modem.at_words import ERROR_TABLES

LONGEST_LINE_BYTES = 4096
MOST_ANSWER_LINES = 2048
PROMPT = b"> "
END_OF_TEXT = "\x1a"

_FINALS = frozenset({"OK", "ERROR", "COMMAND NOT SUPPORT", "TOO MANY PARAMETERS", "ABORTED"})
_CALL_FINALS = frozenset({"NO CARRIER", "BUSY", "NO ANSWER", "NO DIALTONE", "NO DIAL TONE"})
_WITH_BODY = frozenset({"+CMT", "+CDS", "+CBM"})
_NOTICES = frozenset({
    "+CMTI", "+CMT", "+CDS", "+CDSI", "+CBM", "+CBMI", "+CLIP", "+CRING", "+CUSD", "+CCWA", "+CTZV", "+CIEV", "+CTZE",
    "+CREG", "+CGREG", "+CEREG", "RING", "RDY", "Call Ready", "SMS Ready", "NORMAL POWER DOWN",
})  # fmt: skip
_BODY_ANSWERS = frozenset({"+CMGL", "+CMGR"})
_HEX = re.compile(r"([0-9A-Fa-f]{2})+")
_VENDOR = re.compile(r"[\^+*$%&#_][A-Za-z0-9_ ]{1,24}(:.*)?|UNDER-VOLTAGE.*|OVER-VOLTAGE.*|PB DONE|\w+ READY")
_REGISTRATION_ANSWER = re.compile(r"\+CG?E?REG:\s*\d+\s*,\s*\d\d?\s*(,.*)?")


@dataclass(frozen=True, slots=True)
class Notice:
    """A line that nobody asked for; ``body`` is the PDU that came with it."""

    line: str
    body: str | None = None

    @property
    def name(self) -> str:
        return self.line.partition(":")[0].strip()


@dataclass(slots=True)
class Dialogue:
    """A command that runs. ``prefix`` begins the lines of its answer; None: its answer is free text."""

    command: str
    prefix: str | None = None
    payload: str | None = None
    prompted: bool = False
    echoed: bool = False
    lines: list[str] = field(default_factory=list)
    final: str | None = None


class AtParser:
    """Takes bytes as they come; memory stays bounded whatever they are. Belongs to one thread."""

    def __init__(self, on_notice: Callable[[Notice], None]) -> None:
        self._on_notice = on_notice
        self._held = bytearray()
        self._head: str | None = None
        self._dialogue: Dialogue | None = None
        self._wants_body = False
        self.strange_lines = 0
        self.strange = b""

    def begin(self, command: str, prefix: str | None = None, payload: str | None = None) -> Dialogue:
        """From here on lines may belong to this command, which will be followed by ``payload`` after a prompt."""
        self._dialogue = Dialogue(command, prefix, payload)
        self._wants_body = False
        self.strange = b""
        return self._dialogue

    def end(self) -> None:
        self._dialogue = None
        self._wants_body = False

    def forget(self) -> None:
        """The line was interrupted: what came of it before does not belong to what comes."""
        self.end()
        self._held.clear()
        self._head = None
        self.strange = b""

    @property
    def half_line(self) -> bytes:
        """What has come of a line that has not ended."""
        return bytes(self._held)

    def feed(self, data: bytes) -> None:
        self._held += data
        self._look_for_prompt()
        while (end := self._held.find(b"\n")) >= 0:
            line = bytes(self._held[:end])
            del self._held[: end + 1]
            self._take(line)
            self._look_for_prompt()
        if len(self._held) > LONGEST_LINE_BYTES:
            self._be_strange(bytes(self._held))
            self._held.clear()

    def _look_for_prompt(self) -> None:
        running = self._dialogue
        if running is None or running.payload is None or running.prompted:
            return
        text = self._held.lstrip(b"\r\0")
        if text.startswith(PROMPT):
            running.prompted = True
            self._held[:] = text[len(PROMPT) :]

    def _take(self, raw: bytes) -> None:
        line = raw.strip(b"\r\0 \x1b").decode("latin-1")
        if not line:
            return
        if not raw.endswith(b"\r"):  # a modem ends every line with both characters
            self._be_strange(raw)
        elif self._head is not None:
            head, self._head = self._head, None
            if _HEX.fullmatch(line):
                self._on_notice(Notice(head, line))
            else:
                self._on_notice(Notice(head))
                self._classify(line)
        else:
            self._classify(line)

    def _classify(self, line: str) -> None:
        running = self._dialogue
        name = line.partition(":")[0].strip()
        if running is not None and running.final is None and self._is_of(running, line, name):
            return
        if name in _NOTICES and not (name.startswith("+") and ":" not in line):
            self._notice(line, name)
        elif running is not None and running.prefix is None and running.payload is None and line.isprintable():
            self._answer(running, line)
        elif _VENDOR.fullmatch(line) or line in _CALL_FINALS:
            self._notice(line, name)
        elif line not in _FINALS and name not in ERROR_TABLES:  # results of a command given up are passed over
            self._be_strange(line.encode("latin-1"))

    def _is_of(self, running: Dialogue, line: str, name: str) -> bool:
        """Whether the line belongs to the running command; it is kept there if so."""
        if self._wants_body and _HEX.fullmatch(line):
            self._wants_body = False
            self._answer(running, line)
        elif line == running.command or line.rstrip(END_OF_TEXT) == running.payload:
            running.echoed = True
        elif line in _FINALS or name in ERROR_TABLES or (line in _CALL_FINALS and running.command[2:3] in ("D", "A")):
            running.final = line
        elif running.prefix is not None and name == running.prefix and _may_answer(line, name):
            self._wants_body = name in _BODY_ANSWERS
            self._answer(running, line)
        else:
            return False
        return True

    def _answer(self, running: Dialogue, line: str) -> None:
        if len(running.lines) < MOST_ANSWER_LINES:
            running.lines.append(line)
        else:
            self._be_strange(line.encode("latin-1"))

    def _notice(self, line: str, name: str) -> None:
        if name in _WITH_BODY and ":" in line:
            self._head = line
        else:
            self._on_notice(Notice(line))

    def _be_strange(self, raw: bytes) -> None:
        self.strange_lines += 1
        self.strange = raw[:80]


def _may_answer(line: str, name: str) -> bool:
    """Whether this form answers a query; a registration that nobody asked for lacks the first figure."""
    return not name.endswith("REG") or _REGISTRATION_ANSWER.fullmatch(line) is not None
