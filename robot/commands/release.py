"""``sprayer release``: an operator's word that an uncertain target may be sprayed again."""

from __future__ import annotations

import uuid
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from robot.errors import FileError, UsageError
from robot.ledger import Ledger, LedgerReader, wall_clock
from robot.targets import TargetState


def release(
    ledger: Annotated[Path, typer.Argument(metavar="LEDGER", help="The ledger of a run (ledger.sqlite).")],
    target: Annotated[
        list[int] | None, typer.Option("--target", metavar="N", help="Which to release; without it they are listed.")
    ] = None,
    operator: Annotated[str, typer.Option("--operator", metavar="NAME", help="Who looked at the plant.")] = "",
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="What was found.")] = "",
    task: Annotated[int | None, typer.Option("--task", min=1, metavar="N", help="Default: the newest task.")] = None,
) -> None:
    """List the targets of which nobody knows what they got, or release some for the next run with --resume.

    What they may have got still counts for their cap.
    """
    if not target:
        with LedgerReader.open_read_only(ledger) as reader:
            _list(reader, _task(reader, task))
        return
    if not (operator.strip() and reason.strip()):
        raise UsageError("a release needs --operator NAME and --reason TEXT: who looked, and what was found")
    if not ledger.is_file():
        raise FileError(f"{ledger}: there is no ledger here; give the path of an existing one")
    with Ledger.open(ledger) as book:
        task_id = _task(book, task)
        book.begin_run(uuid.uuid4().hex, wall_clock())
        book.book_dangling(wall_clock())
        for number in target:
            book.release_target(task_id, number, operator.strip(), reason.strip())
            Console().print(f"task {task_id}: target {number} is open again")


def _task(reader: LedgerReader, task: int | None) -> int:
    task_id = reader.latest_task() if task is None else task
    if task_id is None:
        raise FileError(f"{reader.path}: holds no task; give the ledger of a run")
    reader.task(task_id)
    return task_id


def _list(reader: LedgerReader, task_id: int) -> None:
    uncertain = [item for item in reader.targets(task_id) if item.state is TargetState.UNCERTAIN]
    for item in uncertain:
        x_m, y_m, z_m = item.centre_m
        Console().print(f"target {item.id} at {x_m:.2f} {y_m:.2f} {z_m:.2f} m: {item.reason}", soft_wrap=True)
    if not uncertain:
        Console().print(f"task {task_id} has no uncertain target")
