"""What goes wrong in one life, drawn by seed: faults of devices, people, things that bump, kills, clocks that jump."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from drivers.twin import commands as c
from drivers.twin.faults import DEVICES, VALVE_VERBS, Fault, FaultPlan, Verb

LIFE_S = 260.0        # a row takes about so long: where in it things happen
MEAN_FAULTS, MEAN_MISHAPS = 1.0, 0.9
AT_BOOT_SHARE = 0.08
LENGTHS_S = ((0.05, 0.6), (0.6, 5.0), (5.0, 40.0))  # a blip, a hiccup, an outage


class Kind(StrEnum):
    """What may happen beside the faults of devices."""

    ESTOP = "e-stop pressed"
    BUMPER = "bumper pressed"
    SHOVE = "base shoved"
    TILT = "rover tilted"
    SERVO = "servo error"
    REFILL = "tank refilled"
    TERMINATED = "told to end (SIGTERM)"
    KILLED = "killed at any moment"
    KILLED_IN_SHOT = "killed in a shot"
    CLOCK = "wall clock stepped"


WEIGHTS = {
    Kind.ESTOP: 3, Kind.BUMPER: 2, Kind.SHOVE: 3, Kind.TILT: 1, Kind.SERVO: 1, Kind.REFILL: 1, Kind.TERMINATED: 2,
    Kind.KILLED: 2, Kind.KILLED_IN_SHOT: 4, Kind.CLOCK: 4,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Mishap:
    """``at_s`` in the clock of the life. ``commands`` are done to the machine, each so many seconds after ``at_s``.

    ``shots`` and ``into_s``: the kill comes so long after the valve's coil went on for the so-manieth time.
    """

    kind: Kind
    at_s: float
    commands: tuple[tuple[float, c.WorldCommand], ...] = ()
    step_s: float = 0.0
    shots: int = 0
    into_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Misfortunes:
    """All of one life."""

    faults: tuple[Fault, ...] = ()
    mishaps: tuple[Mishap, ...] = ()

    def until(self, end_s: float, killed: bool) -> tuple[str, ...]:
        """The names of those that had come by ``end_s``; a kill is one only where it was."""
        faults = [f"{fault.device}:{fault.verb}" for fault in self.faults if fault.start_s <= end_s]
        kinds = [mishap.kind for mishap in self.mishaps if mishap.at_s <= end_s or mishap.kind is Kind.KILLED_IN_SHOT]
        return (*faults, *(str(kind) for kind in kinds if killed or kind is not Kind.KILLED_IN_SHOT))

    @property
    def plan(self) -> FaultPlan:
        return FaultPlan(self.faults)


def draw(rng: np.random.Generator) -> Misfortunes:
    """The misfortunes of the next life; often none."""
    faults = tuple(_fault(rng) for _ in range(rng.poisson(MEAN_FAULTS)))
    mishaps = tuple(_mishap(rng) for _ in range(rng.poisson(MEAN_MISHAPS)))
    return Misfortunes(faults, mishaps)


def _fault(rng: np.random.Generator) -> Fault:
    device = str(rng.choice(DEVICES))
    verbs = VALVE_VERBS if device == "valve" else tuple(Verb)
    verb = Verb(str(rng.choice([str(verb) for verb in verbs if verb is not Verb.OK])))
    low_s, high_s = LENGTHS_S[rng.integers(len(LENGTHS_S))]
    start_s = 0.0 if rng.random() < AT_BOOT_SHARE else float(rng.uniform(0.0, LIFE_S))
    return Fault(device, verb, round(start_s, 3), round(float(rng.uniform(low_s, high_s)), 3))


def _mishap(rng: np.random.Generator) -> Mishap:
    kinds = list(WEIGHTS)
    weights = np.array([WEIGHTS[kind] for kind in kinds], dtype=np.float64)
    kind = kinds[rng.choice(len(kinds), p=weights / weights.sum())]
    at_s = round(float(rng.uniform(0.5, LIFE_S)), 3)
    match kind:
        case Kind.ESTOP:  # often let go of again before anybody resets anything
            done = [(0.0, c.WorldEstop(True))]
            if rng.random() < 0.5:
                done.append((float(rng.uniform(0.05, 3.0)), c.WorldEstop(False)))
            return Mishap(kind, at_s, tuple(done))
        case Kind.BUMPER:
            free_s = float(rng.uniform(0.1, 3.0))
            return Mishap(kind, at_s, ((0.0, c.WorldBumper(True)), (free_s, c.WorldBumper(False))))
        case Kind.SHOVE:
            x_m, y_m, turn_rad = rng.normal(0.0, (0.05, 0.02, 0.01))
            return Mishap(kind, at_s, ((0.0, c.WorldPush(float(x_m), float(y_m), float(turn_rad))),))
        case Kind.TILT:
            roll_rad = float(rng.uniform(-0.5, 0.5))
            done_s = float(rng.uniform(0.5, 5.0))
            return Mishap(kind, at_s, ((0.0, c.WorldTilt(roll_rad, 0.0)), (done_s, c.WorldTilt(0.0, 0.0))))
        case Kind.SERVO:
            joint, error = int(rng.integers(6)), int(rng.choice([0x04, 0x08, 0x20]))
            return Mishap(kind, at_s, ((0.0, c.WorldServoError(joint, error)),))
        case Kind.REFILL:
            return Mishap(kind, at_s, ((0.0, c.WorldRefill(float(rng.uniform(500.0, 9000.0)))),))
        case Kind.CLOCK:
            return Mishap(kind, at_s, step_s=float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(0.0, 6.0)))
        case Kind.KILLED_IN_SHOT:
            return Mishap(kind, at_s, shots=int(rng.integers(1, 12)), into_s=float(rng.uniform(0.0, 0.5)))
    return Mishap(kind, at_s)
