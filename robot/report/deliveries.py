"""Which opening of the true valve belongs to which row of the ledger, and which fruit it hit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivers.twin.truth_record import Delivered, TruthRecord
from robot.ledger import ShotRow
from robot.targets import Target

_EARLIEST_S, _LATEST_S = 0.0, 1.5
LEAST_SHARE = 0.25


@dataclass(frozen=True, slots=True)
class TargetDose:
    """All openings for one target: what was commanded, booked and truly delivered.

    ``fruit_id`` is the fruit that got most of it, None when none got a quarter; ``on_fruit_ml`` is what all fruits got.
    """

    target_id: int
    stop: int
    due_ml: float
    commanded_ml: float
    booked_ml: float
    delivered_ml: float
    on_fruit_ml: float
    fruit_id: int | None


def match_deliveries(shots: Sequence[ShotRow], truth: TruthRecord) -> Mapping[int, Delivered]:
    """The true opening of each pulse, by intent id. Pulses that never opened, or lie before the file, have none.

    Clocks start anew with each process, so runs and processes are aligned as the stamps fit best.
    """
    runs = sorted({shot.run_id for shot in shots})
    if not runs:
        return {}
    best: dict[int, Delivered] = {}
    for first_run in range(runs[0] - len(truth.processes) + 1, runs[-1] + 1):
        found: dict[int, Delivered] = {}
        for number, process in enumerate(truth.processes):
            mine = [shot for shot in shots if shot.run_id == first_run + number]
            found.update(_pair(mine, process.delivered))
        if len(found) > len(best):
            best = found
    return best


def _pair(shots: Sequence[ShotRow], openings: Sequence[Delivered]) -> dict[int, Delivered]:
    """The intent is written just before the valve opens: pair each opening with the last intent before it."""
    pairs: dict[int, Delivered] = {}
    for opening in openings:
        waited = [(opening.opened_t - shot.intent.stamp_s, shot.intent_id) for shot in shots]
        near = [(wait_s, number) for wait_s, number in waited if _EARLIEST_S <= wait_s <= _LATEST_S]
        if near:
            pairs[min(near)[1]] = opening
    return pairs


def target_doses(
    shots: Sequence[ShotRow], targets: Sequence[Target], deliveries: Mapping[int, Delivered]
) -> tuple[TargetDose, ...]:
    """One entry a target that the valve opened for, in the order of spraying."""
    known = {target.id for target in targets}
    by_target: dict[int, list[ShotRow]] = {}
    for shot in shots:
        if shot.intent.target_id in known and (shot.intent_id in deliveries or _booked_ml(shot) > 0.0):
            by_target.setdefault(shot.intent.target_id, []).append(shot)
    return tuple(_dose(target_id, pulses, deliveries) for target_id, pulses in by_target.items())


def _dose(target_id: int, pulses: Sequence[ShotRow], deliveries: Mapping[int, Delivered]) -> TargetDose:
    openings = [deliveries[shot.intent_id] for shot in pulses if shot.intent_id in deliveries]
    delivered_ml = sum(opening.ml for opening in openings)
    fruit_ml: dict[int, float] = {}
    for opening in openings:
        for fruit, ml in opening.fruit_ml.items():
            fruit_ml[fruit] = fruit_ml.get(fruit, 0.0) + ml
    fruit_id = max(fruit_ml, key=lambda fruit: (fruit_ml[fruit], -fruit)) if fruit_ml else None
    if fruit_id is not None and fruit_ml[fruit_id] < LEAST_SHARE * delivered_ml:
        fruit_id = None
    return TargetDose(
        target_id=target_id,
        stop=pulses[0].intent.stop,
        due_ml=pulses[0].intent.due_ml,
        commanded_ml=sum(shot.intent.dose_ml for shot in pulses),
        booked_ml=sum(_booked_ml(shot) for shot in pulses),
        delivered_ml=delivered_ml,
        on_fruit_ml=sum(fruit_ml.values()),
        fruit_id=fruit_id,
    )


def _booked_ml(shot: ShotRow) -> float:
    return shot.result.booked_ml if shot.result is not None else shot.intent.full_ml
