"""``sprayer calibrate flow``: a catch test at several pulse lengths, and the flow model that follows from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from robot.commands.by_hand import HandCommand, HandOptions, by_hand
from robot.commands.spray import YesOption
from robot.commands.terminal import Answers
from robot.config import Config
from robot.dosing import Catch, CatchFit, fit_catches, meter_ml_per_pulse
from robot.dosing.catch_test import LEAST_LENGTHS
from robot.errors import SprayerError, UsageError
from robot.ledger import Outcome
from robot.mission.settings import DoseSettings
from robot.runtime.manual import ByHand
from robot.runtime.manual.liquid import LiquidByHand
from robot.runtime.settings import dose_settings
from robot.toml_values import difference, read_toml_text, with_numbers, write_toml_text

LENGTHS = 5
SHORTEST_S, LONGEST_S = 0.1, 2.0
HEADROOM = 0.93          # of a cap: pressure and valve may give a little more than the model says
BOARD_EXTRA_S = 0.1      # the board's own timer may be so much longer than the opening
MOST_PULSES = 50
WORN_SHARE = 0.10        # a nozzle that gives so much more or less than its size says is worn or clogged
METER_SHARE = 0.02


class BadCatch(SprayerError):
    """The catches do not make a calibration."""


@dataclass(frozen=True, slots=True)
class _Test:
    """The cups to fill: pulse lengths, and how many pulses each."""

    open_s: tuple[float, ...]
    pulses: int


@by_hand
def calibrate_flow(
    options: HandOptions,
    open_s: Annotated[
        list[float] | None, typer.Option("--open-s", metavar="S", help="A pulse length; give four or more of them.")
    ] = None,
    pulses: Annotated[int, typer.Option("--pulses", min=1, max=MOST_PULSES, help="Pulses in each cup.")] = LENGTHS,
    density: Annotated[
        float | None, typer.Option("--density", metavar="G_ML", help="Cups are weighed; grams of a millilitre.")
    ] = None,
    write: Annotated[
        Path | None, typer.Option("--write", metavar="FILE", help="Put the values into this configuration file.")
    ] = None,
    yes: YesOption = False,
) -> int:
    """Spray into a cup at several pulse lengths, ask what was caught, and fit the nozzle's flow and the valve's lag."""
    command = HandCommand(options)
    config = command.config
    if density is not None and not (math.isfinite(density) and 0.5 <= density <= 2.0):
        raise UsageError(f"--density {density:g}: expected grams of a millilitre, 0.5 to 2; water has 1")
    dose = dose_settings(config)
    test = _Test(_lengths(config, dose, open_s), pulses)
    total_ml = pulses * sum(dose.flow.volume_ml(each_s, dose.flow.pressure_bar) for each_s in test.open_s)
    if total_ml > min(config.task.label_cap_ml, config.task.tank_fill_ml - config.fluid.tank_reserve_ml):
        raise UsageError(f"the test takes about {total_ml:.0f} ml, more than label and tank allow; lower --pulses")
    if write is not None:
        _with_values(write, _values(config, dose.flow.flow_ml_s, dose.flow.open_latency_s, dose.flow.close_latency_s))
    command.confirm(
        "yes",
        f"{len(test.open_s)} cups, {pulses} pulses each, about {total_ml:.0f} ml of {config.task.product} in all. "
        "Put the empty cup under the nozzle.",
        always=True,
        yes=yes,
    )
    cups: list[Catch] = []

    async def act(hands: ByHand) -> None:
        liquid = LiquidByHand(hands)
        await hands.record(f"calibrate flow, {len(test.open_s)} x {pulses} pulses")
        for number, each_s in enumerate(test.open_s, start=1):
            pressure_bar, counted_ml = await _fill(hands, liquid, each_s, pulses)
            prompt = f"cup {number} of {len(test.open_s)}, {pulses} x {each_s:.3f} s: "
            caught_ml = await _caught(command.answers, prompt, density)
            cups.append(Catch(each_s, pulses, caught_ml, pressure_bar, counted_ml))

    command.live(act)
    try:
        fit = fit_catches(cups, config.fluid.nozzle_pressure_bar, config.fluid.valve_close_s)
    except ValueError as error:
        raise BadCatch(f"no calibration: {error}; nothing was written") from error
    Console().print(_table(cups, fit))
    model = fit.flow.model
    values = _values(config, model.flow_ml_s, model.open_latency_s, model.close_latency_s)
    for line in _summary(config, cups, fit, values):
        command.say(line)
    if write is not None:
        before = read_toml_text(write)
        after = _with_values(write, values)
        command.say(difference(before, after, str(write)) or f"{write}: holds these values already")
        write_toml_text(write, after)
        command.say(f"written: {write}")
    return 0


async def _fill(hands: ByHand, liquid: LiquidByHand, open_s: float, pulses: int) -> tuple[float, float | None]:
    """One cup; the mean pressure before its pulses, and what the flow meter counted."""
    pressures_bar: list[float] = []
    counted_ml: float | None = 0.0
    for _ in range(pulses):
        result = await liquid.pulse(open_s)
        if result.outcome is not Outcome.SPRAYED:
            raise BadCatch(f"a pulse of {open_s:.3f} s ended {result.outcome}: {result.reason}; begin again")
        pressures_bar.append(liquid.shot_pressure_bar)
        if counted_ml is not None:
            counted_ml = None if result.measured_ml is None else counted_ml + result.measured_ml
    await liquid.rest()
    return sum(pressures_bar) / pulses, counted_ml


async def _caught(answers: Answers, prompt: str, density: float | None) -> float:
    """Millilitres of a cup, as typed or weighed. Asked again at a terminal; ``UsageError`` for a bad line of a pipe."""
    unit = "ml" if density is None else "g"
    while True:
        text = await answers.ask(f"{prompt}caught {unit}? (then put the empty cup back) ")
        try:
            figure = float(text.replace(",", "."))
        except ValueError:
            figure = math.nan
        if math.isfinite(figure) and figure > 0.0:
            return figure / (density or 1.0)
        if not answers.from_terminal or answers.ended:
            raise UsageError(f"{prompt}expected {unit} above 0, found {text!r}; nothing was written")


def _lengths(config: Config, dose: DoseSettings, given_s: Sequence[float] | None) -> tuple[float, ...]:
    """Pulse lengths, shortest first: those given, or evenly from the shortest to the longest that the caps allow."""
    shortest_s, longest_s = dose.pulses.min_s, dose.pulses.max_s
    shot_ml = HEADROOM * config.safety.max_shot_ml
    target_s = dose.flow.open_s(HEADROOM * config.safety.max_target_ml / dose.full_factor, dose.flow.pressure_bar)
    longest_s = min(
        longest_s - BOARD_EXTRA_S,
        dose.flow.open_s(shot_ml, dose.flow.pressure_bar),
        target_s - BOARD_EXTRA_S - dose.full_extra_s,
    )
    if given_s:
        for each_s in given_s:
            if not shortest_s <= each_s <= longest_s:
                raise UsageError(f"--open-s {each_s:g}: dosing and caps allow {shortest_s:g} to {longest_s:.3f} s")
        if len(set(given_s)) < LEAST_LENGTHS:
            raise UsageError(f"--open-s: expected {LEAST_LENGTHS} pulse lengths or more, found {len(set(given_s))}")
        return tuple(sorted(set(given_s)))
    first_s, last_s = max(SHORTEST_S, shortest_s), min(LONGEST_S, longest_s)
    return tuple(round(first_s + (last_s - first_s) * k / (LENGTHS - 1), 3) for k in range(LENGTHS))


def _values(config: Config, flow_ml_s: float, open_s: float, close_s: float) -> dict[str, float]:
    """The keys of [fluid]; those whose value stays as configured are left out."""
    fluid = config.fluid
    values = {"nozzle_flow_ml_s": round(flow_ml_s, 3), "valve_open_s": round(open_s, 4)}
    if round(close_s, 4) != round(fluid.valve_close_s, 4):
        values["valve_close_s"] = round(close_s, 4)
    return values


def _with_values(path: Path, values: dict[str, float]) -> str:
    return with_numbers(read_toml_text(path), "fluid", values, str(path))


def _table(cups: Sequence[Catch], fit: CatchFit) -> Table:
    table = Table(title="Catch test")
    for column in ("pulses", "open, s", "caught, ml", "a pulse, ml", "beside the line, ml", "meter, ml", "bar"):
        table.add_column(column, justify="right")
    for cup, residual_ml in zip(sorted(cups, key=lambda cup: cup.open_s), fit.flow.residual_ml, strict=True):
        counted = "none" if cup.counted_ml is None else f"{cup.counted_ml:.2f}"
        table.add_row(
            str(cup.pulses), f"{cup.open_s:.3f}", f"{cup.caught_ml:.2f}", f"{cup.pulse_ml:.3f}", f"{residual_ml:+.3f}",
            counted, f"{cup.pressure_bar:.2f}",
        )  # fmt: skip
    return table


def _summary(config: Config, cups: Sequence[Catch], fit: CatchFit, values: dict[str, float]) -> list[str]:
    fluid, flow = config.fluid, fit.flow
    lines = [
        f"flow {flow.model.flow_ml_s:.3f} ml/s (one sigma {flow.flow_sigma_ml_s:.3f}) at {fluid.nozzle_pressure_bar:g}"
        f" bar, dead time {1000 * flow.dead_time_s:.1f} ms (one sigma {1000 * flow.dead_time_sigma_s:.1f}),"
        f" r2 {fit.r2:.5f}, rms {flow.rms_ml:.3f} ml",
    ]
    off = flow.model.flow_ml_s / fluid.nozzle_flow_ml_s - 1.0
    if abs(off) > WORN_SHARE:
        lines.append(f"the nozzle gives {off:+.0%} against the configuration: is it the right size, worn, or clogged?")
    pulse_ml = meter_ml_per_pulse(cups, fluid.meter_ml_per_pulse)
    if pulse_ml is not None:
        share = fluid.meter_ml_per_pulse / pulse_ml - 1.0
        advice = f"; meter_ml_per_pulse = {pulse_ml:.4f} would agree" if abs(share) > METER_SHARE else ""
        lines.append(f"flow meter: counted {share:+.1%} against what was caught{advice}")
    lines.append("a catch tells only the difference of valve_open_s and valve_close_s; put in the configuration:")
    lines.append("[fluid]")
    return [*lines, *(f"{key} = {value!r}" for key, value in values.items())]
