"""``sprayer report``: the page of a task, made again from its ledger."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from drivers.twin.truth_record import TruthRecord, read_truth
from robot.atomic_file import atomic_file
from robot.config import load_config
from robot.errors import FileError
from robot.ledger import LedgerReader
from robot.report import (
    Evidence,
    Judgement,
    judge,
    kind_rows,
    ledger_rows,
    light_rows,
    read_evidence,
    render,
    score_rows,
)  # fmt: skip
from robot.runtime.settings import dose_rules


def report(
    ledger: Annotated[Path, typer.Argument(metavar="LEDGER", help="The ledger of a run (ledger.sqlite).")],
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="FILE", help="Truth file of a simulated run.")
    ] = None,
    frames: Annotated[
        Path | None, typer.Option("--frames", metavar="DIR", help="Stops' frames; default: frames beside the ledger.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.html", help="Default: report.html beside the ledger.")
    ] = None,
    task: Annotated[int | None, typer.Option("--task", min=1, metavar="N", help="Default: the newest task.")] = None,
    config: Annotated[
        Path | None, typer.Option("--config", metavar="FILE", help="With --truth: judge by this configuration's doses.")
    ] = None,
) -> None:
    """Write a self-contained HTML report, and print its result."""
    if frames is not None and not frames.is_dir():
        raise FileError(f"{frames}: no such folder; give the folder with the stops' frames")
    due_ml = None if config is None else dose_rules(load_config(config)).dose_ml
    with LedgerReader.open_read_only(ledger) as reader:
        evidence = read_evidence(reader, task)
    record = None if truth is None else load_truth(truth)
    judgement = None if record is None else judge(evidence, record, due_ml=due_ml)
    page = out or ledger.parent / "report.html"
    write_report(page, evidence, record, judgement, frames or ledger.parent / "frames")
    Console().print(result_table(evidence, judgement))
    Console().print(Text(f"report: {page}"), soft_wrap=True)


def write_report(
    page: Path, evidence: Evidence, truth: TruthRecord | None, judgement: Judgement | None, frames: Path | None
) -> None:
    """Write the page, whole or not at all. ``FileError`` when it cannot be written."""
    with atomic_file(page) as stream:
        stream.write(render(evidence, truth, judgement, frames).encode("utf-8"))


def result_table(evidence: Evidence, judgement: Judgement | None) -> Table:
    """The result for the terminal."""
    table = Table(title="Result", show_header=False)
    result = ledger_rows(evidence) if judgement is None else score_rows(judgement.score)
    for label, value in (*result, *kind_rows(evidence), *light_rows(evidence)):
        table.add_row(Text(label if label[0].isupper() else f"  {label}"), Text(value))
    return table


def load_truth(path: Path) -> TruthRecord:
    """Read a truth file; ``FileError`` names what is wrong with it."""
    try:
        return read_truth(path)
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except ValueError as error:
        raise FileError(f"{error}; give the file that 'sprayer run --truth' wrote") from error
