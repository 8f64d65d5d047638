"""One image or pair at a time, from file to JSON lines, in worker processes."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import cv2

from robot.annotate import Image, draw_circles, draw_fruits
from robot.atomic_file import atomic_file
from robot.errors import ConfigError, FileError, SprayerError
from robot.image_folder import ImagePair, read_image, size_text
from robot.vision.detector import Detector
from robot.vision.make import DetectorName, make_detector
from robot.vision.stereo_rig import StereoRig
from robot.vision.values import Circle, Fruit

_WORTH_A_POOL = 12  # starting the workers takes as long as about so many pairs

Job = TypeVar("Job")


@dataclass(frozen=True, slots=True)
class PairJob:
    """A stereo pair with its rig, and where its annotated left image goes, if anywhere."""

    pair: ImagePair
    rig: StereoRig
    calibration: Path
    detector: DetectorName
    annotated: Path | None


@dataclass(frozen=True, slots=True)
class MonoJob:
    """A single image, and where its annotated copy goes, if anywhere."""

    image: Path
    detector: DetectorName
    annotated: Path | None


def detect_pair(job: PairJob) -> list[str]:
    """One JSON line a fruit: pixels of the stored left image, metres in the left camera's frame."""
    pair = job.pair
    left, right = read_image(pair.left), read_image(pair.right)
    if left.shape != right.shape:
        raise FileError(
            f"{pair.right}: is {size_text(right)}, its partner {pair.left.name} is {size_text(left)}; "
            "give two images of one size"
        )
    if (left.shape[1], left.shape[0]) != job.rig.image_size:
        width, height = job.rig.image_size
        raise ConfigError(
            f"{job.calibration}: is for images of {width}x{height}, {pair.left} is {size_text(left)}; "
            "give the calibration of this camera at this resolution"
        )
    try:
        fruits = _detector(job.detector).detect(left, right, job.rig)
    except ValueError as error:
        raise FileError(f"{pair.left} and {pair.right.name}: {error}") from error
    if job.annotated is not None:
        _write_image(job.annotated, draw_fruits(left, fruits))
    return [_fruit_line(pair.scene_id, fruit) for fruit in fruits]


def detect_single(job: MonoJob) -> list[str]:
    """One JSON line a fruit: pixels of the stored image."""
    image = read_image(job.image)
    try:
        circles = _detector(job.detector).detect_mono(image)
    except ValueError as error:
        raise FileError(f"{job.image}: {error}") from error
    if job.annotated is not None:
        _write_image(job.annotated, draw_circles(image, circles))
    return [_line({"image": job.image.name, **_circle_fields(circle)}) for circle in circles]


def run_jobs(function: Callable[[Job], list[str]], jobs: Sequence[Job], workers: int) -> Iterator[list[str]]:
    """The lines of each job in the order of the jobs; the first job that fails ends all with its error."""
    if workers == 1 or len(jobs) < _WORTH_A_POOL:
        cv2.setNumThreads(1)
        yield from map(function, jobs)
        return
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_prepare_worker)
    try:
        yield from _map_undisturbed(pool, function, jobs)
    except BrokenProcessPool as error:
        raise SprayerError("a worker process was killed (out of memory?); try again with --workers 1") from error
    finally:
        pool.shutdown(cancel_futures=True)


def usable_cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0))


def _map_undisturbed(
    pool: ProcessPoolExecutor, function: Callable[[Job], list[str]], jobs: Sequence[Job]
) -> Iterator[list[str]]:
    """Workers inherit a blocked SIGINT: the parent alone hears Ctrl-C, and ends the pool."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return pool.map(function, jobs)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _prepare_worker() -> None:
    cv2.setNumThreads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A pool's worker waits for jobs for ever when its parent was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@cache
def _detector(name: DetectorName) -> Detector:
    return make_detector(name)


def _fruit_line(scene_id: str, fruit: Fruit) -> str:
    x, y, z = (round(float(value), 5) for value in fruit.centre_m)
    circle = {**_circle_fields(fruit.left), "ripeness": fruit.ripeness.value}
    confidence = round(fruit.confidence, 4)
    place = {"x": x, "y": y, "z": z, "diameter": round(fruit.diameter_m, 5)}
    return _line({"scene_id": scene_id, **circle, **place, "measured": fruit.measured, "confidence": confidence})


def _circle_fields(circle: Circle) -> dict[str, Any]:
    return {
        "u": round(circle.u_px, 3),
        "v": round(circle.v_px, 3),
        "r_px": round(circle.r_px, 3),
        "ripeness": circle.ripeness.value,
        "confidence": round(circle.confidence, 4),
    }


def _line(content: dict[str, Any]) -> str:
    return json.dumps(content, allow_nan=False) + "\n"


def _write_image(path: Path, image: Image) -> None:
    suffix = ".png" if path.suffix.lower() == ".png" else ".jpg"
    done, data = cv2.imencode(suffix, image)
    if not done:
        raise FileError(f"{path}: the annotated image cannot be encoded as {suffix}; give another --annotate folder")
    with atomic_file(path) as stream:
        stream.write(data.tobytes())
