"""One life of the robot once its devices are open: its tasks, its missions, and the door for orders."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from datetime import datetime

from drivers.camera.watched import WatchedCamera
from drivers.errors import DeviceError
from drivers.wheels.values import Odometry
from robot import safety
from robot.config import Config
from robot.control import ControlSocket, serve
from robot.errors import UnavailableError
from robot.events import Bus
from robot.geometry import Pose2
from robot.ledger import Ledger
from robot.ledger.values import Task
from robot.mission import Localiser, MissionContext, MissionSettings, State, Trouble
from robot.runtime.backends import require_timed_pulses
from robot.runtime.devices import Devices
from robot.runtime.gps_poll import GpsPoll
from robot.runtime.host_watch import HostWatch
from robot.runtime.modem_poll import ModemPoll
from robot.runtime.notify import Notifier, managed
from robot.runtime.operations import Operations, Ways
from robot.runtime.recorder import FrameRecorder
from robot.runtime.rows import Rows
from robot.runtime.signals import StopSignals
from robot.runtime.state_report import StateReport
from robot.runtime.tasks import OpenTask, Tasks
from robot.runtime.upkeep import Poll, Upkeep
from robot.runtime.values import ModeChanged, RunOptions, frames_folder
from robot.supervision import Supervisor
from robot.vision.detector import Detector
from robot.vision.stereo_rig import StereoRig

FARTHEST_COAST_M = 2.0  # how far the counters may have gone on between the last checkpoint and a resume


class Life:
    """The parts of one life, and the tasks that keep them alive. ``remembers`` as in ``Tasks``."""

    def __init__(
        self, config: Config, options: RunOptions, bus: Bus, ledger: Ledger, devices: Devices,
        settings: MissionSettings, today: Task, remembers: bool, detector: Detector, rig: StereoRig,
        signals: StopSignals, utc: Callable[[], datetime],
    ) -> None:  # fmt: skip
        self._config, self._options, self._bus, self._ledger, self._devices = config, options, bus, ledger, devices
        self._settings, self._detector, self._rig, self._signals = settings, detector, rig, signals
        self._lamp = config.camera.lamp == "on"
        self._notifier = Notifier.from_environment()
        self._localiser = Localiser(settings.track_m, settings.datum, settings.fix_rules)
        self._upkeep = Upkeep(config, devices, ledger, self._mode_changed, self._trouble)
        self.actuation = self._upkeep.actuation
        self._gps = GpsPoll(devices.gps, self._localiser, settings, self.actuation, self._trouble)
        self._modem = ModemPoll(devices.modem, bus, self._trouble)
        self._host = HostWatch(options.config_path, config.simulated, self.actuation, self._trouble)
        clock = asyncio.get_running_loop().time
        self.tasks = Tasks(ledger, self.actuation, today, remembers, clock, utc)
        self._rows = Rows(self._context)
        stops = len(settings.row.stops)
        self._report = StateReport(
            config.robot.name, stops, self._upkeep, self.tasks, ledger, devices.ports, bus
        )
        self.operations = Operations(
            today, config.fluid.tank_ml, stops, self._lamp, self._upkeep, self.tasks, self._rows, self._localiser,
            self._report, Ways(self._place, self.check_board, self._trouble),
        )  # fmt: skip

    def check_board(self) -> None:
        """``SprayerError`` when the relay board must not spray unattended."""
        require_timed_pulses(self._devices.relay.capability, self._config.dosing.max_pulse_s)

    async def live(self, control: ControlSocket | None) -> State:
        """Poll, supervise, take orders at the socket, run the mission of the command line; until that is over, or until
        a signal. The last state of the last mission."""
        recorder = FrameRecorder(self._bus, frames_folder(self._options.folder))
        polls = (
            Poll("gps", "navigation", self._gps.step, 0.0, 3.0),
            Poll("modem", "telemetry", self._modem.step, 10.0, 30.0),
            *self._host.polls,
        )
        async with self._upkeep.living(self._on_odometry, polls, self._options.start) as group:
            supervisor = self._upkeep.supervisor
            assert supervisor is not None
            recording = supervisor.keep("frame recorder", "runtime", recorder.run)
            async with AsyncExitStack() as stack:
                stack.callback(recording.cancel)
                if control is not None:
                    supervisor.poll("loop lateness", "runtime", self._report.lateness.tick, 0.0, float("inf"))
                    await stack.enter_async_context(serve(self.operations, control))
                mode = str(self.actuation.state.mode)
                await stack.enter_async_context(managed(self._notifier, supervisor.healthy, mode))
                await self._work(group, supervisor)
        recorder.write_rest()
        self._keep_alignment()
        return self._rows.state

    async def _work(self, group: asyncio.TaskGroup, supervisor: Supervisor) -> None:
        """The signals end it; with a mission from the command line, that mission's end does too."""
        signalled = group.create_task(self._signals.wait(), name="signals")
        try:
            waits: list[asyncio.Task[object]] = [signalled]
            if self._options.start and not self._signals.name:
                waits.append(await self._begin(supervisor))
            elif self._options.start:
                await self.actuation.stop(f"stopped by {self._signals.name}")
            await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
        finally:
            signalled.cancel()
        if self._rows.running:
            await self.actuation.stop(f"stopped by {self._signals.name}")
        await self._rows.ended()

    async def _begin(self, supervisor: Supervisor) -> asyncio.Task[None]:
        """The mission of the command line. ``UnavailableError`` with the reasons against it."""
        task = self.tasks.current
        assert task is not None  # opened before the devices were asked
        self._place(task)
        await self._upkeep.arm(safety.Verb.START, "start", self._lamp)
        return self._rows.begin(supervisor, task)

    def _context(self, task: OpenTask) -> MissionContext:
        return MissionContext(
            self.actuation, self._devices.camera, self._detector, self._rig, self._localiser, self._ledger, task.id,
            self._bus, self._settings, task.progress,
        )  # fmt: skip

    def _place(self, task: OpenTask) -> None:
        """The rover stands at the row's start, or where the checkpoint and the wheel counters say."""
        odometry = self.actuation.odometry
        assert odometry is not None  # first readings were awaited
        point = task.checkpoint
        if task.placed:
            return
        if point is None:
            self._localiser.start(Pose2(0.0, 0.0, 0.0), odometry)
        else:
            pose = Pose2(point.x_m, point.y_m, point.heading_rad)
            try:
                self._localiser.resume(pose, point.left_m, point.right_m, odometry, FARTHEST_COAST_M)
            except DeviceError as error:
                raise UnavailableError(str(error)) from error
        task.placed = True

    def _keep_alignment(self) -> None:
        """What the run's pictures told of the camera's calibration goes into the ledger, and so into the report."""
        camera = self._devices.camera
        if isinstance(camera, WatchedCamera) and (found := camera.watch.misalignment) is not None:
            text = f"calibration {found.verdict()}: {found}"
            self._ledger.record_event("camera", text, asyncio.get_running_loop().time())

    def _on_odometry(self, odometry: Odometry) -> None:
        self._localiser.on_odometry(odometry)
        fence = self._settings.geofence
        if fence is not None and self._localiser.started:
            pose, sigma_m = self._localiser.pose, self._localiser.filter.position_sigma_m
            self.actuation.note_fence(fence.margin_m(pose.x_m, pose.y_m, sigma_m))

    def _mode_changed(self, state: safety.SafetyState) -> None:
        self._bus.publish(ModeChanged(state.mode, state.causes, asyncio.get_running_loop().time()))
        self._notifier.status(": ".join((str(state.mode), *state.causes[-1:])))
        self.operations.mode_changed(state)

    def _trouble(self, text: str) -> None:
        self._bus.publish(Trouble(text, asyncio.get_running_loop().time()))
