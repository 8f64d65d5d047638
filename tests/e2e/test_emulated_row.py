"""The demo row through production drivers only, in real time, against the mock run of the same seed."""

from __future__ import annotations

import pytest

from robot.cli import run_command
from robot.package_files import packaged
from tests.e2e.fates import Fate, RowFates, fates_of

SPRAYED = ("sprayed",)
ALIKE = 0.95
TOTAL_TOLERANCE = 0.05


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> tuple[RowFates, RowFates]:
    """(mock, emulated)."""
    folder = tmp_path_factory.mktemp("rows")
    for name in ("demo", "emulated"):
        config = str(packaged("configs") / f"{name}.toml")
        assert run_command(["demo", "--config", config, "--speed", "0", "--out", str(folder / name)]) == 0
    return fates_of(folder / "demo"), fates_of(folder / "emulated")


def _differing(mock: RowFates, emulated: RowFates) -> list[tuple[int, Fate, Fate]]:
    both = ((fruit, mock.of_fruit[fruit], emulated.of_fruit[fruit]) for fruit in mock.of_fruit)
    return [(fruit, a, b) for fruit, a, b in both if (a.state in SPRAYED) != (b.state in SPRAYED)]


@pytest.mark.long
def test_nineteen_of_twenty_fruits_share_the_fate_of_the_mock_run(rows: tuple[RowFates, RowFates]) -> None:
    mock, emulated = rows
    differing = _differing(mock, emulated)
    for fruit, a, b in differing:
        print(f"fruit {fruit}: {a.state} ({a.reason or '-'}) on mocks, {b.state} ({b.reason or '-'}) emulated")  # noqa: T201
    assert len(differing) <= (1.0 - ALIKE) * len(mock.of_fruit)


@pytest.mark.long
def test_a_fruit_that_was_seen_and_not_sprayed_has_its_reason(rows: tuple[RowFates, RowFates]) -> None:
    for row in rows:
        left = [fate for fate in row.of_fruit.values() if fate.state not in (*SPRAYED, "unseen")]
        assert all(fate.reason for fate in left)


@pytest.mark.long
def test_the_millilitres_that_left_the_nozzle_are_those_commanded(rows: tuple[RowFates, RowFates]) -> None:
    _, emulated = rows
    assert emulated.delivered_ml == pytest.approx(emulated.commanded_ml, rel=TOTAL_TOLERANCE)
    assert emulated.booked_ml >= emulated.delivered_ml
    assert emulated.booked_ml == pytest.approx(emulated.delivered_ml, rel=TOTAL_TOLERANCE)
