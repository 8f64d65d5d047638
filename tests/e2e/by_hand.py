"""Commands by hand on the simulated machine, through the command line, and the truth of what they did."""

from __future__ import annotations

import shutil
from pathlib import Path

from drivers.twin.aftermath import resume_from
from drivers.twin.codec import decode
from drivers.twin.machine import Twin
from drivers.twin.nominal import Nominal
from drivers.twin.scene import Scene
from drivers.twin.truth_record import ProcessTruth, read_truth
from robot.cli import run_command
from robot.ledger import LedgerReader, ShotRow, Totals

from .rover_process import DEMO

STOW_RAD = (0.0, -0.8, 1.35, 0.0, 0.7, 0.0)


def command(out: Path, *words: str, config: Path = DEMO) -> int:
    """Exit code. Commands with one ``out`` act on one machine: its truth file lies there."""
    out.mkdir(exist_ok=True)
    place = ("--config", str(config), "--out", str(out), "--truth", str(out / "truth.jsonl"), "--speed", "0")
    return run_command([*words, *place])


def process(out: Path) -> ProcessTruth:
    """What the last command did."""
    return read_truth(out / "truth.jsonl").processes[-1]


def at_rest(out: Path) -> Twin:
    """The machine as the commands left it, when it has come to rest; not to be commanded."""
    copy = out / "copy_of_truth.jsonl"
    shutil.copyfile(out / "truth.jsonl", copy)
    world = process(out).world
    twin = resume_from(copy, decode(Nominal, world["nominal"]), decode(Scene, world["scene"]), int(world["seed"]))
    twin.close_truth()
    copy.unlink()
    return twin


def shots(out: Path) -> tuple[ShotRow, ...]:
    """Of the newest task."""
    with LedgerReader.open_read_only(out / "ledger.sqlite") as ledger:
        task_id = ledger.latest_task()
        return () if task_id is None else ledger.shots(task_id)


def totals(out: Path) -> Totals:
    with LedgerReader.open_read_only(out / "ledger.sqlite") as ledger:
        task_id = ledger.latest_task()
        assert task_id is not None
        return ledger.totals(task_id)
