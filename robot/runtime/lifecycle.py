"""Brings the robot up, disarmed; lets it live until its mission or a signal ends it; takes it down clean."""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import Callable
from contextlib import AsyncExitStack
from datetime import datetime
from pathlib import Path

import cv2

from drivers.errors import DeviceBusy, DeviceError
from drivers.twin.machine import Twin
from robot.clock import VirtualClockLoop, keep_time
from robot.config import Config
from robot.control import ControlSocket
from robot.errors import BusyError, ConfigError, FileError, UnavailableError, UsageError
from robot.events import Bus
from robot.ledger import Ledger, wall_clock
from robot.mission import Trouble
from robot.runtime.alloff_file import write_alloff_files
from robot.runtime.backends import BuildOptions, build_devices, needs_twin, watched
from robot.runtime.devices import fault_plan, make_twin
from robot.runtime.life import Life
from robot.runtime.resuming import check_resumable, task_to_resume
from robot.runtime.settings import load_arm, load_camera, load_row, mission_settings, task
from robot.runtime.signals import StopSignals
from robot.runtime.values import ModeChanged, RunBegan, RunOptions, RunResult, frames_folder, ledger_path
from robot.vision.detector import Detector
from robot.vision.make import make_detector

__all__ = ["ModeChanged", "RunBegan", "RunOptions", "RunResult", "frames_folder", "ledger_path", "run_robot"]


async def run_robot(
    config: Config, options: RunOptions, bus: Bus, *, detector: Detector | None = None, twin: Twin | None = None,
    signals: StopSignals | None = None, utc: Callable[[], datetime] = wall_clock,
) -> RunResult:  # fmt: skip
    """One life of the robot, from boot to shutdown. SIGINT and SIGTERM end it clean.

    In real time it takes orders at ``options.control`` for as long as it lives.

    ``detector`` and ``twin`` (the simulated machine, which is closed at the end) stand in for those that the
    configuration would have made. ``signals`` hears SIGINT and SIGTERM already, and goes on after the run. ``utc`` is
    the wall clock, which dates rows of the ledger and measures nothing.
    Raises ``SprayerError`` for what keeps it from coming up; a mission that was stopped is a result, not an error.
    """
    arm_model, urdf_text = load_arm(config, options.config_path)
    row = load_row(config, options.config_path)
    rig = load_camera(config, options.config_path)
    todays_task = task(config, row)
    if options.resume:
        if config.simulated and twin is None and options.truth is None:
            raise UsageError("a simulated run resumes from its truth file; give the former run's with --truth FILE")
        check_resumable(ledger_path(options.folder))
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    async with AsyncExitStack() as stack:
        signals = signals or stack.enter_context(StopSignals())
        _make_folder(options.folder)
        ledger = stack.enter_context(Ledger.open(ledger_path(options.folder), utc))
        write_alloff_files(config, options.folder, options.ports)
        if options.resume:
            task_to_resume(ledger, todays_task)
        virtual = isinstance(loop, VirtualClockLoop)
        control = None
        if options.control is not None and not virtual:
            control = stack.enter_context(ControlSocket.open(options.control))
        remembers = not config.simulated or twin is not None or options.truth is not None
        if twin is None and needs_twin(config):
            twin = make_twin(config, row, rig, urdf_text, options.truth, fault_plan(options.faults))
        if twin is not None:
            stack.callback(twin.close_truth)
        devices = build_devices(
            config, arm_model, twin, loop.time, BuildOptions(options.config_path, options.ports, options.trace), stack
        )
        devices = watched(devices, rig, loop.time)
        if devices.camera.image_size != rig.image_size:
            raise ConfigError(
                f"{options.config_path}: the camera gives {devices.camera.image_size}, camera.image_size_px says "
                f"{rig.image_size}; correct it and calibrate at the size that is used"
            )
        try:
            await devices.open(stack, lambda text: bus.publish(Trouble(text, loop.time())))
        except DeviceBusy as error:
            raise BusyError(str(error)) from error
        except DeviceError as error:
            raise UnavailableError(str(error)) from error
        cv2.setNumThreads(1)  # a second core makes vision hardly faster, and the drivers' threads need it
        detector = detector or make_detector(config.vision.detector)
        ledger.begin_run(uuid.uuid4().hex, utc())
        dangling = ledger.book_dangling(utc())
        settings = mission_settings(config, row, arm_model)
        life = Life(
            config, options, bus, ledger, devices, settings, todays_task, remembers, detector, rig, signals, utc
        )
        opened = None
        if options.start:
            life.check_board()
            opened = life.tasks.open(options.resume)
            life.tasks.adopt(opened)
        if not config.simulated:
            keep_time()
        place = options.control if control is not None else None
        began = opened.id if opened is not None else None
        bus.publish(RunBegan(began, dangling, not options.start, len(row.stops), life.operations, place))
        state = await life.live(control)
        safe, last = life.actuation.state, life.tasks.current
        return RunResult(
            state, safe.mode, safe.causes, last.id if last else None, dangling, loop.time() - began_s
        )


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{folder}: cannot be created ({error.strerror}); choose another run directory") from error
