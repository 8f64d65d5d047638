"""Where the emulated camera's pictures are made: a process of its own, so that rendering never holds up a wire."""

from __future__ import annotations

import asyncio
import functools
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from drivers.twin.illumination import WHITE_BALANCE_K
from drivers.twin.light import rgb_of_colour_temperature
from drivers.twin.optics import StereoOptics
from drivers.twin.plants import grow
from drivers.twin.renderer import StereoRenderer
from drivers.twin.scene import Scene
from drivers.twin.shot import Shot
from drivers.twin.sightings import FruitView

# A good UVC camera's MJPEG: little loss, half the colour across.
JPEG = (cv2.IMWRITE_JPEG_QUALITY, 95, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422)
_AUTO_BALANCE_LIMIT = 2.0

Image = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Order:
    """A picture to make of a shot. ``white_balance_k`` None balances by itself (grey world).

    ``views`` are the pictures wanted: ``stream`` (both, side by side), ``left``, ``right``. ``swapped``: the views have
    changed places. ``truth``: also tell how each fruit shows.
    """

    shot: Shot
    exposure_s: float
    gain: float
    sequence: int
    white_balance_k: float | None = WHITE_BALANCE_K
    views: frozenset[str] = frozenset({"stream"})
    swapped: bool = False
    truth: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Developed:
    """The JPEG of each view that was wanted, the mean code of the pair, and what the order's ``truth`` asked for."""

    jpegs: dict[str, bytes]
    mean: float
    seen: tuple[FruitView, ...] | None


class Darkroom(Protocol):
    """Makes pictures, one after another, off the event loop."""

    async def develop(self, order: Order) -> Developed: ...

    def close(self) -> None: ...


def develop(renderer: StereoRenderer, order: Order) -> Developed:
    """Render, balance and compress."""
    shot = order.shot
    left, right = renderer.render(
        shot.row_from_camera, shot.light, order.exposure_s, order.gain, shot.bodies, order.sequence
    )
    mean = 0.5 * (float(left.mean()) + float(right.mean()))
    pair = np.hstack((right, left) if order.swapped else (left, right))
    if order.white_balance_k != WHITE_BALANCE_K:
        pair = _balanced(pair, order.white_balance_k)
    width = pair.shape[1] // 2
    parts = {"stream": pair, "left": pair[:, :width], "right": pair[:, width:]}
    return Developed(
        jpegs={view: _jpeg(parts[view]) for view in sorted(order.views)},
        mean=mean,
        seen=renderer.truth(shot.row_from_camera, shot.bodies) if order.truth else None,
    )


class InProcess:
    """Renders in a thread of this process, with a renderer that nobody else uses meanwhile."""

    def __init__(self, renderer: Callable[[], StereoRenderer]) -> None:
        self._renderer = renderer
        self._thread = ThreadPoolExecutor(1, "darkroom")

    async def develop(self, order: Order) -> Developed:
        return await asyncio.get_running_loop().run_in_executor(self._thread, lambda: develop(self._renderer(), order))

    def close(self) -> None:
        self._thread.shutdown(wait=True, cancel_futures=True)


class WorkerProcess:
    """Renders in a process that grows the same greenhouse.

    It starts with the first order and ends with ``close``, or with the process that it works for.
    """

    def __init__(self, scene: Scene, optics: StereoOptics, seed: int) -> None:
        self._recipe = pickle.dumps((scene, optics, seed))
        self._worker: Executor = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), initializer=_serve_parent)

    async def develop(self, order: Order) -> Developed:
        return await asyncio.get_running_loop().run_in_executor(self._worker, _develop_there, self._recipe, order)

    def close(self) -> None:
        self._worker.shutdown(wait=True, cancel_futures=True)


def _serve_parent() -> None:
    """In the worker: Ctrl-C is its parent's to hear, and once the parent is killed it has nobody to work for."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def end_with_parent() -> None:
        parent.join()
        os._exit(0)

    threading.Thread(target=end_with_parent, name="parent watch", daemon=True).start()


def _develop_there(recipe: bytes, order: Order) -> Developed:
    return develop(_renderer_of(recipe), order)


@functools.cache
def _renderer_of(recipe: bytes) -> StereoRenderer:
    cv2.setNumThreads(1)
    scene, optics, seed = pickle.loads(recipe)
    return StereoRenderer(grow(scene), optics, seed)


def _jpeg(picture: Image) -> bytes:
    done, data = cv2.imencode(".jpg", picture, JPEG)
    if not done:
        raise ValueError(f"expected a picture that can be compressed, found shape {picture.shape}")
    return data.tobytes()


def _balanced(picture: Image, white_balance_k: float | None) -> Image:
    """Another white balance than the renderer's: each channel's light times its factor, in sRGB codes."""
    if white_balance_k is None:
        means = np.maximum(picture.reshape(-1, 3).mean(axis=0), 1.0)
        factors = np.clip(means[1] / means, 1.0 / _AUTO_BALANCE_LIMIT, _AUTO_BALANCE_LIMIT)
    else:
        rgb = rgb_of_colour_temperature(WHITE_BALANCE_K) / rgb_of_colour_temperature(white_balance_k)
        factors = rgb[::-1] / rgb[1]
    codes = np.arange(256) / 255.0
    linear = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)[:, None] * factors
    linear = np.minimum(linear, 1.0)
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    table = np.round(255.0 * curve).astype(np.uint8)[:, None, :]
    return np.asarray(cv2.LUT(picture, table), dtype=np.uint8)
