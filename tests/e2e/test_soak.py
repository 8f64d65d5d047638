"""``sprayer soak``: an hour of the robot's life in virtual time, with everything that goes wrong."""

from __future__ import annotations

import pytest

from robot.cli import run_command
from robot.soak import Soak, SoakOptions, SoakResult, as_text

WATCHED = {*(f"P{n}" for n in (1, 2, 3, 4, 5, 6, 7, 9, 10, 11, 14, 16, 17, 18, 20, 22)), "alive", "tasks"}


def soaked(tmp_path, hours: float, seed: int) -> SoakResult:
    return Soak(SoakOptions(hours, seed, tmp_path / "soak"), lambda _tally, _broken: None).run()


def test_every_property_holds_for_an_hour_of_virtual_life(tmp_path) -> None:
    result = soaked(tmp_path, 1.0, 1)
    assert not result.violations, as_text(result)
    assert set(result.held) == WATCHED
    assert result.tally.simulated_s >= 3600.0
    assert result.tally.shots > 50
    assert result.booked_ml >= result.true_ml - result.disobeyed_ml
    assert "killed" in result.tally.endings or "stopped (safe_stop)" in result.tally.endings


def test_the_same_seed_lives_the_same_life(tmp_path) -> None:
    one, other = soaked(tmp_path / "1", 0.02, 5), soaked(tmp_path / "2", 0.02, 5)
    assert one.tally.simulated_s == other.tally.simulated_s
    assert (one.booked_ml, one.true_ml) == (other.booked_ml, other.true_ml)


@pytest.mark.parametrize("hours", ["0", "-1", "nan", "1e9"])
def test_hours_that_are_none_are_refused(hours: str, capsys) -> None:
    assert run_command(["soak", "--hours", hours]) == 64
    assert "--hours" in capsys.readouterr().err


def test_a_folder_that_holds_something_is_refused(tmp_path, capsys) -> None:
    (tmp_path / "letter.txt").write_text("mine")
    assert run_command(["soak", "--hours", "0.01", "--out", str(tmp_path)]) == 64
    assert "expected a new or empty folder" in capsys.readouterr().err


def test_the_truth_can_be_kept_in_a_file(tmp_path) -> None:
    truth = tmp_path / "truth.jsonl"
    assert run_command(["soak", "--hours", "0.01", "--out", str(tmp_path / "soak"), "--truth", str(truth)]) == 0
    assert '"kind":"command"' in truth.read_text()
