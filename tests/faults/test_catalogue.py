"""Every fault of the catalogue that can be simulated, injected into the simulated machine and held against its row."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot.safety.catalogue import CATALOGUE, FaultKind, Proof

from .scenarios import GROUPS, SCENARIOS, Scenario, Stage

KINDS = {kind.id: kind for kind in CATALOGUE}
CARDS = Path(__file__).parents[2] / "docs" / "test-cards"


def _cases() -> Iterator[object]:
    for kind in CATALOGUE:
        for case, scenario in SCENARIOS.get(kind.id, {}).items():
            yield pytest.param(kind, scenario, id=f"{kind.id} {kind.title}" + (f": {case}" if case else ""))


@pytest.mark.parametrize(("kind", "scenario"), list(_cases()))
def test_the_machine_does_in_time_what_the_catalogue_says(
    kind: FaultKind, scenario: Scenario, undisturbed, tmp_path, record_property
) -> None:
    seen = scenario(Stage(tmp_path, undisturbed))
    for name, value in (("fault", kind.id), ("after_s", seen.after_s), ("action", seen.action.name)):
        record_property(name, value)
    assert seen.action is kind.action
    assert 0.0 <= seen.after_s <= kind.within_s
    assert seen.kept
