"""Brings the robot up, disarmed; runs a mission when told to; takes it down clean at any moment."""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import cv2

from drivers.camera.watched import WatchedCamera
from drivers.errors import DeviceBusy, DeviceError
from drivers.twin.machine import Twin
from robot import safety
from robot.clock import keep_time
from robot.config import Config
from robot.errors import BusyError, ConfigError, FileError, UnavailableError, UsageError
from robot.events import Bus
from robot.geometry import Pose2
from robot.ledger import Ledger, wall_clock
from robot.ledger.values import Checkpoint, Dangling, Task
from robot.mission import Localiser, Mission, MissionContext, MissionSettings, Progress, State, Trouble
from robot.runtime.backends import BuildOptions, build_devices, needs_twin, require_timed_pulses, watched
from robot.runtime.devices import Devices, fault_plan, make_twin
from robot.runtime.recorder import FrameRecorder
from robot.runtime.resuming import check_resumable, given_by_target_ml, taken_by_hand_ml, task_to_resume
from robot.runtime.settings import load_arm, load_camera, load_row, mission_settings, task
from robot.runtime.signals import StopSignals
from robot.runtime.upkeep import Poll, Upkeep
from robot.targets import book_of
from robot.vision.detector import Detector
from robot.vision.make import make_detector
from robot.vision.stereo_rig import StereoRig

FARTHEST_COAST_M = 2.0  # how far the counters may have gone on between the last checkpoint and a resume


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What the command line adds to the configuration.

    ``ports`` are those of an emulated rover (device -> path or address), which stand in for the configured ones;
    ``faults`` are those of a simulated machine in this process; ``trace`` is a folder for the bytes of every port.
    """

    config_path: Path
    folder: Path
    start: bool
    resume: bool
    truth: Path | None
    ports: Mapping[str, str] = field(default_factory=dict)
    faults: tuple[str, ...] = ()
    trace: Path | None = None


@dataclass(frozen=True, slots=True)
class RunResult:
    """How a run ended. ``causes`` are the reasons of a latched stop; ``dangling`` what an earlier run left open."""

    state: State
    mode: safety.Mode
    causes: tuple[str, ...]
    task_id: int | None
    dangling: tuple[Dangling, ...]
    duration_s: float


@dataclass(frozen=True, slots=True)
class ModeChanged:
    """Safety's mode since ``stamp_s``, with the causes of a latched one."""

    mode: safety.Mode
    causes: tuple[str, ...]
    stamp_s: float


@dataclass(frozen=True, slots=True)
class RunBegan:
    """Published once the robot is up. ``waiting`` when it stays disarmed."""

    task_id: int | None
    dangling: tuple[Dangling, ...]
    waiting: bool
    stops: int


def ledger_path(folder: Path) -> Path:
    return folder / "ledger.sqlite"


def frames_folder(folder: Path) -> Path:
    return folder / "frames"


