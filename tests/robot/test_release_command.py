"""``sprayer release``: uncertain targets listed and released, with a name and a reason."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from robot.cli import app
from robot.errors import BusyError, FileError, UsageError
from robot.ledger import Ledger, LedgerReader, LedgerRuleError, Outcome, Result
from robot.targets import TargetState

from .ledger.rows import NOON, intent, started

UNCERTAIN = Result(Outcome.UNCERTAIN, 6.3, 0.5, None, "close unconfirmed", 13.0)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A ledger that a crash left: target 1 uncertain, 2 without an outcome."""
    ledger, task_id = started(tmp_path / "run.ledger")
    ledger.write_result(ledger.write_intent(task_id, intent(1)), UNCERTAIN)
    ledger.write_intent(task_id, intent(2))
    ledger.close()
    return ledger.path


def call(*arguments: object) -> str:
    result = CliRunner().invoke(app, ["release", *map(str, arguments)], catch_exceptions=False)
    return result.output


def states(path: Path) -> list[TargetState]:
    with LedgerReader.open_read_only(path) as reader:
        return [target.state for target in reader.targets(1)]


def test_without_a_target_the_uncertain_ones_are_listed_and_nothing_changes(path):
    before = path.read_bytes()
    said = call(path)
    assert "target 1 at 0.30 0.60 0.90 m" in said
    assert "target 2 at" in said
    assert "target 3" not in said
    assert path.read_bytes() == before


def test_released_targets_are_open_and_the_word_is_kept(path):
    said = call(path, "--target", 1, "--target", 2, "--operator", "Ada", "--reason", "dry leaves")
    assert said.splitlines() == ["task 1: target 1 is open again", "task 1: target 2 is open again"]
    assert states(path) == [TargetState.OPEN] * 3
    with LedgerReader.open_read_only(path) as reader:
        assert [(row.target_id, row.operator, row.reason) for row in reader.releases(1)] == [
            (1, "Ada", "dry leaves"),
            (2, "Ada", "dry leaves"),
        ]
        assert reader.totals(1).booked_ml == pytest.approx(12.6)
    assert "no uncertain target" in call(path)


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        (("--target", 1), UsageError, "needs --operator NAME and --reason TEXT"),
        (("--target", 1, "--operator", " ", "--reason", "dry"), UsageError, "needs --operator"),
        (("--target", 3, "--operator", "Ada", "--reason", "dry"), LedgerRuleError, "target 3 of task 1 is open"),
        (("--target", 1, "--operator", "Ada", "--reason", "dry", "--task", 9), FileError, "has no task 9"),
    ],
)
def test_what_cannot_be_released_is_refused_with_the_reason(path, arguments, error, words):
    with pytest.raises(error, match=words):
        call(path, *arguments)
    assert states(path)[0] is TargetState.UNCERTAIN


def test_a_ledger_that_is_not_there_or_empty_or_in_use_is_named(tmp_path, path):
    word = ("--target", 1, "--operator", "Ada", "--reason", "dry")
    with pytest.raises(FileError, match="there is no ledger here"):
        call(tmp_path / "none.ledger", *word)
    assert not (tmp_path / "none.ledger").exists()
    Ledger.open(tmp_path / "empty.ledger").close()
    with pytest.raises(FileError, match="holds no task"):
        call(tmp_path / "empty.ledger", *word)
    with Ledger.open(path, lambda: NOON), pytest.raises(BusyError, match="in use by process"):
        call(path, *word)
