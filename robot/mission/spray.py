"""SPRAY: one target, one dose, booked."""

from __future__ import annotations

import math

from robot import dosing
from robot.actuation import PulseOrder, Refused
from robot.dosing import Refusal, Shot
from robot.ledger.values import Outcome, Result
from robot.mission.context import MissionContext
from robot.mission.events import ShotDone, TargetSkipped
from robot.mission.settings import DoseSettings
from robot.mission.transitions import Event
from robot.targets import Target, TargetState


async def spray(context: MissionContext) -> Event:
    """SPRAYED when the valve was open for this target, however long; SKIPPED with the reason when it was not.

    Cancelled, the pulse under way is cut, booked, and the ledger's reader knows the target's fate from its shots.
    """
    target_id = context.progress.aimed
    if target_id is None:
        raise RuntimeError("SPRAY was entered without a target under the nozzle")
    context.progress.aimed = None
    target = context.target(target_id)
    reading = context.actuation.sensors
    pressure_bar = reading.pressure_bar if reading is not None else float("nan")
    settings = context.settings.dose
    shot = _planned(target, settings, pressure_bar)
    if isinstance(shot, Refusal):
        await _skip(context, target_id, shot.reason)
        return Event.SKIPPED
    results: list[Result] = []
    try:
        for number in range(len(shot.open_s)):
            order = _order(context, target, shot, number, pressure_bar)
            results.append(await context.actuation.spray(order))
    except Refused as refused:
        if not results:
            await _skip(context, target_id, str(refused))
            return Event.SKIPPED
        await _book(context, target_id, shot, results, f"part of the dose was refused: {refused}")
        return Event.SPRAYED
    await _book(context, target_id, shot, results, "")
    return Event.SPRAYED


def _planned(target: Target, settings: DoseSettings, pressure_bar: float) -> Shot | Refusal:
    due = dosing.due(target, settings.rules)
    if isinstance(due, Refusal):
        return due
    return dosing.plan(due, settings.rules.law, settings.flow, pressure_bar, settings.pulses, settings.caps)


def _order(context: MissionContext, target: Target, shot: Shot, number: int, pressure_bar: float) -> PulseOrder:
    settings = context.settings.dose
    open_s = shot.open_s[number]
    pulse_s = context.actuation.board_pulse_s(open_s)
    return PulseOrder(
        target_id=target.id,
        stop=context.progress.stop,
        number=number + 1,
        due_ml=shot.due_ml,
        dose_ml=shot.dose_ml / len(shot.open_s),
        model_ml=settings.flow.volume_ml(open_s, pressure_bar),
        open_s=open_s,
        pulse_s=pulse_s,
        full_ml=full_pulse_ml(settings, pulse_s, pressure_bar),
        factor=shot.factor,
        reason=shot.reason,
        cell=cell_of(target),
    )


def cell_of(target: Target) -> tuple[int, int]:
    """The square metre of the row frame in which a target stands."""
    x_m, y_m, _ = target.centre_m
    return math.floor(x_m), math.floor(y_m)


def full_pulse_ml(settings: DoseSettings, pulse_s: float, pressure_bar: float) -> float:
    """An upper bound of what the board's whole pulse can give, whatever valve, nozzle and pump deviate by."""
    pressure = max(pressure_bar, settings.flow.pressure_bar)
    return settings.full_factor * settings.flow.volume_ml(pulse_s + settings.full_extra_s, pressure)


async def _book(context: MissionContext, target_id: int, shot: Shot, results: list[Result], problem: str) -> None:
    booked_ml = sum(result.booked_ml for result in results)
    reasons = "; ".join(filter(None, (problem, *(result.reason for result in results))))
    if all(result.outcome is Outcome.NOT_OPENED for result in results):
        await _skip(context, target_id, reasons)
        return
    whole = not problem and all(result.outcome is Outcome.SPRAYED for result in results)
    await context.set_state(target_id, TargetState.SPRAYED if whole else TargetState.UNCERTAIN, reasons)
    context.publish(ShotDone(target_id, context.progress.stop, shot.dose_ml, booked_ml, context.now_s()))


async def _skip(context: MissionContext, target_id: int, reason: str) -> None:
    await context.set_state(target_id, TargetState.OPEN, reason)
    context.publish(TargetSkipped(target_id, context.progress.stop, reason))
