"""The person with the machine: takes a while, puts right what is wrong with it, and starts it again."""

from __future__ import annotations

import numpy as np

from drivers.twin import commands as c
from drivers.twin.machine import Twin
from robot.safety import Mode
from robot.soak.life import LifeEnd

RESTART_S = (3.0, 8.0)        # the service manager, where nobody is needed
TROUBLE_S = (60.0, 600.0)     # until somebody has come, looked, and acknowledged
NEXT_ROW_S = (300.0, 780.0)   # to the next row, with the tank filled again
LEAST_TANK_ML = 3000.0
MOST_TRIES = 6                # at one row that never gets done: then it is left


class Operator:
    """Draws how long everything takes from ``rng``."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._tries = 0

    def patience_left(self, end: LifeEnd) -> bool:
        """Whether to try the same row once more."""
        self._tries += not end.killed
        return self._tries < MOST_TRIES

    def turns_to_next_row(self) -> float:
        """How long it takes to be there, in seconds."""
        self._tries = 0
        return float(self._rng.uniform(*NEXT_ROW_S))

    def waits_s(self, end: LifeEnd) -> float:
        """Until the machine is started again before the same row."""
        alone = end.killed or (end.result is not None and end.result.mode is Mode.DISARMED)
        return float(self._rng.uniform(*(RESTART_S if alone else TROUBLE_S)))

    def puts_right(self, twin: Twin, end: LifeEnd) -> None:
        """Button released, rover level, servos reset, tank filled: whatever is found wrong. Nothing after a restart
        that nobody attends."""
        if end.killed:
            return
        now_s = twin.now_s
        for command in (c.WorldEstop(False), c.WorldBumper(False), c.WorldTilt(0.0, 0.0)):
            twin.apply(now_s, command)
        for joint, error in enumerate(twin.physics.servos.errors):
            if error:
                twin.apply(now_s, c.WorldServoError(joint, 0))
        if twin.physics.tank_ml < LEAST_TANK_ML:
            twin.apply(now_s, c.WorldRefill(twin.nominal.tank_fill_ml))
