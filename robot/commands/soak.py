"""``sprayer soak``: days of simulated work with everything that goes wrong, every property watched."""

from __future__ import annotations

import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from robot.config import MAX_SEED
from robot.errors import UsageError
from robot.soak import Soak, SoakOptions, Tally, as_text

TOLD_EVERY_S = 10.0
LONGEST_H = 10_000.0


def soak(
    hours: Annotated[float, typer.Option("--hours", help="Simulated hours.")] = 72.0,
    seed: Annotated[int, typer.Option("--seed", min=0, max=MAX_SEED, help="Of rows, faults and mishaps.")] = 1,
    out: Annotated[
        Path | None, typer.Option("--out", help="Where the ledgers are kept; default a folder that is deleted.")
    ] = None,
    truth: Annotated[Path | None, typer.Option("--truth", help="Write what truly happened to this file.")] = None,
) -> int:
    """Run the whole robot on its simulated machine, in virtual time; exit code 1 when a property was seen broken."""
    if not 0.0 < hours <= LONGEST_H:
        raise UsageError(f"--hours: expected above 0, to {LONGEST_H:g}, found {hours:g}")
    with ExitStack() as stack:
        if out is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="sprayer-soak-")))
        else:
            folder = out
            if folder.exists() and any(folder.iterdir()):
                raise UsageError(f"--out {folder}: expected a new or empty folder; name another")
        result = Soak(SoakOptions(hours, seed, folder, truth), _Progress(hours)).run()
    sys.stdout.write(as_text(result) + "\n")
    return 1 if result.violations else 0


class _Progress:
    """One line every few seconds."""

    def __init__(self, hours: float) -> None:
        self._hours = hours
        self._told_s = time.monotonic()
        self._broken = 0

    def __call__(self, tally: Tally, broken: int) -> None:
        now_s = time.monotonic()
        if now_s - self._told_s < TOLD_EVERY_S and broken == self._broken:
            return
        self._broken = broken
        self._told_s = now_s
        speed = tally.simulated_s / max(tally.real_s, 1e-9)
        sys.stderr.write(
            f"{tally.simulated_s / 3600.0:.2f} of {self._hours:g} h, {speed:.0f} x life, {tally.shots} shots, "
            f"{tally.lives} lives, {broken} properties broken\n"
        )
        sys.stderr.flush()
