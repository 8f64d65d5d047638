"""``sprayer demo``: one simulated row from the first command to a report to look at."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from drivers.twin.truth_record import TruthRecord
from robot.client import socket_path
from robot.commands.report import load_truth, result_table, write_report
from robot.commands.run import ConfigOption, SeedOption, SpeedOption, load_with_seed, run_with_view
from robot.config import Config
from robot.errors import FileError, UsageError
from robot.ledger import LedgerReader
from robot.ledger.lock import LedgerLock
from robot.mission import State
from robot.package_files import config_file
from robot.report import judge, read_evidence
from robot.runtime import RunOptions, frames_folder, ledger_path
from robot.runtime.reach import reachable_fruits
from robot.runtime.settings import dose_rules


def demo(
    config: ConfigOption = Path("configs/demo.toml"),
    seed: SeedOption = None,
    speed: SpeedOption = 10.0,
    out: Annotated[Path, typer.Option("--out", help="Folder of the run; a former demo in it is replaced.")] = Path(
        "out/demo"
    ),
) -> int:
    """Spray one simulated row, print how well it went, and write the report."""
    settings = load_with_seed(config, seed)
    if not (settings.simulated or settings.emulated):
        raise UsageError(f"{config}: has hardware back ends; the demo runs on simulated ones (try configs/demo.toml)")
    path = config_file(config)
    clear_former_demo(out)
    truth_path = out / "truth.jsonl"
    if settings.emulated:
        Console(stderr=True).print(Text("real ports run in real time: --speed is not used"), soft_wrap=True)
    options = RunOptions(path, out, True, False, truth_path, control=socket_path(out, {}))
    result = run_with_view(settings, options, speed, emulate=settings.emulated)
    truth = load_truth(truth_path)
    reachable = reach_of(settings, path, truth)
    with LedgerReader.open_read_only(ledger_path(out)) as ledger:
        evidence = read_evidence(ledger)
    judgement = judge(evidence, truth, reachable, dose_rules(settings).dose_ml)
    page = out / "report.html"
    write_report(page, evidence, truth, judgement, frames_folder(out))
    console = Console()
    console.print(Text(f"{settings.robot.name}, seed {settings.twin.seed}, detector {settings.vision.detector}"))
    console.print(result_table(evidence, judgement))
    console.print(Text(f"report: {page}"), soft_wrap=True)
    return 0 if result.state is State.DONE else 1


def reach_of(config: Config, path: Path, truth: TruthRecord) -> frozenset[int]:
    """Ids of the true fruits that the arm can reach from some stop."""
    fruits = {fruit.id: (np.array(fruit.centre_m), fruit.diameter_m) for fruit in truth.fruits}
    return reachable_fruits(config, path, fruits)


def clear_former_demo(out: Path) -> None:
    """Remove what a former simulated run wrote there, and nothing else.

    ``BusyError`` while a robot uses the ledger there, ``FileError`` when it holds tasks of real hardware.
    """
    ledger = ledger_path(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        with locked(ledger):
            if ledger.exists():
                refuse_records(ledger)
            for name in (ledger.name, f"{ledger.name}-wal", f"{ledger.name}-shm", "truth.jsonl", "report.html"):
                (out / name).unlink(missing_ok=True)
            if frames_folder(out).exists():
                shutil.rmtree(frames_folder(out))
    except OSError as error:
        raise FileError(f"{out}: cannot be prepared ({error.strerror}); choose another folder with --out") from error


@contextmanager
def locked(ledger: Path) -> Iterator[None]:
    """Nobody else uses the ledger meanwhile."""
    lock = LedgerLock(ledger)
    try:
        yield
    finally:
        lock.release()


def refuse_records(ledger: Path) -> None:
    """What real hardware sprayed must be kept: only a simulated task has a seed."""
    with LedgerReader.open_read_only(ledger) as reader:
        real = [row.task_id for row in reader.tasks() if reader.task(row.task_id).seed is None]
    if real:
        raise FileError(
            f"{ledger}: holds the records of real spraying (task {real[0]}); choose another folder with --out"
        )
