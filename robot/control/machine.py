"""What the API is told of the machine and may ask of it. The runtime stands behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

from robot.actuation import PartStopped
from robot.errors import SprayerError
from robot.mission import State
from robot.safety import Mode
from robot.supervision import TaskHealth


class Declined(SprayerError):
    """The machine does not do it now, for these reasons; nothing was changed."""

    def __init__(self, *reasons: str) -> None:
        super().__init__("; ".join(reasons))
        self.reasons = reasons


class TaskChoice(StrEnum):
    """Which task a start is for. ``AUTO``: the one that is not finished yet, or else a new one."""

    AUTO = "auto"
    NEW = "new"
    RESUME = "resume"


@dataclass(frozen=True, slots=True)
class Plan:
    """What a confirmed start would do. Two plans are equal when nothing that matters changed in between.

    ``task`` is the number of the task to go on with, None for a new one; ``stop`` the first stop, counted from 1;
    ``mode_changes`` how often the mode has changed in this life.
    """

    task: int | None
    route: str
    stop: int
    stops: int
    product: str
    water: bool
    operator: str
    tank_left_ml: float
    label_left_ml: float
    x_m: float
    mode: Mode
    mode_changes: int

    def summary(self) -> str:
        what = "a new task" if self.task is None else f"on with task {self.task}"
        where = f"the rover at {self.x_m:.2f} m" if self.task is not None else "the rover at the row's start"
        return (
            f"{what}: {self.route}, stops {self.stop} to {self.stops}, {where}, {self.product}"
            f"{' (water)' if self.water else ''}, {self.tank_left_ml:.0f} ml in the tank, "
            f"at most {self.label_left_ml:.0f} ml to give"
        )


@dataclass(frozen=True, slots=True)
class FaultNow:
    """An active fault; ``since_s`` in loop time."""

    fault: str
    text: str
    since_s: float


@dataclass(frozen=True, slots=True)
class MissionNow:
    """``stop`` counts from 1, 0 before the first; ``since_s`` (loop time) is when ``state`` was entered."""

    state: State
    reason: str
    since_s: float
    stop: int
    stops: int
    targets: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class LedgerNow:
    """The sums of the present or last task in this life; None when there was none."""

    task: int
    shots: int
    booked_ml: float
    pending_ml: float


@dataclass(frozen=True, slots=True)
class Status:
    """Everything a face shows; ``now_s`` is the loop's time, which every ``*_s`` stamp in it belongs to."""

    robot: str
    now_s: float
    mode: Mode
    mode_since_s: float
    causes: tuple[str, ...]
    faults: tuple[FaultNow, ...]
    mission: MissionNow
    ledger: LedgerNow | None
    tank_left_ml: float | None
    tasks: tuple[TaskHealth, ...]
    unhealthy: str = ""


@dataclass(frozen=True, slots=True)
class LatenessCounts:
    """How late the event loop came: ``counts[i]`` ticks of at most ``bounds_s[i]``, the last count beyond them all."""

    bounds_s: tuple[float, ...]
    counts: tuple[int, ...]
    sum_s: float


@dataclass(frozen=True, slots=True)
class PortCounts:
    """Counters of one port since the program came up, by name (bytes_in, jobs, losses ...)."""

    device: str
    counts: Mapping[str, int] = field(default_factory=dict)


class Machine(Protocol):
    """A living robot as the API sees it. What it does not do now raises ``Declined`` with the reasons."""

    async def status(self) -> Status: ...

    def lateness(self) -> LatenessCounts: ...

    def ports(self) -> tuple[PortCounts, ...]: ...

    async def stop(self, cause: str) -> tuple[PartStopped, ...]:
        """Stop in whatever mode; each part of the machine reports."""
        ...

    async def arm(self, cause: str) -> None: ...

    async def plan(self, choice: TaskChoice) -> Plan:
        """What a start would do now."""
        ...

    async def start(self, plan: Plan, cause: str) -> int:
        """Begin what was planned; the number of the task. ``Declined`` when the plan is not true any more."""
        ...

    async def pause(self, cause: str) -> None: ...

    async def resume(self, cause: str) -> None: ...

    async def acknowledge(self, cause: str) -> None: ...

    async def reset(self, cause: str) -> None: ...

    async def refill(self, tank_ml: float, cause: str) -> None:
        """The tank holds ``tank_ml`` now, and the task under way goes on with that."""
        ...

    async def disarm(self, cause: str) -> None: ...
