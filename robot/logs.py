"""Log lines for the journal or for a person, limited so that a fault that repeats does not bury the rest.

Fields travel beside the message: ``log.warning("relay lost", extra=fields(device="relay", tries=3))``.
"""

from __future__ import annotations

import logging
import os
import re
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TextIO

BURST = 10
WINDOW_S = 10.0
KINDS_MAX = 100  # lines of more kinds than that count as one kind
_FIELDS = "sprayer_fields"
_NUMBERS = re.compile(r"\d+(\.\d+)?")
_PRIORITIES = (
    (logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6), (logging.DEBUG, 7),
)  # fmt: skip


def fields(**values: object) -> dict[str, Mapping[str, object]]:
    """What to give as ``extra``: it comes out as ``key=value`` behind the message."""
    return {_FIELDS: values}


def goes_to_journal(stream: TextIO, environment: Mapping[str, str]) -> bool:
    """Whether the service manager connected this very stream to its journal ($JOURNAL_STREAM, systemd.exec(5))."""
    try:
        status = os.fstat(stream.fileno())
    except (OSError, ValueError):
        return False
    return environment.get("JOURNAL_STREAM", "") == f"{status.st_dev}:{status.st_ino}"


def set_up_logs(
    stream: TextIO | None = None,
    environment: Mapping[str, str] | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> LimitedHandler:
    """Send all log lines to ``stream`` (standard error): with priorities to a journal, as plain text elsewhere.

    A journal gets this program's notices too, a person only what is wrong.
    """
    stream = sys.stderr if stream is None else stream
    journal = goes_to_journal(stream, os.environ if environment is None else environment)
    handler = LimitedHandler(stream, clock)
    handler.setFormatter(JournalLines() if journal else PlainLines())
    root = logging.getLogger()
    for former in [each for each in root.handlers if isinstance(each, LimitedHandler)]:
        root.removeHandler(former)
    root.addHandler(handler)
    root.setLevel(logging.WARNING)
    logging.getLogger("robot").setLevel(logging.INFO if journal else logging.WARNING)
    return handler


def journal_handler() -> LimitedHandler | None:
    """The handler that ``set_up_logs`` made, when it writes to a journal."""
    handlers = [each for each in logging.getLogger().handlers if isinstance(each, LimitedHandler)]
    return next((each for each in handlers if isinstance(each.formatter, JournalLines)), None)


class PlainLines(logging.Formatter):
    """``WARNING robot.runtime: message key=value``."""

    def __init__(self) -> None:
        super().__init__("%(levelname)s %(name)s: %(message)s")

    def formatMessage(self, record: logging.LogRecord) -> str:
        return super().formatMessage(record) + _written_fields(record)


class JournalLines(PlainLines):
    """Every line, those of a traceback too, with its priority in front: ``<4>robot.runtime: message key=value``."""

    def __init__(self) -> None:
        logging.Formatter.__init__(self, "%(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        priority = next((number for level, number in _PRIORITIES if record.levelno >= level), 7)
        return "\n".join(f"<{priority}>{line}" for line in super().format(record).splitlines())


@dataclass(slots=True)
class _Window:
    began_s: float
    written: int = 0
    held_back: int = 0


class LimitedHandler(logging.StreamHandler[TextIO]):
    """At most ``BURST`` lines of a kind in ``WINDOW_S``; the rest is counted. A kind is a text apart from its numbers.

    The count is written with the first line after the window, by ``write_counts``, and at the end of the program.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float]) -> None:
        super().__init__(stream)
        self._clock = clock
        self._windows: dict[tuple[str, int, str], _Window] = {}
        self._next_end_s = float("inf")

    def emit(self, record: logging.LogRecord) -> None:
        now_s = self._clock()
        self._end_windows(now_s)
        try:
            kind = (record.name, record.levelno, _NUMBERS.sub("#", record.getMessage()))
        except (TypeError, ValueError):  # a message that does not fit its values: told, never raised at the caller
            self.handleError(record)
            return
        if kind not in self._windows and len(self._windows) >= KINDS_MAX:
            kind = ("robot", record.levelno, "lines of other kinds")
        window = self._windows.setdefault(kind, _Window(now_s))
        self._next_end_s = min(self._next_end_s, window.began_s + WINDOW_S)
        if window.written < BURST:
            window.written += 1
            super().emit(record)
        else:
            window.held_back += 1

    def write_counts(self) -> None:
        """Say of every window that is over how many lines it held back; to be called now and then."""
        self.acquire()
        try:
            self._end_windows(self._clock())
        finally:
            self.release()

    def close(self) -> None:
        self.acquire()
        try:
            self._end_windows(float("inf"))
        finally:
            self.release()
        super().close()

    def _end_windows(self, now_s: float) -> None:
        if now_s < self._next_end_s:
            return
        over = [kind for kind, window in self._windows.items() if now_s - window.began_s >= WINDOW_S]
        for kind in over:
            held_back = self._windows.pop(kind).held_back
            if held_back:
                super().emit(_count_of(kind, held_back))
        self._next_end_s = min((each.began_s for each in self._windows.values()), default=float("inf")) + WINDOW_S


def _count_of(kind: tuple[str, int, str], held_back: int) -> logging.LogRecord:
    name, level, text = kind
    record = logging.LogRecord(name, level, "", 0, "repeated: %s", (text,), None)
    record.__dict__.update(fields(times=held_back, within_s=WINDOW_S))
    return record


def _written_fields(record: logging.LogRecord) -> str:
    values: Mapping[str, object] = getattr(record, _FIELDS, {})
    return "".join(f" {key}={_value(value)}" for key, value in values.items())


def _value(value: object) -> str:
    text = f"{value:.3f}" if isinstance(value, float) else str(value)
    plain = text and not any(letter in text for letter in ' "=\n\t')
    return text if plain else '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
