"""From the simulated machine's truth and from the ledger: which action a fault had, and when."""

from __future__ import annotations

import math

from robot import safety
from robot.mission import State
from robot.safety.catalogue import Action
from robot.safety.timing import CLOSE_DEADLINE_S, CLOSE_TRIES
from tests.robot.mission.rover import Run
from tests.robot.mission.truths import (
    last_process,
    motions_asked_after,
    openings,
    openings_asked_after,
    valve_pulses,
)

from .values import Seen

VALVE_LAG_S = 0.06  # closing latency of the valve and its deviation
LETTING_GO_S = 4 * CLOSE_TRIES * CLOSE_DEADLINE_S  # the longest way through the stop of a machine that does not answer
ACTIONS = {
    safety.Mode.PAUSED: Action.PAUSE, safety.Mode.SAFE_STOP: Action.SAFE_STOP, safety.Mode.ESTOP: Action.ESTOP,
}  # fmt: skip


def judged(run: Run, at_s: float, *words: str, kept: str = "every millilitre", leaked_ml: float = 0.0,
           longest_s: float | None = None, least: Action = Action.PAUSE) -> Seen:  # fmt: skip
    """The action that the machine took after ``at_s``, shown to be whole; all ``words`` were told.

    ``leaked_ml`` may be missing in the ledger: what left a valve that does not obey its coil. ``longest_s`` is how long
    the valve may have been open, when it was not the robot that opened it. The action is the first that is at ``least``
    so severe.
    """
    for word in words:
        assert word in run.said, run.said
    is_accounted_for(run, leaked_ml)
    severe = {mode for mode, action in ACTIONS.items() if action >= least}
    taken = next((item for item in run.modes if item.mode in severe and item.stamp_s >= at_s - 1e-6), None)
    if taken is None:
        assert run.result.state is State.DONE, run.said
        assert run.result.mode is safety.Mode.DISARMED
        told_s = min((trouble.stamp_s for trouble in run.troubles if trouble.stamp_s >= at_s - 1e-6), default=math.nan)
        return Seen(Action.WARN, told_s - at_s, kept)
    if taken.mode is safety.Mode.PAUSED:
        rests(run, taken.stamp_s, next((m.stamp_s for m in run.modes if m.stamp_s > taken.stamp_s), math.inf))
    else:
        assert run.result.mode is taken.mode
        assert run.result.state is State.IDLE
        rests(run, taken.stamp_s)
        assert run.last_s - taken.stamp_s <= LETTING_GO_S
        ends_safe(run, longest_s)
    return Seen(ACTIONS[taken.mode], taken.stamp_s - at_s, kept)


def rests(run: Run, from_s: float, until_s: float = math.inf) -> None:
    """Nothing that moves or opens is asked for meanwhile."""
    process = last_process(run)
    assert [t for t in openings_asked_after(process, from_s) if t < until_s] == []
    assert [t for t in motions_asked_after(process, from_s) if t < until_s] == []


def ends_safe(run: Run, longest_s: float | None = None) -> None:
    """Once every timer has run out: valve shut, pump off, and no opening was longer than its pulse."""
    after = run.run_on()
    assert not after.valve_open
    assert not after.physics.hydraulics.pump_on
    process = last_process(run)
    if longest_s is None:
        longest_s = max((pulse.duration_s for pulse in valve_pulses(process)), default=0.0)
    assert all(end - start <= longest_s + VALVE_LAG_S for start, end in openings(process) if end < math.inf)


def is_accounted_for(run: Run, leaked_ml: float = 0.0) -> None:
    """Every intent has its outcome, and the ledger's sum is not below what left the nozzle."""
    assert run.dangling == 0
    assert all(shot.result is not None for shot in run.shots)
    assert run.totals.booked_ml + leaked_ml >= run.run_on().dispensed_ml


def shut_after_s(run: Run, at_s: float) -> float:
    """From ``at_s``, at which the valve was open, until it was truly shut."""
    return next(end for start, end in openings(last_process(run)) if start <= at_s < end) - at_s
