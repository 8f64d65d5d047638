"""What a scenario gets, and what it hands back to be held against its row of the catalogue."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from robot.mission import State
from robot.safety.catalogue import Action
from tests.robot.mission.rover import Run


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """An empty folder, and the mission that nobody disturbs: the times of its states are the moments for faults."""

    folder: Path
    undisturbed: Run

    def moment(self, state: State, share: float, number: int = 0) -> float:
        """That share of the way through the ``number``-th stay in a state."""
        start, end = self.undisturbed.spans(state)[number]
        return start + share * (end - start)


@dataclass(frozen=True, slots=True)
class Seen:
    """What the machine truly did about a fault, ``after_s`` from its cause; ``kept`` is what was not lost."""

    action: Action
    after_s: float
    kept: str


Scenario = Callable[[Stage], Seen]
Scenarios = Mapping[str, Mapping[str, Scenario]]
"""By the fault's number, then by the case ("" where there is but one)."""
