"""How well a row was sprayed, judged by the simulated greenhouse's truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from drivers.twin.truth_record import TrueFruit, TruthRecord
from robot.report.deliveries import TargetDose, match_deliveries, target_doses
from robot.report.evidence import Evidence
from robot.targets import Target, TargetState
from robot.vision.values import Ripeness

CLEARLY_VISIBLE = 0.6
_SAME_FRUIT = 0.75  # distance of target and true fruit in true radii ...
_SAME_FRUIT_FLOOR_M = 0.03  # ... or this, whichever is more


@dataclass(frozen=True, slots=True)
class Score:
    """The figures of a row. Fruits are the truth's, targets the robot's; percentages are of 100.

    ``visible`` fruits showed 0.6 of their outline to both eyes in one frame at least. ``reachable`` is None when nobody
    said which fruits are, ``treated`` when nobody said which ripeness is; ``sprayed_untreated`` are fruits of another
    ripeness that were sprayed all the same. ``on_fruit_percent`` is the share of all liquid that landed on fruit.
    Figures that there is nothing to compute from are None.
    """

    fruits: int
    visible: int
    reachable: int | None
    treated: int | None
    seen: int
    sprayed: int
    sprayed_of_wanted: int
    wanted: int
    sprayed_untreated: int
    sprayed_twice: int
    targets_sprayed: int
    phantoms: int
    skipped: Mapping[str, int]
    on_fruit_percent: float | None
    seconds_a_target: float | None
    delivered_vs_commanded_median_percent: float | None
    delivered_vs_commanded_p95_percent: float | None
    delivered_vs_due_median_percent: float | None
    position_error_median_mm: float | None
    position_error_p95_mm: float | None
    booked_ml: float
    pending_ml: float
    delivered_ml: float

    @property
    def wanted_percent(self) -> float | None:
        """Sprayed fruits of those clearly visible and, as far as that is known, reachable and to be treated."""
        return 100.0 * self.sprayed_of_wanted / self.wanted if self.wanted else None


@dataclass(frozen=True, slots=True)
class Judgement:
    """A score, with what it was made from: ``fruit_of`` target ids, and the doses in order of spraying."""

    score: Score
    fruit_of: Mapping[int, int]
    doses: tuple[TargetDose, ...]
    delivered_by_intent_ml: Mapping[int, float]
    visible: Mapping[int, float]


def judge(
    evidence: Evidence,
    truth: TruthRecord,
    reachable: frozenset[int] | None = None,
    due_ml: Callable[[float, Ripeness], float] | None = None,
) -> Judgement:
    """Compare the ledger with the truth.

    ``reachable`` are the ids of the fruits that the arm can reach from a stop; ``due_ml`` gives the dose that a fruit
    of a diameter in metres and a ripeness is due, 0 when it is not to be treated.
    """
    fruits = {fruit.id: fruit for fruit in truth.fruits}
    deliveries = match_deliveries(evidence.shots, truth)
    doses = target_doses(evidence.shots, evidence.targets, deliveries)
    fruit_of = match_targets(evidence.targets, truth.fruits)
    visible = _best_views(truth)
    clear = {fruit for fruit, share in visible.items() if share >= CLEARLY_VISIBLE}
    due = {} if due_ml is None else {f.id: due_ml(f.diameter_m, Ripeness(f.ripeness)) for f in truth.fruits}
    treated = fruits.keys() if due_ml is None else {number for number, ml in due.items() if ml > 0.0}
    wanted = clear & treated if reachable is None else clear & treated & reachable
    hits = Counter(dose.fruit_id for dose in doses if dose.fruit_id is not None)
    opened = [dose for dose in doses if dose.delivered_ml > 0.0]
    total_ml = sum(item.ml for item in truth.delivered)
    against_commanded = [abs(d.delivered_ml / d.commanded_ml - 1.0) for d in opened if d.commanded_ml > 0.0]
    against_due = [
        abs(dose.delivered_ml / due[dose.fruit_id] - 1.0)
        for dose in opened
        if dose.fruit_id is not None and due.get(dose.fruit_id, 0.0) > 0.0
    ]
    errors_m = [
        float(np.linalg.norm(target.centre_m - fruits[fruit_of[target.id]].centre_m))
        for target in evidence.targets
        if target.id in fruit_of
    ]
    score = Score(
        fruits=len(fruits),
        visible=len(clear),
        reachable=None if reachable is None else len(reachable),
        treated=None if due_ml is None else len(treated),
        seen=len(set(fruit_of.values())),
        sprayed=len(hits),
        sprayed_of_wanted=len(wanted & set(hits)),
        wanted=len(wanted),
        sprayed_untreated=len(set(hits) - treated),
        sprayed_twice=sum(count > 1 for count in hits.values()),
        targets_sprayed=len(doses),
        phantoms=sum(dose.fruit_id is None for dose in doses),
        skipped=skipped_by_reason(evidence.targets),
        on_fruit_percent=_percent(sum(truth.fruit_ml.values()), total_ml),
        seconds_a_target=seconds_a_target(evidence, len(doses)),
        delivered_vs_commanded_median_percent=_quantile(against_commanded, 50, 100.0),
        delivered_vs_commanded_p95_percent=_quantile(against_commanded, 95, 100.0),
        delivered_vs_due_median_percent=_quantile(against_due, 50, 100.0),
        position_error_median_mm=_quantile(errors_m, 50, 1000.0),
        position_error_p95_mm=_quantile(errors_m, 95, 1000.0),
        booked_ml=evidence.totals.booked_ml,
        pending_ml=evidence.totals.pending_ml,
        delivered_ml=total_ml,
    )
    by_intent_ml = {number: opening.ml for number, opening in deliveries.items()}
    return Judgement(score, fruit_of, doses, by_intent_ml, visible)


def match_targets(targets: Sequence[Target], fruits: Sequence[TrueFruit]) -> dict[int, int]:
    """Target id to fruit id, one to one, by least total distance within the fruit's size."""
    if not targets or not fruits:
        return {}
    centres: npt.NDArray[np.float64] = np.array([fruit.centre_m for fruit in fruits])
    distance_m = np.linalg.norm(np.array([target.centre_m for target in targets])[:, None] - centres[None], axis=2)
    limit_m = np.maximum(_SAME_FRUIT_FLOOR_M, _SAME_FRUIT * 0.5 * np.array([fruit.diameter_m for fruit in fruits]))
    near = distance_m <= limit_m[None, :]
    rows, columns = linear_sum_assignment(np.where(near, distance_m, 1e3))
    return {targets[int(r)].id: fruits[int(c)].id for r, c in zip(rows, columns, strict=True) if near[r, c]}


