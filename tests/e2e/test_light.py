"""The whole demo by lamp light and by day: as many fruits are sprayed."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path

import pytest

from robot.cli import run_command
from robot.ledger import LedgerReader
from robot.package_files import packaged
from robot.targets import TargetState

DEMO = packaged("configs") / "demo.toml"


def sprayed(folder: Path, seed: int) -> int:
    arguments = ["demo", "--config", str(DEMO), "--seed", str(seed), "--speed", "0", "--out", str(folder)]
    with contextlib.redirect_stdout(io.StringIO()):
        assert run_command(arguments) == 0
    with LedgerReader.open_read_only(folder / "ledger.sqlite") as ledger:
        task_id = ledger.latest_task()
        assert task_id is not None
        states = [target.state for target in ledger.targets(task_id)]
    return sum(state in (TargetState.SPRAYED, TargetState.UNCERTAIN) for state in states)


@pytest.mark.long
@pytest.mark.parametrize(("hour", "lamp"), [(19, "on"), (20, "auto"), (8, "auto")])
def test_as_many_fruits_are_sprayed_as_at_noon(hour, lamp, tmp_path, monkeypatch):
    noon = sum(sprayed(tmp_path / f"noon-{seed}", seed) for seed in (1, 2, 3))
    monkeypatch.setenv("SPRAYER_TWIN__HOUR", str(hour))
    monkeypatch.setenv("SPRAYER_CAMERA__LAMP", lamp)
    then = sum(sprayed(tmp_path / f"then-{seed}", seed) for seed in (1, 2, 3))
    assert noon > 90
    assert then >= 0.95 * noon
