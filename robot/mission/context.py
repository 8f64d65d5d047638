"""What the states share: the machine's parts, the mission's settings, and how far it has come."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from drivers.camera.interface import StereoCamera
from robot.actuation import LEDGER_WRITE_S, Actuation
from robot.clock import work
from robot.events import Bus
from robot.geometry import Pose2
from robot.ledger import Ledger
from robot.ledger.values import Checkpoint
from robot.mission.events import BookChanged
from robot.mission.localiser import Localiser
from robot.mission.settings import MissionSettings
from robot.navigation import Stop
from robot.targets import Book, Target, TargetState, book_of, with_state
from robot.vision.detector import Detector
from robot.vision.stereo_rig import StereoRig

T = TypeVar("T")


@dataclass(slots=True, eq=False)
class Progress:
    """How far the mission has come. ``stop`` counts from 1; 0 is before the first.

    ``frame_pose`` is the base's pose at the frame in which the present targets were seen; ``seen`` their ids;
    ``queue`` the ids still to be treated at this stop, None before they were chosen; ``aimed`` the id under the nozzle.
    ``lamp_added_1_s`` what the lamp added to the light when it was lit; ``exposure_refused`` what the camera answered;
    ``nonsense`` how many frames in a row were dropped because the detector's answer could not be.
    """

    book: Book = field(default_factory=Book)
    stop: int = 0
    frame_pose: Pose2 | None = None
    seen: frozenset[int] = frozenset()
    queue: list[int] | None = None
    aimed: int | None = None
    lamp_added_1_s: float = 0.0
    exposure_refused: str = ""
    nonsense: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class MissionContext:
    """Everything a state needs, and nothing global."""

    actuation: Actuation
    camera: StereoCamera
    detector: Detector
    rig: StereoRig
    localiser: Localiser
    ledger: Ledger
    task_id: int
    bus: Bus
    settings: MissionSettings
    progress: Progress

    def now_s(self) -> float:
        return asyncio.get_running_loop().time()

    def publish(self, event: object) -> None:
        self.bus.publish(event)

    async def write(self, transaction: Callable[[], T]) -> T:
        """One durable ledger transaction, off the loop."""
        return await work(transaction, LEDGER_WRITE_S)

    async def record(self, kind: str, text: str) -> None:
        stamp_s = self.now_s()
        await self.write(lambda: self.ledger.record_event(kind, text, stamp_s))

    async def set_state(self, target_id: int, state: TargetState, reason: str) -> None:
        """Change a target's fate in the book and in the ledger."""
        await self.keep(with_state(self.progress.book, target_id, state, reason))

    async def keep(self, book: Book) -> None:
        """Make ``book`` the book: its changed targets are written before the mission goes on."""
        before = {target.id: target for target in self.progress.book.targets}
        changed = tuple(target for target in book.targets if before.get(target.id) is not target)
        self.progress.book = book
        if changed:
            await self.write(lambda: self.ledger.upsert_targets(self.task_id, changed))
            self.publish(BookChanged(book))

    async def checkpoint(self) -> None:
        """Write down where the rover stands, with the wheel counters of that moment."""
        odometry = self.localiser.filter.odometry
        pose = self.localiser.pose
        point = Checkpoint(
            self.progress.stop, pose.x_m, pose.y_m, pose.heading_rad, odometry.left_m, odometry.right_m, self.now_s()
        )
        await self.write(lambda: self.ledger.checkpoint(self.task_id, point))

    async def rewind(self) -> None:
        """Go on from the beginning of the present stop, see ``rewound``."""
        await self.write(lambda: rewound(self.progress, self.ledger, self.task_id))

    def stop_here(self) -> Stop:
        return self.settings.row.stops[self.progress.stop - 1]

    def target(self, target_id: int) -> Target:
        return self.progress.book.target(target_id)


def rewound(progress: Progress, ledger: Ledger, task_id: int) -> None:
    """Back to the beginning of the stop at which a task was halted: MOVE goes to the next one, so this is seen again.

    Every target has the fate that the ledger's shots tell: one that was sprayed, or may have been, when the mission was
    halted in the middle of its dose, is not sprayed again.
    """
    progress.book = book_of(ledger.targets(task_id))
    progress.stop = max(0, progress.stop - 1)
