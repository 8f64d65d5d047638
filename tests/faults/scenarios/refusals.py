"""What is refused at the start: the program does not come up, says why, and nothing is armed."""

from __future__ import annotations

import contextlib
import io
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from drivers.twin.truth_record import read_truth
from robot.cli import run_command
from robot.safety.catalogue import Action
from tests.e2e.rover_process import SPRAYER, command

from .values import Seen

USAGE, UNAVAILABLE, FILE, BUSY, CONFIG = 64, 69, 74, 75, 78


def refused(
    arguments: Sequence[str], code: int, *words: str, kept: str, clock: Callable[[], float] = time.process_time
) -> Seen:
    """``sprayer`` with these arguments ends with that exit code and one line on stderr that holds all ``words``."""
    told = io.StringIO()
    began_s = clock()
    with contextlib.redirect_stderr(told):
        found = run_command(list(arguments))
    after_s = clock() - began_s
    error = told.getvalue()
    assert found == code, error
    assert error.startswith("sprayer: "), error
    assert error.count("\n") == 1, error
    for word in words:
        assert word in error, error
    return Seen(Action.SAFE_STOP, after_s, kept)


def run_of(config: Path, out: Path, *more: str) -> list[str]:
    """Arguments of a run that would spray the row at once if nothing was wrong."""
    return command(config, out, "--start", "--speed", "0", *more)[len(SPRAYER) :]


def nothing_was_asked_of(truth: Path) -> None:
    """No command reached the machine, if there ever was one."""
    if truth.exists():
        assert all(process.commands == () or list(process.commands) == [] for process in read_truth(truth).processes)