async def run_robot(
    config: Config, options: RunOptions, bus: Bus, *, detector: Detector | None = None, twin: Twin | None = None,
    signals: StopSignals | None = None, utc: Callable[[], datetime] = wall_clock,
) -> RunResult:  # fmt: skip
    """One life of the robot, from boot to shutdown. SIGINT and SIGTERM end it clean.

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
        if options.resume:
            task_to_resume(ledger, todays_task)
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
        if options.start:
            require_timed_pulses(devices.relay.capability, config.dosing.max_pulse_s)
        cv2.setNumThreads(1)  # a second core makes vision hardly faster, and the drivers' threads need it
        detector = detector or make_detector(config.vision.detector)
        ledger.begin_run(uuid.uuid4().hex, utc())
        dangling = ledger.book_dangling(utc())
        settings = mission_settings(config, row, arm_model)
        robot = _Robot(config, options, bus, ledger, devices, settings, signals)
        task_id = robot.open_task(todays_task) if options.start else None
        context = robot.context(task_id, detector, rig)
        if not config.simulated:
            keep_time()
        bus.publish(RunBegan(task_id, dangling, not options.start, len(row.stops)))
        state = await robot.live(context)
        safe = robot.actuation.state
        return RunResult(state, safe.mode, safe.causes, task_id, dangling, loop.time() - began_s)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{folder}: cannot be created ({error.strerror}); choose another run directory") from error


class _Robot:
    """The parts of one life, and the tasks that keep them alive."""

    def __init__(
        self, config: Config, options: RunOptions, bus: Bus, ledger: Ledger, devices: Devices,
        settings: MissionSettings, signals: StopSignals,
    ) -> None:  # fmt: skip
        self._options, self._bus, self._ledger, self._devices = options, bus, ledger, devices
        self._settings = settings
        self._lamp = config.camera.lamp == "on"
        self._mission: Mission | None = None
        self._progress = Progress()
        self._checkpoint: Checkpoint | None = None
        self._signals = signals
        self.localiser = Localiser(settings.track_m, settings.datum, settings.fix_rules)
        self._upkeep = Upkeep(config, devices, ledger, self._mode_changed, self._trouble)
        self.actuation = self._upkeep.actuation

    def open_task(self, task: Task) -> int:
        """A new task in the ledger, or with ``resume`` the last one and how far it came."""
        if not self._options.resume:
            task_id = self._ledger.begin_task(task)
            self.actuation.begin_task(task_id, task.tank_fill_ml, 0.0, {})
            return task_id
        task_id = task_to_resume(self._ledger, task)
        self._checkpoint = self._ledger.last_checkpoint(task_id)
        self._progress.book = book_of(self._ledger.targets(task_id))
        self._progress.stop = max(0, self._checkpoint.stop - 1) if self._checkpoint else 0
        given_ml = given_by_target_ml(self._ledger, task_id)
        total_ml = sum(given_ml.values())
        left_ml = task.tank_fill_ml - total_ml - taken_by_hand_ml(self._ledger, task_id)
        self.actuation.begin_task(task_id, left_ml, total_ml, given_ml)
        return task_id

    def context(self, task_id: int | None, detector: Detector, rig: StereoRig) -> MissionContext | None:
        if task_id is None:
            return None
        return MissionContext(
            self.actuation, self._devices.camera, detector, rig, self.localiser, self._ledger, task_id, self._bus,
            self._settings, self._progress,
        )  # fmt: skip

    async def live(self, context: MissionContext | None) -> State:
        """Poll, supervise, run the mission when there is one, and wait for a signal when there is none."""
        recorder = FrameRecorder(self._bus, frames_folder(self._options.folder))
        polls = (
            Poll("gps", "navigation", self._poll_gps, 0.0, 3.0),
            Poll("modem", "telemetry", self._poll_modem, 10.0, 30.0),
        )
        async with self._upkeep.living(self.localiser.on_odometry, polls) as group:
            keeping = group.create_task(recorder.run(), name="frame recorder")
            try:
                state = await self._work(group, context)
            finally:
                keeping.cancel()
        recorder.write_rest()
        self._keep_alignment()
        return state

    def _keep_alignment(self) -> None:
        """What the run's pictures told of the camera's calibration goes into the ledger, and so into the report."""
        camera = self._devices.camera
        if isinstance(camera, WatchedCamera) and (found := camera.watch.misalignment) is not None:
            text = f"calibration {found.verdict()}: {found}"
            self._ledger.record_event("camera", text, asyncio.get_running_loop().time())

    async def _work(self, group: asyncio.TaskGroup, context: MissionContext | None) -> State:
        if context is None:
            await self._signals.wait()
            return State.IDLE
        if self._signals.name:
            await self.actuation.stop(f"stopped by {self._signals.name}")
            return State.IDLE
        self._place()
        await self._upkeep.arm(safety.Verb.START, "start", self._lamp)
        self._mission = Mission(context)
        running = group.create_task(self._mission.run(), name="mission")
        signalled = group.create_task(self._signals.wait(), name="signals")
        await asyncio.wait((running, signalled), return_when=asyncio.FIRST_COMPLETED)
        signalled.cancel()
        if not running.done():
            await self.actuation.stop(f"stopped by {self._signals.name}")
        state = await running
        if state is State.DONE:
            self.actuation.change_mode(safety.Verb.FINISH, "the row is done")
            self.actuation.change_mode(safety.Verb.DISARM, "the row is done")
        return state

    def _place(self) -> None:
        """The rover stands at the row's start, or where the checkpoint and the wheel counters say."""
        odometry = self.actuation.odometry
        assert odometry is not None  # first readings were awaited
        point = self._checkpoint
        if point is None:
            self.localiser.start(Pose2(0.0, 0.0, 0.0), odometry)
            return
        try:
            self.localiser.resume(
                Pose2(point.x_m, point.y_m, point.heading_rad), point.left_m, point.right_m, odometry, FARTHEST_COAST_M
            )
        except DeviceError as error:
            raise UnavailableError(str(error)) from error

    async def _poll_gps(self) -> None:
        self.localiser.on_fix(await self._devices.gps.next_fix())

    async def _poll_modem(self) -> None:
        self._bus.publish(await self._devices.modem.status())

    def _mode_changed(self, state: safety.SafetyState) -> None:
        loop = asyncio.get_running_loop()
        self._bus.publish(ModeChanged(state.mode, state.causes, loop.time()))
        if self._mission is not None:
            self._mission.mode_changed(state)

    def _trouble(self, text: str) -> None:
        self._bus.publish(Trouble(text, asyncio.get_running_loop().time()))
