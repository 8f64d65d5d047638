"""What a run is told, what it tells, and where it keeps its files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from robot import safety
from robot.control import Machine
from robot.ledger.values import Dangling
from robot.mission import State


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What the command line adds to the configuration.

    ``ports`` are those of an emulated rover (device -> path or address), which stand in for the configured ones;
    ``faults`` are those of a simulated machine in this process; ``trace`` is a folder for the bytes of every port;
    ``control`` the file of the control socket, None to have none (a run in virtual time never has one).
    """

    config_path: Path
    folder: Path
    start: bool
    resume: bool
    truth: Path | None
    ports: Mapping[str, str] = field(default_factory=dict)
    faults: tuple[str, ...] = ()
    trace: Path | None = None
    control: Path | None = None


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
    """Published once the devices are open. ``machine`` takes orders from now on; ``waiting`` when it stays disarmed;
    ``control`` is the socket at which it takes them from other programs, None in virtual time."""

    task_id: int | None
    dangling: tuple[Dangling, ...]
    waiting: bool
    stops: int
    machine: Machine
    control: Path | None = None


def ledger_path(folder: Path) -> Path:
    return folder / "ledger.sqlite"


def frames_folder(folder: Path) -> Path:
    return folder / "frames"