def skipped_by_reason(targets: Sequence[Target]) -> Mapping[str, int]:
    """How many targets got nothing, by state and reason (figures in a reason do not split it)."""
    left = [target for target in targets if target.state not in (TargetState.SPRAYED, TargetState.UNCERTAIN)]
    counts = Counter(_kind(target) for target in left)
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


def seconds_a_target(evidence: Evidence, sprayed: int) -> float | None:
    """Time from the first frame to the last shot, over all runs, for each target that was sprayed."""
    total_s = 0.0
    for run in evidence.runs:
        ends = [s.result.stamp_s for s in evidence.shots if s.run_id == run and s.result is not None]
        starts = [s.intent.stamp_s for s in evidence.shots if s.run_id == run]
        frames = [stop.record.stamp_s for stop in evidence.stops if stop.run_id == run]
        if ends:
            total_s += max(ends) - min(starts + frames)
    return total_s / sprayed if sprayed and total_s > 0.0 else None


def _kind(target: Target) -> str:
    words = [word for word in target.reason.split() if not any(letter.isdigit() for letter in word)]
    reason = " ".join(words) or ("not treated yet" if target.state is TargetState.OPEN else "")
    return target.state.value.replace("_", " ") + (f": {reason}" if reason else "")


def _best_views(truth: TruthRecord) -> dict[int, float]:
    best: dict[int, float] = {}
    for process in truth.processes:
        for view in process.views:
            for fruit in view.fruits:
                best[fruit.id] = max(best.get(fruit.id, 0.0), min(fruit.visible))
    return best


def _percent(part: float, whole: float) -> float | None:
    return 100.0 * part / whole if whole > 0.0 else None


def _quantile(values: Sequence[float], percent: float, scale: float) -> float | None:
    return scale * float(np.percentile(values, percent)) if values else None
