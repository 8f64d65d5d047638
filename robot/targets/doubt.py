"""Which targets might be one and the same fruit: of two such, at most one is sprayed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from robot.targets.matching import BookParameters, separation
from robot.targets.values import Target, TargetState

_DOSED = (TargetState.SPRAYED, TargetState.UNCERTAIN)
_WAITING = (TargetState.OPEN, TargetState.UNREACHABLE)
_STILL_AS_GOOD = 0.7


def resolve(
    targets: Sequence[Target], seen: frozenset[int], fresh: frozenset[int], parameters: BookParameters
) -> tuple[Target, ...]:
    """Decide about the targets that a frame added (``fresh``) and the doubtful ones that it shows (in ``seen``).

    - Overlapping another fruit of the same frame: doubtful, it may be a second detection of that fruit.
    - Too near a dosed target that the frame does not show: doubtful, it may be that fruit, seen with an error.
    - Too near a waiting target that the frame does not show: the better seen of the two stands, the other is doubtful.
    - Else open: clear of all others, or seen beside its neighbour (two fruits of one frame are two fruits).
    """
    result = {target.id: target for target in targets}
    undecided = [t for t in targets if t.id in fresh or (t.id in seen and t.state is TargetState.DOUBTFUL)]
    if not undecided:
        return tuple(targets)
    undecided.sort(key=lambda t: (t.id in fresh, -_evidence(t), t.id))
    for target in undecided:
        result[target.id] = replace(target, state=TargetState.DOUBTFUL)
    apart = separation(undecided, targets, parameters)
    for row, target in enumerate(undecided):
        rivals: list[Target] = []
        for column, other in enumerate(targets):
            radii, metres = float(apart.radii[row, column]), float(apart.metres[row, column])
            if other.id == target.id or not _may_be_one(
                radii, metres, float(apart.sigmas[row, column]), other.id in seen, parameters
            ):
                continue
            rivals.append(result[other.id])
        reason = _doubt(target, rivals, seen)
        if reason:
            result[target.id] = replace(target, state=TargetState.DOUBTFUL, reason=reason)
            continue
        result[target.id] = replace(target, state=TargetState.OPEN, reason="")
        for rival in rivals:
            if rival.id not in seen and rival.state in _WAITING:
                result[rival.id] = replace(
                    rival, state=TargetState.DOUBTFUL, reason=f"may be target {target.id}, better seen"
                )
    return tuple(result[target.id] for target in targets)


def _may_be_one(radii: float, metres: float, sigmas: float, both_seen: bool, parameters: BookParameters) -> bool:
    """Whether two centres, so many radii sums, metres and standard deviations apart, may belong to one fruit."""
    if both_seen:
        return radii < parameters.overlap
    if radii < parameters.doubt:
        return True
    beyond_m = metres * (1.0 - parameters.doubt / radii)
    return beyond_m < parameters.doubt_margin_m and sigmas <= parameters.gate_sigma


def _doubt(target: Target, rivals: Sequence[Target], seen: frozenset[int]) -> str:
    for rival in rivals:
        if rival.state in _DOSED:
            return f"may be target {rival.id}, already {rival.state.value}"
        if rival.id in seen and rival.state is not TargetState.DOUBTFUL:
            return f"overlaps target {rival.id}"
        if rival.state in _WAITING and _evidence(target) < _STILL_AS_GOOD * _evidence(rival):
            return f"may be target {rival.id}, better seen"
    return ""


def _evidence(target: Target) -> float:
    return target.confidence * target.visible_fraction
