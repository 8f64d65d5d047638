"""What truly happened in a run, asked of the twin's record."""

from __future__ import annotations

import math
from collections.abc import Iterator

from drivers.relay.values import Channel
from drivers.twin.commands import ArmGoal, RelayPulse, WheelsDrive
from drivers.twin.truth_record import ProcessTruth, Snapshot, View

from .oracle import LEAST_VISIBLE
from .rover import Run


def last_process(run: Run) -> ProcessTruth:
    return run.truth.processes[-1]


def stop_errors_m(run: Run) -> list[float]:
    """How far the base truly stood from where each look was planned, in x and y; pairs only metered are no looks."""
    planned = [stop.record.planned_x_m for stop in run.evidence.stops]
    looks = {stop.record.stamp_s for stop in run.evidence.stops}
    views = [view for process in run.truth.processes for view in process.views if view.t in looks]
    return [math.hypot(view.base[0] - x_m, view.base[1]) for view, x_m in zip(views, planned, strict=True)]


def drive_starts(process: ProcessTruth) -> list[Snapshot]:
    """The machine at every command that changed the base's motion to other than standstill."""
    driven = {timed.t for timed in process.commands if _drives(timed.command)}
    return [state for state in process.states if state.t in driven]


def _drives(command: object) -> bool:
    return isinstance(command, WheelsDrive) and (command.speed_m_s != 0.0 or command.yaw_rate_rad_s != 0.0)


def openings(process: ProcessTruth) -> list[tuple[float, float]]:
    """When the valve was open, from and to; a last one that never shut runs to infinity."""
    spans: list[tuple[float, float]] = []
    for event in process.events:
        if event.what == "valve_opened":
            spans.append((event.t, math.inf))
        elif event.what == "valve_closed":
            spans[-1] = (spans[-1][0], event.t)
    return spans


def motions(process: ProcessTruth, part: str) -> list[tuple[float, float]]:
    """When ``base`` or ``arm`` moved: from the first command after a rest to the rest."""
    rests = [event.t for event in process.events if event.what == f"{part}_stopped"]
    spans: list[tuple[float, float]] = []
    for timed in process.commands:
        moves = isinstance(timed.command, ArmGoal) if part == "arm" else _drives(timed.command)
        if moves and not (spans and timed.t <= spans[-1][1]):
            spans.append((timed.t, min((t for t in rests if t > timed.t), default=math.inf)))
    return spans


def overlapping(ones: list[tuple[float, float]], others: list[tuple[float, float]]) -> list[tuple[float, float]]:
    return [(max(a, c), min(b, d)) for a, b in ones for c, d in others if max(a, c) < min(b, d)]


def openings_asked_after(process: ProcessTruth, t_s: float) -> list[float]:
    """Times of later commands that open the valve or run the pump."""
    return [timed.t for timed in process.commands if timed.t > t_s and isinstance(timed.command, RelayPulse)]


def valve_pulses(process: ProcessTruth) -> list[RelayPulse]:
    pulses = [timed.command for timed in process.commands if isinstance(timed.command, RelayPulse)]
    return [pulse for pulse in pulses if pulse.channel is Channel.VALVE]


def motions_asked_after(process: ProcessTruth, t_s: float) -> list[float]:
    """Times of later commands that set base or arm in motion."""
    return [
        timed.t for timed in process.commands
        if timed.t > t_s and (isinstance(timed.command, ArmGoal) or _drives(timed.command))
    ]  # fmt: skip


def sightings(run: Run) -> Iterator[tuple[int, int]]:
    """(true fruit, target that it was taken for) of every fruit of every frame."""
    views: dict[float, View] = {view.t: view for process in run.truth.processes for view in process.views}
    for frame in run.frames:
        seen = [fruit.id for fruit in views[frame.frame.stamp_s].fruits if min(fruit.visible) >= LEAST_VISIBLE]
        yield from zip(seen, frame.target_ids, strict=True)
