"""Prints one line a figure: what was measured, how often, the median and the worst."""

from __future__ import annotations

import asyncio
import resource
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from drivers.twin import bench_renderer
from drivers.twin.machine import Twin
from drivers.twin.scene import Scene
from robot.aiming import plan
from robot.calibration_file import load_rig
from robot.clock import run_virtual
from robot.config import Config, load_config
from robot.events import Bus
from robot.ledger import Ledger
from robot.mission import StateEntered
from robot.package_files import packaged
from robot.runtime import RunOptions, RunResult, run_robot
from robot.runtime.devices import nominal_machine
from robot.runtime.settings import load_arm, load_row, mission_settings
from robot.vision.make import make_detector
from tests.bench import (
    bench_alloff,
    bench_arm,
    bench_camera,
    bench_gps,
    bench_modem,
    bench_relay,
    bench_stop,
)
from tests.bench.lines import measure, say

DEMO = packaged("configs") / "demo.toml"


def vision_and_twin(config: Config) -> None:
    rig = load_rig(packaged("configs") / config.camera.calibration)
    _, urdf = load_arm(config, DEMO)
    twin = Twin(nominal_machine(config, rig, urdf), Scene(seed=1), 1)
    left, right = twin.expose(0.0, 0.004, 1.0, 0)
    for name in ("paper", "fruit"):
        detector = make_detector(name)  # type: ignore[arg-type]
        measure(f"vision: detector {name}, 640x480 pair", 10, lambda d=detector: d.detect(left, right, rig))


def aiming(config: Config) -> None:
    arm, _ = load_arm(config, DEMO)
    settings = mission_settings(config, load_row(config, DEMO), arm)
    dice = np.random.default_rng(1)
    stowed = np.array(settings.stow_rad)

    def aim() -> object:
        centre = settings.base_from_arm.inverse().apply(dice.uniform([-0.2, 0.45, 0.6], [0.2, 0.75, 1.1]))
        return plan(centre, 0.07, stowed, arm, settings.aiming, settings.rover_body)

    measure("aiming: plan one fruit from the stowed arm", 50, aim, "<= 60 ms")


def ledger() -> None:
    from tests.robot.ledger.rows import INTENT, started, target

    with tempfile.TemporaryDirectory() as folder:
        book, task_id = started(Path(folder) / "ledger.sqlite")
        book.upsert_targets(task_id, [target(INTENT.target_id)])
        measure("ledger: one durable intent", 200, lambda: book.write_intent(task_id, INTENT))
        assert isinstance(book, Ledger)
        book.close()


def mission() -> None:
    """The demo row from the first command to DONE, and what it takes to come up before that."""
    with tempfile.TemporaryDirectory() as folder:
        began_s = time.monotonic()
        marks_s: list[float] = []

        async def life() -> RunResult:
            bus = Bus()
            states = bus.subscribe(StateEntered)

            async def first_state() -> None:
                await states.next()
                marks_s.append(time.monotonic())

            options = RunOptions(DEMO, Path(folder), start=True, resume=False, truth=Path(folder) / "truth.jsonl")
            first = asyncio.create_task(first_state())
            result = await run_robot(load_config(DEMO), options, bus)
            await first
            return result

        result = run_virtual(life())
        wall_s = time.monotonic() - marks_s[0]
    say(
        "mission: the demo row in virtual time",
        f"{result.duration_s:.0f} s simulated in {wall_s:.1f} s, after {marks_s[0] - began_s:.1f} s to come up: "
        f"{result.duration_s / wall_s:.0f} times real time",
        ">= 20",
    )


def main() -> None:
    cv2.setNumThreads(1)
    sys.stdout.write("twin's camera, 640x480 (goal: a pair from a new pose <= 30 ms)\n")
    bench_renderer.main()
    config = load_config(DEMO)
    vision_and_twin(config)
    aiming(config)
    ledger()
    mission()
    for title, device in (
        ("arm, over an emulated bus in another process", bench_arm),
        ("relay board", bench_relay),
        ("all-off script", bench_alloff),
        ("receiver", bench_gps),
        ("modem", bench_modem),
        ("camera", bench_camera),
        ("STOP", bench_stop),
    ):
        sys.stdout.write(f"{title}\n")
        device.bench(say)
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    say("memory: peak resident set of this process", f"{peak_mib:.0f} MiB")


if __name__ == "__main__":
    main()
