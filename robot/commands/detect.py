"""``sprayer detect``: fruit of the images in a folder."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Annotated, TypeVar

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from robot.atomic_file import atomic_file
from robot.calibration_file import load_rig
from robot.commands.detect_jobs import MonoJob, PairJob, detect_pair, detect_single, run_jobs, usable_cores
from robot.errors import FileError, UsageError
from robot.image_folder import ImagePair, find_images, find_pairs

Job = TypeVar("Job")


class DetectorOption(StrEnum):
    PAPER = "paper"
    FRUIT = "fruit"


def detect(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of <id>_left.* and <id>_right.* images.")],
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="JSON lines, one a fruit.")],
    calibration: Annotated[
        Path | None,
        typer.Option(
            "--calibration",
            metavar="FILE|FOLDER",
            help="The rig's calibration, or the folder of those that each pair's <id>.json names as calib_file.",
        ),
    ] = None,
    detector: Annotated[DetectorOption, typer.Option("--detector", help="Which method.")] = DetectorOption.FRUIT,
    mono: Annotated[bool, typer.Option("--mono", help="Single images instead of pairs: no ranges.")] = False,
    annotate: Annotated[
        Path | None, typer.Option("--annotate", metavar="DIR", help="Draw the fruit onto copies in this folder.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, max=64, help="Worker processes; default: one a core.")
    ] = None,
) -> None:
    """Find the fruit in the images of a folder."""
    if mono and calibration is not None:
        raise UsageError("--mono gives no ranges and takes no --calibration; leave one of the two out")
    if not mono and calibration is None:
        raise UsageError("pairs need --calibration FILE|FOLDER; give it, or --mono for single images")
    if calibration is not None and calibration.resolve() == out.resolve():
        raise UsageError(f"--out {out} would overwrite the calibration; give another name")
    if annotate is not None and annotate.resolve() == folder.resolve():
        raise UsageError(f"--annotate {annotate} is the folder of the images themselves; give another one")
    with atomic_file(out) as stream:
        if calibration is None:
            images = find_images(folder)
            _make_folder(annotate)
            mono_jobs = [MonoJob(path, detector.value, _annotated_image(annotate, path)) for path in images]
            fruits = _run(detect_single, mono_jobs, "images", workers, stream.write)
        else:
            pairs = find_pairs(folder)
            pair_jobs = _pair_jobs(pairs, calibration, detector, annotate)
            _make_folder(annotate)
            fruits = _run(detect_pair, pair_jobs, "pairs", workers, stream.write)
    Console(stderr=True).print(f"{fruits} fruit in {out}", highlight=False, soft_wrap=True)


def _run(
    function: Callable[[Job], list[str]],
    jobs: Sequence[Job],
    noun: str,
    workers: int | None,
    write: Callable[[bytes], int],
) -> int:
    """Write the lines of all jobs in their order; the number of lines."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    lines = 0
    begun = time.perf_counter()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(f"detecting {noun}", total=len(jobs))
        for result in run_jobs(function, jobs, workers or usable_cores()):
            write("".join(result).encode())
            lines += len(result)
            progress.advance(task)
    took_s = time.perf_counter() - begun
    console.print(
        f"{len(jobs)} {noun} in {took_s:.1f} s: {len(jobs) / took_s:.1f} {noun} per second",
        highlight=False,
        soft_wrap=True,
    )
    return lines


def _pair_jobs(
    pairs: Sequence[ImagePair], calibration: Path, detector: DetectorOption, annotate: Path | None
) -> list[PairJob]:
    load_once = cache(load_rig)
    jobs = []
    for pair in pairs:
        path = _named_by_sidecar(pair, calibration) if calibration.is_dir() else calibration
        annotated = None if annotate is None else annotate / f"{pair.scene_id}.jpg"
        jobs.append(PairJob(pair, load_once(path), path, detector.value, annotated))
    return jobs


def _named_by_sidecar(pair: ImagePair, folder: Path) -> Path:
    remedy = f"give --calibration a file, or name one of {folder} there"
    try:
        content = json.loads(pair.sidecar.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(f"{pair.sidecar}: cannot be read ({error.strerror}); {remedy}") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise FileError(f"{pair.sidecar}: not valid JSON ({error}); {remedy}") from error
    name = content.get("calib_file") if isinstance(content, dict) else None
    if not isinstance(name, str) or not name:
        raise FileError(f"{pair.sidecar}: has no 'calib_file'; {remedy}")
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        raise FileError(f"{pair.sidecar}: its 'calib_file' {name} lies outside {folder}; {remedy}")
    if not path.is_file():
        raise FileError(f"{pair.sidecar}: its 'calib_file' {name} is not in {folder}; {remedy}")
    return path


def _annotated_image(annotate: Path | None, image: Path) -> Path | None:
    if annotate is None:
        return None
    kept = image.suffix.lower() in (".jpg", ".jpeg", ".png")
    return annotate / (image.name if kept else f"{image.name}.jpg")


def _make_folder(folder: Path | None) -> None:
    if folder is None:
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{folder}: cannot be made a folder ({error.strerror}); give another one") from error
