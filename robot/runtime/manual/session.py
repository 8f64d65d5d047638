"""One session by hand: the machine comes up, an operator acts in mode MANUAL, and whatever happens it is let go of."""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from robot import safety
from robot.actuation import LEDGER_WRITE_S, Actuation
from robot.clock import keep_time, work
from robot.config import Config
from robot.errors import FileError, SprayerError
from robot.geometry import Pose2
from robot.ledger import Ledger, Task
from robot.mission import Localiser, MissionSettings
from robot.navigation import FixRules
from robot.runtime.alloff_file import write_alloff_files
from robot.runtime.lifecycle import ledger_path
from robot.runtime.manual.building import ManualOptions, hand_devices, open_hands
from robot.runtime.resuming import BY_HAND
from robot.runtime.settings import limits, load_arm, load_row, mission_settings, task
from robot.runtime.signals import StopSignals
from robot.runtime.upkeep import Upkeep
from robot.safety.timing import LEASE_BEAT_S

_SIGNAL = "stopped by "


class Stopped(SprayerError):
    """The machine was stopped in the middle of it. By a signal that is a clean end."""

    def __init__(self, causes: tuple[str, ...]) -> None:
        by_signal = causes[0].startswith(_SIGNAL)
        super().__init__("; ".join(causes) + ("" if by_signal else "; mend that, then begin again"))
        self.exit_code = 0 if by_signal else 1


@dataclass(frozen=True, slots=True, eq=False)
class ByHand:
    """What an operator works with.

    ``task`` is what the ledger is told of liquid sprayed by hand; ``localiser`` counts from where the base stood at the
    beginning; ``tell`` says what a person should know at once.
    """

    settings: MissionSettings
    limits: safety.Limits
    task: Task
    actuation: Actuation
    localiser: Localiser
    ledger: Ledger
    tell: Callable[[str], None]

    def now_s(self) -> float:
        return asyncio.get_running_loop().time()

    async def record(self, text: str) -> None:
        """What the operator asked for, in the ledger's events."""
        stamp_s = self.now_s()
        await work(lambda: self.ledger.record_event("by_hand", text, stamp_s), LEDGER_WRITE_S)


@asynccontextmanager
async def manual(
    config: Config, options: ManualOptions, signals: StopSignals, tell: Callable[[str], None]
) -> AsyncIterator[ByHand]:
    """Arm, relay, wheels and inputs up, energised, armed, in mode MANUAL as long as the block lasts.

    A signal, the e-stop, the bumper, and a device that fails or falls silent end the block: it is cancelled, and
    ``Stopped`` is raised. ``SprayerError`` for what keeps the machine from coming up. Errors may leave in an
    ``ExceptionGroup``.
    """
    arm_model, urdf_text = load_arm(config, options.config_path)
    row = load_row(config, options.config_path)
    settings = mission_settings(config, row, arm_model)
    async with AsyncExitStack() as stack:
        try:
            options.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(f"{options.folder}: cannot be created ({error.strerror}); choose another --out") from error
        ledger = stack.enter_context(Ledger.open(ledger_path(options.folder)))
        write_alloff_files(config, options.folder, options.ports)
        devices = hand_devices(config, row, arm_model, urdf_text, options, stack)
        await open_hands(devices, stack, tell)
        ledger.begin_run(uuid.uuid4().hex, datetime.now(UTC))
        for open_shot in ledger.book_dangling(datetime.now(UTC)):
            tell(f"task {open_shot.task_id}: a shot had no outcome; booked as {open_shot.intent.full_ml:.1f} ml")
        if not config.simulated:
            keep_time()
        stopped = asyncio.Event()
        upkeep = Upkeep(config, devices, ledger, lambda state: _note(state, stopped), tell)
        localiser = Localiser(settings.track_m, None, FixRules())
        todays_task = replace(task(config, row), route=BY_HAND)
        hands = ByHand(settings, limits(config), todays_task, upkeep.actuation, localiser, ledger, tell)
        async with upkeep.living(localiser.on_odometry, attended=True) as group:
            odometry = upkeep.actuation.odometry
            assert odometry is not None  # first readings were awaited
            localiser.start(Pose2(0.0, 0.0, 0.0), odometry)
            if signals.name:
                raise Stopped((f"{_SIGNAL}{signals.name}",))
            await upkeep.actuation.take_lease(BY_HAND)
            beating = group.create_task(_keep_lease(upkeep.actuation), name="sign of life")
            await upkeep.arm(safety.Verb.OPERATE, BY_HAND)
            listening = group.create_task(_stop_on_signal(signals, upkeep.actuation), name="signals")
            try:
                async with _operating(upkeep.actuation, stopped):
                    yield hands
            finally:
                listening.cancel()
                beating.cancel()


def _note(state: safety.SafetyState, stopped: asyncio.Event) -> None:
    if state.mode in safety.LATCHED:
        stopped.set()


async def _keep_lease(actuation: Actuation) -> None:
    """The operator sits at the terminal of this process: its life is the sign of theirs."""
    while True:
        actuation.beat_lease(BY_HAND)
        await asyncio.sleep(LEASE_BEAT_S)


async def _stop_on_signal(signals: StopSignals, actuation: Actuation) -> None:
    name = await signals.wait()
    await actuation.stop(f"{_SIGNAL}{name}")


@asynccontextmanager
async def _operating(actuation: Actuation, stopped: asyncio.Event) -> AsyncIterator[None]:
    """The block in mode MANUAL; handed back READY and disarmed at its good end, stopped at any other."""
    try:
        async with _until(stopped):
            yield
    except Exception as error:
        if actuation.state.mode in safety.LATCHED:
            raise Stopped(actuation.state.causes) from error
        await actuation.stop(str(error))
        raise
    if actuation.state.mode in safety.LATCHED:
        raise Stopped(actuation.state.causes)
    await actuation.halt_base()
    for verb in (safety.Verb.FINISH, safety.Verb.DISARM):
        actuation.change_mode(verb, BY_HAND)


@asynccontextmanager
async def _until(event: asyncio.Event) -> AsyncIterator[None]:
    """The block, cancelled as soon as the event is set; what cancelled it is for the caller to see."""
    body = asyncio.current_task()
    assert body is not None
    interrupted = False

    async def watch(block: asyncio.Task[object]) -> None:
        nonlocal interrupted
        await event.wait()
        interrupted = True
        block.cancel()

    watching = asyncio.create_task(watch(body), name="watch for a stop")
    try:
        yield
    except asyncio.CancelledError:
        if not interrupted or body.uncancel() > 0:
            raise
    finally:
        watching.cancel()
