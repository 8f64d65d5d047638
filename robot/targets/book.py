"""The book of targets: fruits of many frames merged, so that each fruit of the row is sprayed once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from robot.targets.doubt import resolve
from robot.targets.matching import BookParameters, Match, assign
from robot.targets.merging import another_look, first_look
from robot.targets.sighting import Sighting
from robot.targets.values import Target, TargetState


@dataclass(frozen=True, slots=True)
class Book:
    """All targets by rising id. Immutable: every change gives a new book."""

    targets: tuple[Target, ...] = ()

    def __post_init__(self) -> None:
        ids = [target.id for target in self.targets]
        if any(b <= a for a, b in pairwise(ids)):
            raise ValueError(f"target ids must rise, found {ids}")

    def target(self, target_id: int) -> Target:
        """The target with this id; ``KeyError`` when there is none."""
        for target in self.targets:
            if target.id == target_id:
                return target
        raise KeyError(f"no target {target_id} in the book")

    def in_state(self, *states: TargetState) -> tuple[Target, ...]:
        return tuple(target for target in self.targets if target.state in states)

    def pending(self) -> tuple[Target, ...]:
        """Targets that may still be sprayed: open ones, and those that no stop so far could reach."""
        return self.in_state(TargetState.OPEN, TargetState.UNREACHABLE)


def book_of(targets: Iterable[Target]) -> Book:
    """A book of targets from elsewhere (a resumed ledger), in any order."""
    return Book(tuple(sorted(targets, key=lambda target: target.id)))


def with_state(book: Book, target_id: int, state: TargetState, reason: str) -> Book:
    """The book with one target's state and reason changed.

    ``KeyError`` for an unknown id; ``ValueError`` when a target that got, or may have got, a dose would be forgotten.
    """
    old = book.target(target_id)
    dosed = (TargetState.SPRAYED, TargetState.UNCERTAIN)
    if old.state in dosed and state not in dosed:
        raise ValueError(f"target {target_id} is {old.state.value}; it cannot become {state.value}")
    new = replace(old, state=state, reason=reason)
    return Book(tuple(new if target.id == target_id else target for target in book.targets))


def match(book: Book, sightings: Sequence[Sighting], parameters: BookParameters) -> tuple[Match, ...]:
    """The known targets that a frame shows, without changing the book (landmarks for the pose)."""
    return tuple(
        Match(i, book.targets[j].id, False, sightings[i].centre_m - book.targets[j].centre_m)
        for i, j in sorted(assign(sightings, book.targets, parameters))
    )


def observe(
    book: Book, sightings: Sequence[Sighting], stamp_s: float, parameters: BookParameters
) -> tuple[Book, tuple[Match, ...]]:
    """Take one frame into the book: merge what is known, add what is new, mark what might be a fruit already dosed.

    The matches come in the order of ``sightings``. Neither the book nor the ids of new targets depend on that order.
    ``ValueError`` for a sighting that is not finite or has no size.
    """
    _check(sightings)
    order = sorted(range(len(sightings)), key=lambda i: (*sightings[i].centre_m.tolist(), sightings[i].diameter_m))
    ordered = [sightings[i] for i in order]
    pairs = dict(assign(ordered, book.targets, parameters))
    known = {target.id: target for target in book.targets}
    next_id = max(known, default=0) + 1
    found: list[Match] = []
    for position, seen in enumerate(ordered):
        if position in pairs:
            old = book.targets[pairs[position]]
            known[old.id] = another_look(old, seen, stamp_s, parameters)
            found.append(Match(order[position], old.id, False, seen.centre_m - old.centre_m))
        else:
            known[next_id] = first_look(next_id, seen, stamp_s, parameters)
            found.append(Match(order[position], next_id, True, np.zeros(3)))
            next_id += 1
    fresh = frozenset(item.target_id for item in found if item.new)
    seen_ids = frozenset(item.target_id for item in found)
    targets = resolve(tuple(known[i] for i in sorted(known)), seen_ids, fresh, parameters)
    return Book(targets), tuple(sorted(found, key=lambda item: item.index))


def _check(sightings: Sequence[Sighting]) -> None:
    for index, seen in enumerate(sightings):
        figures = np.concatenate(
            [
                seen.centre_m.ravel(),
                seen.covariance_m2.ravel(),
                [seen.diameter_m, seen.diameter_sigma_m, seen.ripeness_score],
            ]
        )
        if not np.all(np.isfinite(figures)) or seen.diameter_m <= 0.0 or seen.diameter_sigma_m < 0.0:
            raise ValueError(f"sighting {index}: expected finite figures and a positive diameter, found {seen}")
