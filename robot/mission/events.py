"""What a mission tells whoever listens."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.camera.values import StereoFrame
from robot.ledger import StopLight
from robot.mission.transitions import State
from robot.targets import Book
from robot.vision.values import Fruit


@dataclass(frozen=True, slots=True)
class StateEntered:
    """The mission is in ``state`` since ``stamp_s``; ``stop`` counts from 1 (0 before the first)."""

    state: State
    reason: str
    stamp_s: float
    stop: int
    stops: int


@dataclass(frozen=True, slots=True, eq=False)
class FrameSeen:
    """A pair was looked at; ``target_ids[i]`` is the target that ``fruits[i]`` was taken for."""

    stop: int
    frame: StereoFrame
    fruits: tuple[Fruit, ...]
    target_ids: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class LightSeen:
    """In what light the pair of a stop was taken, at the end of metering."""

    stop: int
    light: StopLight
    stamp_s: float


@dataclass(frozen=True, slots=True, eq=False)
class BookChanged:
    book: Book


@dataclass(frozen=True, slots=True)
class ShotDone:
    """A target got its dose; ``booked_ml`` is what the ledger holds for it."""

    target_id: int
    stop: int
    dose_ml: float
    booked_ml: float
    stamp_s: float


@dataclass(frozen=True, slots=True)
class TargetSkipped:
    target_id: int
    stop: int
    reason: str


@dataclass(frozen=True, slots=True)
class Trouble:
    """Something went wrong, in words for a person."""

    text: str
    stamp_s: float
