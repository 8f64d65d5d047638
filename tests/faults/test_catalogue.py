"""Every fault of the catalogue that can be simulated, injected into the simulated machine and held against its row."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from robot.safety.catalogue import CATALOGUE, FaultKind, Proof

from .scenarios import GROUPS, SCENARIOS, Scenario, Stage

ROOT = Path(__file__).parents[2]
KINDS = {kind.id: kind for kind in CATALOGUE}
CARDS = ROOT / "docs" / "test-cards"
SHOWN_ELSEWHERE = {
    "F30": ("tests/robot/test_stall.py", "test_a_blocked_loop_is_stopped_from_the_thread_and_told"),
    "F31": ("tests/e2e/test_manager.py", "test_a_process_that_stands_still_pets_nobody"),
    "F39": ("tests/robot/ledger/test_disk.py", "test_every_write_is_timed_and_a_slow_disk_is_named"),
    "F40": ("tests/robot/test_logs.py", "test_a_fault_that_repeats_ten_thousand_times_leaves_ten_lines"),
    "F70n": ("tests/robot/control/test_socket.py", "test_a_stop_comes_through_while_slow_clients_hold_on"),
}
"""What these need (threads, systemd's socket, slow disks, many clients) has its own place."""


def cases() -> list[Any]:
    return [
        pytest.param(kind, scenario, id=f"{kind.id} {kind.title}" + (f": {case}" if case else ""))
        for kind in CATALOGUE
        for case, scenario in SCENARIOS.get(kind.id, {}).items()
    ]


@pytest.mark.parametrize(("kind", "scenario"), cases())
def test_the_machine_does_in_time_what_the_catalogue_says(
    kind: FaultKind, scenario: Scenario, undisturbed, tmp_path, record_property
) -> None:
    seen = scenario(Stage(tmp_path, undisturbed))
    for name, value in (("fault", kind.id), ("after_s", seen.after_s), ("action", seen.action.name)):
        record_property(name, value)
    assert seen.action is kind.action
    assert 0.0 <= seen.after_s <= kind.within_s
    assert seen.kept


def shown_by(proof: Proof) -> list[FaultKind]:
    return [kind for kind in CATALOGUE if kind.proof is proof]


def number(kind: FaultKind) -> str:
    return kind.id


@pytest.mark.parametrize("kind", shown_by(Proof.SIMULATED), ids=number)
def test_every_fault_that_can_be_simulated_has_its_scenario(kind: FaultKind) -> None:
    if kind.id not in SHOWN_ELSEWHERE:
        assert SCENARIOS.get(kind.id), f"{kind.id} ({kind.title}) has no scenario"
        return
    file, test = SHOWN_ELSEWHERE[kind.id]
    if not (ROOT / file).exists():
        pytest.skip(f"{kind.id} is shown by {file}, which is not here yet")
    assert f"def {test}" in (ROOT / file).read_text()


def test_no_scenario_is_without_its_row() -> None:
    assert sorted({fault_id for group in GROUPS for fault_id in group} - set(KINDS)) == []
    assert sum(len(group) for group in GROUPS) == len(SCENARIOS), "a fault has scenarios in two groups"
    assert set(SHOWN_ELSEWHERE).isdisjoint(SCENARIOS)
    assert set(SHOWN_ELSEWHERE) <= set(KINDS)


def numbers_on_cards() -> set[str]:
    return {number for card in CARDS.glob("*.md") for number in re.findall(r"\bF\d\d[a-z]?\b", card.read_text())}


@pytest.mark.parametrize("kind", shown_by(Proof.CARD), ids=number)
def test_every_fault_that_needs_the_machine_stands_on_a_card(kind: FaultKind) -> None:
    assert kind.id in numbers_on_cards(), f"no card in {CARDS} names {kind.id} ({kind.title})"


def test_every_number_on_a_card_is_in_the_catalogue() -> None:
    assert sorted(numbers_on_cards() - set(KINDS)) == []
