"""``sprayer spray``: a dose by hand, confirmed, capped and in the ledger."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from robot.commands.by_hand import HandCommand, HandOptions, by_hand
from robot.errors import UsageError
from robot.ledger import LedgerReader, Outcome, ShotRow
from robot.runtime import ledger_path
from robot.runtime.manual import ByHand
from robot.runtime.manual.liquid import LiquidByHand, dose_problem
from robot.runtime.settings import dose_settings

MOST_TIMES = 100

YesOption = Annotated[bool, typer.Option("--yes", help="Do not ask (simulation only).")]


@by_hand
def spray(
    options: HandOptions,
    ml: Annotated[float, typer.Option("--ml", metavar="ML", help="Millilitres of one dose.")],
    times: Annotated[int, typer.Option("--times", metavar="K", min=1, max=MOST_TIMES, help="So many doses.")] = 1,
    yes: YesOption = False,
) -> int:
    """Spray where the nozzle points. The pump is brought up to pressure first."""
    command = HandCommand(options)
    config = command.config
    problem = dose_problem(config, dose_settings(config), ml)
    if problem:
        raise UsageError(f"--ml: {problem}")
    most_ml = min(config.task.label_cap_ml, config.task.tank_fill_ml - config.fluid.tank_reserve_ml)
    if ml * times > most_ml:
        raise UsageError(f"{times} times {ml:g} ml: label and tank allow {most_ml:g} ml in all; spray less")
    what = f"{times} x {ml:g} ml" if times > 1 else f"{ml:g} ml"
    command.confirm(
        "yes", f"The nozzle is about to spray {what} of {config.task.product} where it points.", always=True, yes=yes
    )
    tasks: list[int] = []

    async def act(hands: ByHand) -> None:
        liquid = LiquidByHand(hands)
        tasks.append(liquid.task_id)
        await hands.record(f"spray {what}")
        for _ in range(times):
            await liquid.dose(ml)
        await liquid.rest()

    try:
        command.live(act)
    finally:
        shots = shots_of(command.folder, tasks)
        for line in dose_lines(shots, ml, times):
            command.say(line)
    whole = [shot for shot in shots if shot.result is not None and shot.result.outcome is Outcome.SPRAYED]
    return 0 if len(whole) == len(shots) else 1


def shots_of(folder: Path, tasks: list[int]) -> tuple[ShotRow, ...]:
    """What the ledger holds of a session's task; () when none was begun."""
    if not tasks:
        return ()
    with LedgerReader.open_read_only(ledger_path(folder)) as ledger:
        return ledger.shots(tasks[0])


def dose_lines(shots: tuple[ShotRow, ...], ml: float, times: int) -> list[str]:
    """A line a dose (commanded, booked, measured), and one for those that were not begun."""
    lines: list[str] = []
    by_dose: dict[int, list[ShotRow]] = {}
    for shot in shots:
        by_dose.setdefault(shot.intent.target_id, []).append(shot)
    for number, pulses in by_dose.items():
        results = [shot.result for shot in pulses if shot.result is not None]
        booked_ml = sum(shot.result.booked_ml if shot.result else shot.intent.full_ml for shot in pulses)
        counted = [result.measured_ml for result in results]
        measured = "nothing" if None in counted or not counted else f"{sum(filter(None, counted)):.2f} ml"
        outcomes = ", ".join(dict.fromkeys(str(result.outcome) for result in results)) or "no outcome"
        reasons = "; ".join(dict.fromkeys(result.reason for result in results if result.reason))
        line = f"dose {number} of {times}: commanded {ml:.2f} ml, booked {booked_ml:.2f} ml, measured {measured}"
        lines.append(f"{line} ({outcomes}{': ' if reasons else ''}{reasons})")
    if len(by_dose) < times:
        lines.append(f"not begun: {times - len(by_dose)} of {times}")
    return lines
