"""Spraying by hand: pressure first, each dose a target of its own, every millilitre in the ledger."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from drivers.errors import DeviceTimeout
from robot import dosing
from robot.actuation import LEDGER_WRITE_S, PulseOrder, Refused
from robot.clock import work
from robot.config import Config
from robot.dosing import DoseLaw, Due, LawKind, PulseLimits, Refusal
from robot.ledger.values import Outcome, Result
from robot.mission.settings import DoseSettings
from robot.mission.spray import full_pulse_ml
from robot.runtime.manual.arm import nozzle_in_base, settle
from robot.runtime.manual.session import ByHand
from robot.runtime.resuming import BY_HAND, given_before
from robot.safety.timing import MINUTE_S
from robot.targets import Target, TargetState
from robot.vision.values import Ripeness

NO_FRUIT_M = 0.001       # a target needs a size, and this is no fruit's
LONGEST_HEADED_S = 5.0   # the pump does not work against a shut valve for longer while the minute's cap is waited for


def dose_problem(config: Config, dose: DoseSettings, ml: float) -> str:
    """Why a dose of ``ml`` cannot be given by hand, "" when it can."""
    if not (math.isfinite(ml) and ml > 0.0):
        return f"expected millilitres above 0, found {ml:g}"
    for name, cap_ml in (
        ("safety.max_shot_ml", config.safety.max_shot_ml),
        ("safety.max_target_ml", config.safety.max_target_ml),
        ("dosing.max_ml", config.dosing.max_ml),
    ):
        if ml > cap_ml:
            return f"{ml:g} ml is over {name}, {cap_ml:g} ml; give less, or several with --times"
    planned = _plan(dose, ml, config.fluid.nozzle_pressure_bar)
    return planned.reason if isinstance(planned, Refusal) else ""


class LiquidByHand:
    """Opens a task of its own in the ledger; ``task_id`` names it. Doses are numbered from 1, each a target."""

    def __init__(self, hands: ByHand) -> None:
        self._hands, self._actuation = hands, hands.actuation
        sensors = hands.actuation.sensors
        assert sensors is not None  # the session began with a reading
        self._doses = 0
        self.shot_pressure_bar = math.nan  # as read before the last dose
        tank_ml = max(0.0, min(hands.task.tank_fill_ml, sensors.tank_level_ml))
        self.task_id = hands.ledger.begin_task(replace(hands.task, tank_fill_ml=tank_ml))
        given = given_before(hands.ledger, self.task_id, datetime.now(UTC), hands.now_s())
        self._actuation.begin_task(self.task_id, tank_ml, given)

    @property
    def pressure_bar(self) -> float:
        sensors = self._actuation.sensors
        return sensors.pressure_bar if sensors is not None else math.nan

    async def dose(self, ml: float) -> tuple[Result, ...]:
        """One dose in as many pulses as it takes. ``Refused`` before anything opened, or between two pulses."""
        settings = self._hands.settings.dose
        await self._ready(ml)
        planned = _plan(settings, ml, self.shot_pressure_bar)
        if isinstance(planned, Refusal):
            raise Refused(f"{ml:g} ml: {planned.reason}")
        return await self._open(planned.open_s, ml)

    async def pulse(self, open_s: float) -> Result:
        """One opening of ``open_s`` seconds, whatever that gives."""
        flow = self._hands.settings.dose.flow
        await self._ready(flow.volume_ml(open_s, flow.pressure_bar))
        (result,) = await self._open((open_s,), flow.volume_ml(open_s, self.shot_pressure_bar))
        return result

    async def rest(self) -> None:
        """The pump stops until the next dose."""
        await self._actuation.stop_pump()

    async def _ready(self, ml: float) -> None:
        await self._wait_for_the_minute(ml)
        await self._prime()
        await settle(self._hands)
        self._actuation.mark_frame()
        self.shot_pressure_bar = self.pressure_bar

    async def _wait_for_the_minute(self, ml: float) -> None:
        """Until the cap of a rolling minute leaves room for what a dose can give at the most."""
        flow, cap_ml = self._hands.settings.dose, self._hands.limits.max_minute_ml
        open_s = flow.flow.open_s(ml, flow.flow.pressure_bar)
        most_ml = 1.1 * full_pulse_ml(flow, self._actuation.board_pulse_s(open_s), flow.flow.pressure_bar)
        while True:
            now_s = self._hands.now_s()
            state = self._actuation.state
            young = [(b.stamp_s, b.ml) for b in state.bookings if b.pending or now_s - b.stamp_s < MINUTE_S]
            young += [(stamp_s, ml) for stamp_s, ml in state.given.recent if now_s - stamp_s < MINUTE_S]
            if not young or sum(ml for _, ml in young) + most_ml <= cap_ml:
                return
            wait_s = min(stamp_s for stamp_s, _ in young) + MINUTE_S - now_s + 0.01
            if wait_s > LONGEST_HEADED_S:
                self._hands.tell(f"waiting {wait_s:.0f} s: no more than {cap_ml:g} ml in a minute")
                await self.rest()
            await asyncio.sleep(wait_s)

    async def _prime(self) -> None:
        """Pump on, until the pressure is up; ``DeviceTimeout`` when it does not come."""
        settings = self._hands.settings
        await self._actuation.start_pump()
        try:
            async with asyncio.timeout(settings.pressure_timeout_s):
                while True:
                    if self.pressure_bar >= settings.pressure_ready_bar:
                        return
                    await asyncio.sleep(0.05)
        except TimeoutError:
            wanted = f"{settings.pressure_ready_bar:.2f} bar within {settings.pressure_timeout_s:g} s"
            remedy = "check tank, suction filter, pump and its relay"
            raise DeviceTimeout("pump", wanted, f"{self.pressure_bar:.2f} bar", remedy) from None

    async def _open(self, open_s: Sequence[float], ml: float) -> tuple[Result, ...]:
        """The pulses of one dose, on a target that stands for the place in front of the nozzle."""
        settings = self._hands.settings.dose
        self._doses += 1
        number = self._doses
        target = self._target(number)
        await self._write(target)
        results: list[Result] = []
        try:
            for place, each_s in enumerate(open_s, start=1):
                pulse_s = self._actuation.board_pulse_s(each_s)
                order = PulseOrder(
                    target_id=number, stop=0, number=place, due_ml=ml, dose_ml=ml / len(open_s),
                    model_ml=settings.flow.volume_ml(each_s, self.shot_pressure_bar), open_s=each_s, pulse_s=pulse_s,
                    full_ml=full_pulse_ml(settings, pulse_s, self.shot_pressure_bar),
                )  # fmt: skip
                results.append(await self._actuation.spray(order))
        finally:
            if results:
                await asyncio.shield(self._write(_with_fate(target, results, len(open_s))))
        return tuple(results)

    def _target(self, number: int) -> Target:
        nozzle_m, _ = nozzle_in_base(self._hands)
        return Target(
            id=number, centre_m=nozzle_m, covariance_m2=np.zeros((3, 3)), diameter_m=NO_FRUIT_M, diameter_sigma_m=0.0,
            ripeness=Ripeness.GREEN, ripeness_score=0.0, ripeness_weight=0.0, confidence=0.0, visible_fraction=0.0,
            measured=False, sightings=1, last_seen_s=self._hands.now_s(), state=TargetState.OPEN,
            reason=f"{BY_HAND}: no fruit",
        )  # fmt: skip

    async def _write(self, target: Target) -> None:
        ledger, task_id = self._hands.ledger, self.task_id
        await work(lambda: ledger.upsert_targets(task_id, [target]), LEDGER_WRITE_S)


def _plan(dose: DoseSettings, ml: float, pressure_bar: float) -> dosing.Shot | Refusal:
    law = DoseLaw(LawKind.FIXED, ml, ml, ml)
    pulses = PulseLimits(dose.pulses.min_s, dose.pulses.max_s)
    return dosing.plan(Due(ml), law, dose.flow, pressure_bar, pulses, dose.caps)


def _with_fate(target: Target, results: Sequence[Result], pulses: int) -> Target:
    opened = [result for result in results if result.outcome is not Outcome.NOT_OPENED]
    if not opened:
        return replace(target, state=TargetState.OPEN, reason=f"{BY_HAND}: {results[0].reason}")
    whole = len(results) == pulses and all(result.outcome is Outcome.SPRAYED for result in results)
    reasons = "; ".join(filter(None, (result.reason for result in results)))
    state = TargetState.SPRAYED if whole else TargetState.UNCERTAIN
    return replace(target, state=state, reason=f"{BY_HAND}: {reasons}".removesuffix(": "))
