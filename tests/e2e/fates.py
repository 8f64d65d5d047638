"""What became of every true fruit of a simulated row, and why."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robot.commands.report import load_truth
from robot.ledger import LedgerReader
from robot.report import judge, read_evidence
from robot.runtime import ledger_path


@dataclass(frozen=True)
class Fate:
    """``state`` of the target that stood for the fruit ("unseen" when none did), its ``reason``, what it got."""

    state: str
    reason: str
    delivered_ml: float


@dataclass(frozen=True)
class RowFates:
    of_fruit: dict[int, Fate]
    commanded_ml: float
    delivered_ml: float
    booked_ml: float


def fates_of(folder: Path) -> RowFates:
    """Of a finished run in ``folder`` with its truth beside it."""
    truth = load_truth(folder / "truth.jsonl")
    with LedgerReader.open_read_only(ledger_path(folder)) as ledger:
        evidence = read_evidence(ledger)
    judged = judge(evidence, truth)
    target_of = {fruit: target for target, fruit in judged.fruit_of.items()}
    targets = {target.id: target for target in evidence.targets}
    got: dict[int, float] = {}
    for dose in judged.doses:
        if dose.fruit_id is not None:
            got[dose.fruit_id] = got.get(dose.fruit_id, 0.0) + dose.delivered_ml
    fates = {}
    for fruit in truth.fruits:
        target = targets.get(target_of.get(fruit.id, -1))
        state, reason = ("unseen", "") if target is None else (target.state.value, target.reason)
        fates[fruit.id] = Fate(state, reason, got.get(fruit.id, 0.0))
    commanded_ml = sum(dose.commanded_ml for dose in judged.doses)
    return RowFates(fates, commanded_ml, sum(item.ml for item in truth.delivered), evidence.totals.booked_ml)
