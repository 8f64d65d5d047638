"""What a person can get wrong: each is one line on stderr that names the thing and the remedy, and nothing is left."""

from __future__ import annotations

import os
import resource
import shutil
import sqlite3
import subprocess
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pytest

from drivers.twin.aftermath import run_on
from drivers.twin.commands import RelayPulse, RelaySwitch
from drivers.twin.truth_record import read_truth
from robot.cli import run_command
from robot.config import load_config
from robot.ledger import Ledger, LedgerReader
from robot.runtime.settings import load_row, task

from .rover_process import DEADLINE_S, DEMO, SPRAYER, command, short_row

USAGE, UNAVAILABLE, FILE, BUSY, CONFIG = 64, 69, 74, 75, 78
Told = Callable[..., None]


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Told:
    """The exit code of its kind, and one line on stderr that holds all these words."""

    def check(exit_code: int, expected: int, *words: str) -> None:
        error = capsys.readouterr().err
        assert exit_code == expected, error
        assert error.startswith("sprayer: ")
        assert error.count("\n") == 1, error
        for word in words:
            assert word in error

    return check


def run(config: Path, out: Path, *more: str) -> int:
    """Exit code of a run that would spray the row at once if nothing was wrong."""
    return run_command(command(config, out, "--start", "--speed", "0", *more)[len(SPRAYER) :])


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run directory of a row of one stop that was sprayed before."""
    folder = tmp_path_factory.mktemp("done")
    assert run(short_row(folder, (0.45,)), folder / "out") == 0
    return folder / "out"


def a_ledger(folder: Path) -> Path:
    folder.mkdir()
    Ledger.open(folder / "ledger.sqlite").close()
    return folder / "ledger.sqlite"


# --- configuration


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("max_ml = 12.0", "max_ml = 12.0\nmin_pulze_s = 1", ("'dosing.min_pulze_s'", "did you mean 'min_pulse_s'?")),
        ("[fluid]", "[fluids]", ("unknown key 'fluids'", "did you mean 'fluid'?")),
        ("valve_open_s = 0.025", "valve_open_s = 25", ("'fluid.valve_open_s'", "equal to 0.5", "found 25")),
        ("coefficient = 0.02 ", "coefficient = nan ", ("'dosing.coefficient'", "finite", "found nan")),
        ("min_ml = 1.5", "min_ml = 13.0", ("min_ml must not exceed max_ml",)),
        ("max_shot_ml = 15.0", "max_shot_ml = 5.0", ("dosing.max_ml (12.0) exceeds safety.max_shot_ml (5.0)",)),
        ("hour = 12.0", "hour =", ("not valid TOML", "line", "mend that line")),
        ("seed = 1\n", "seed = -1\n", ("'twin.seed'", "greater than or equal to 0", "found -1")),
        ("-0.8, 1.35, 0.0", "-0.8, 135.0, 0.0", ("arm.stow_rad",)),
        ("-0.8, 1.35, 0.0", "-0.8, 6.1, 0.0", ("arm.stow_rad", "outside its limits", "correct the angle")),
        ("0.0, 0.7, 0.0]\nready_rad = [0.5, -0.7, 0.3, 0.0, 0.4, 0.0]", "0.7]\nready_rad = [0.5]", ("arm.stow_rad",)),
        ("routes/demo.toml", "routes/gone.toml", ("names 'routes/gone.toml'", "neither at")),
        ("routes/demo.toml", "routes", ("routes", "cannot be read", "navigation.route")),
        ("arms/viperx300_nozzle.urdf", "arms/gone.urdf", ("names 'arms/gone.urdf'", "neither at")),
        ("arms/viperx300_nozzle.urdf", "calibration/demo.json", ("demo.json", "expected a URDF")),
        ("arms/viperx300_nozzle.urdf", "arms", ("arms", "cannot be read", "arm.urdf")),
        ("calibration/demo.json", "calibration/gone.json", ("names 'calibration/gone.json'", "neither at")),
        ("calibration/demo.json", "routes/demo.toml", ("demo.toml", "not valid JSON")),
        ('route = "', 'row = "B"\nroute = "', ("navigation.row 'B'", "it has: A")),
    ],
)
def test_a_wrong_configuration_is_refused_before_anything_is_written(
    tmp_path: Path, refused: Told, old: str, new: str, words: tuple[str, ...]
) -> None:
    text = DEMO.read_text()
    assert old in text
    config = tmp_path / "wrong.toml"
    config.write_text(text.replace(old, new))
    refused(run(config, tmp_path / "out"), CONFIG, *words)
    assert [path.name for path in tmp_path.iterdir()] == ["wrong.toml"]


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ('side = "right"\nlength_m = 1.6\nstops_m = [0.4]', ("stands at the right", "rig faces left", "turn the rig")),
        ('side = "left"\nlength_m = 1.6\nstops_m = [0.4, 1.7]', ("stops_m[1]", "0 to 1.6", "found 1.7")),
        ('side = "left"\nlength_m = nan\nstops_m = [0.4]', ("length_m", "found nan")),
        ('side = "left"\nlength_m = 0.3\nstops_m = [0.2]', ("row_length_m", "0.4 to 200", "found 0.3")),
        ('side = "left"\nlength_m = 1.6\nstops = [0.2]', ("unknown key 'stops'", "stops_m")),
        ('side = "left"\nlength_m = 1.6\nstops_m = ', ("not valid TOML", "line")),
    ],
)
def test_a_wrong_route_is_refused(tmp_path: Path, refused: Told, row: str, words: tuple[str, ...]) -> None:
    config = short_row(tmp_path)
    (tmp_path / "routes" / "short.toml").write_text(f'name = "short"\n[[row]]\nname = "A"\n{row}\n')
    refused(run(config, tmp_path / "out"), CONFIG, *words)
    assert not (tmp_path / "out" / "truth.jsonl").exists()


def test_a_calibration_for_another_size_than_the_camera_gives_is_refused(tmp_path: Path, refused: Told) -> None:
    config = short_row(tmp_path, **{"[640, 480]": "[1280, 720]"})
    code = run(config, tmp_path / "out")
    refused(code, CONFIG, "calibration/demo.json", "640x480", "1280x720", "calibrate at the size")
    assert not (tmp_path / "out").exists()


def test_a_missing_configuration_is_named_with_those_that_came_along(tmp_path: Path, refused: Told) -> None:
    refused(run(tmp_path / "gone.toml", tmp_path / "out"), CONFIG, "gone.toml: no such configuration file", "demo.toml")


def test_a_folder_is_no_configuration(tmp_path: Path, refused: Told) -> None:
    refused(run(tmp_path, tmp_path / "out"), CONFIG, str(tmp_path), "cannot be read")


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("SPRAYER_DOSNG__MAX_ML", "7", ("SPRAYER_DOSNG__MAX_ML", "did you mean 'dosing'?")),
        ("SPRAYER_DOSING__MAXX_ML", "7", ("dosing.maxx_ml", "did you mean 'max_ml'?")),
        ("SPRAYER_DOSING__MAX_ML", "many", ("dosing.max_ml", "found 'many'")),
        ("SPRAYER_TWIN", "noon", ("twin", "single values")),
    ],
)
def test_a_wrong_variable_of_the_environment_is_refused(
    tmp_path: Path, refused: Told, monkeypatch: pytest.MonkeyPatch, name: str, value: str, words: tuple[str, ...]
) -> None:
    monkeypatch.setenv(name, value)
    refused(run(DEMO, tmp_path / "out"), CONFIG, *words)
    assert not (tmp_path / "out").exists()


# --- command line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["spary"], ("spary", "sprayer --help")),
        (["run"], ("--config", "sprayer --help")),
        (["run", "--config", "demo.toml", "--hurry"], ("--hurry",)),
        (["run", "--config", "demo.toml", "--seed", "-1"], ("--seed", "0", "sprayer --help")),
        (["run", "--config", "demo.toml", "--seed", str(2**64)], ("--seed", str(2**63 - 1))),
        (["run", "--config", "demo.toml", "--start", "--speed", "nan"], ("--speed",)),
        (["run", "--config", "demo.toml", "--start", "--speed", "-3"], ("--speed",)),
        (["run", "--config", "demo.toml", "--resume"], ("--resume", "needs --start")),
        (["run", "--config", "demo.toml", "--start", "--resume"], ("truth file", "--truth FILE")),
        (["report"], ("LEDGER", "sprayer --help")),
    ],
)
def test_a_wrong_command_line_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Told, arguments: list[str], words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    refused(run_command(arguments), USAGE, *words)
    assert list(tmp_path.iterdir()) == []


def test_without_arguments_the_help_is_shown_and_it_counts_as_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command([]) == USAGE
    shown = capsys.readouterr()
    assert "run" in shown.out + shown.err
    assert "Traceback" not in shown.err


# --- files and folders


@pytest.mark.parametrize("place", ["gone/summary.json", "taken"])
def test_a_summary_that_cannot_be_written_is_refused_before_the_row_is_sprayed(
    tmp_path: Path, refused: Told, place: str
) -> None:
    (tmp_path / "taken").mkdir()
    code = run(short_row(tmp_path), tmp_path / "out", "--summary", str(tmp_path / place))
    refused(code, FILE, str(tmp_path / place))
    assert not (tmp_path / "out").exists()


def test_a_run_directory_that_is_a_file_is_refused(tmp_path: Path, refused: Told) -> None:
    (tmp_path / "out").write_text("mine")
    config = short_row(tmp_path)
    code = run_command(["run", "--config", str(config), "--start", "--speed", "0", "--out", str(tmp_path / "out")])
    refused(code, FILE, f"{tmp_path}/out", "cannot be created", "choose another run directory")
    assert (tmp_path / "out").read_text() == "mine"


def test_a_truth_file_that_cannot_be_opened_is_refused(tmp_path: Path, refused: Told) -> None:
    out = tmp_path / "out"
    config = short_row(tmp_path)
    code = run_command(
        ["run", "--config", str(config), "--start", "--speed", "0", "--out", str(out), "--truth", str(tmp_path)]
    )
    refused(code, FILE, f"{tmp_path}: cannot be used", "choose another truth file")


def test_a_truth_file_of_another_seed_is_refused_and_left_alone(tmp_path: Path, refused: Told, done: Path) -> None:
    config = short_row(tmp_path, (0.45,))
    shutil.copytree(done, tmp_path / "out")
    before = (tmp_path / "out" / "truth.jsonl").read_bytes()
    refused(run(config, tmp_path / "out", "--seed", "4"), FILE, "truth.jsonl", "seed", "name another file")
    assert (tmp_path / "out" / "truth.jsonl").read_bytes() == before


def test_a_truth_file_that_is_none_is_refused_and_left_alone(tmp_path: Path, refused: Told) -> None:
    (tmp_path / "out").mkdir()
    truth = tmp_path / "out" / "truth.jsonl"
    truth.write_text('{"kind": "shopping list"}\n')
    refused(run(short_row(tmp_path), tmp_path / "out"), FILE, "truth.jsonl, line 1", "expected a world line")
    assert truth.read_text() == '{"kind": "shopping list"}\n'


# --- ledger


def test_a_ledger_of_a_newer_program_is_refused_and_left_alone(tmp_path: Path, refused: Told) -> None:
    ledger = a_ledger(tmp_path / "out")
    with sqlite3.connect(ledger) as database:
        database.execute("PRAGMA user_version = 99")
    database.close()
    before = ledger.read_bytes()
    code = run(short_row(tmp_path), tmp_path / "out")
    refused(code, FILE, "ledger.sqlite: written by a newer program", "schema 99", "update the program")
    assert ledger.read_bytes() == before
    assert not (tmp_path / "out" / "truth.jsonl").exists()


@pytest.mark.parametrize("verb", ["run", "report", "demo"])
def test_a_ledger_that_is_no_database_is_refused_and_left_alone(tmp_path: Path, refused: Told, verb: str) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "ledger.sqlite").write_text("a letter, long enough to fill the header of a database\n" * 9)
    before = (out / "ledger.sqlite").read_bytes()
    config = short_row(tmp_path)
    arguments = {
        "run": command(config, out, "--start", "--speed", "0")[len(SPRAYER) :],
        "report": ["report", str(out / "ledger.sqlite")],
        "demo": ["demo", "--config", str(config), "--out", str(out), "--speed", "0"],
    }
    refused(run_command(arguments[verb]), FILE, "ledger.sqlite", "not a database", "keep the file for the records")
    assert (out / "ledger.sqlite").read_bytes() == before


@pytest.mark.parametrize("verb", ["run", "demo"])
def test_a_ledger_in_use_is_refused_with_the_process_that_holds_it(tmp_path: Path, refused: Told, verb: str) -> None:
    out = tmp_path / "out"
    ledger = a_ledger(out)
    config = short_row(tmp_path)
    arguments = {
        "run": command(config, out, "--start", "--speed", "0")[len(SPRAYER) :],
        "demo": ["demo", "--config", str(config), "--out", str(out), "--speed", "0"],
    }
    with Ledger.open(ledger):
        refused(run_command(arguments[verb]), BUSY, f"{ledger}: in use by process {os.getpid()}", "stop that process")
    assert ledger.exists()
    assert not (out / "truth.jsonl").exists()


def test_the_demo_does_not_clear_away_the_records_of_real_spraying(tmp_path: Path, refused: Told) -> None:
    out = tmp_path / "out"
    ledger = a_ledger(out)
    config_path = short_row(tmp_path)
    config = load_config(config_path)
    applied = task(config, load_row(config, config_path))
    with Ledger.open(ledger) as records:
        records.begin_run("boot", datetime(2026, 6, 15, tzinfo=UTC))
        records.begin_task(type(applied)(*(*_values(applied)[:-1], None)))
    code = run_command(["demo", "--config", str(config_path), "--out", str(out), "--speed", "0"])
    refused(code, FILE, "ledger.sqlite", "real spraying (task 1)", "choose another folder")
    with LedgerReader.open_read_only(ledger) as records:
        assert records.latest_task() == 1


def _values(row: object) -> tuple[object, ...]:
    return tuple(getattr(row, name) for name in row.__dataclass_fields__)  # type: ignore[attr-defined]


def test_a_report_of_a_ledger_without_a_task_is_refused(tmp_path: Path, refused: Told) -> None:
    ledger = a_ledger(tmp_path / "out")
    refused(run_command(["report", str(ledger)]), USAGE, f"{ledger}: holds no task yet")
    assert not (tmp_path / "out" / "report.html").exists()


def test_a_report_of_a_ledger_that_is_not_there_is_refused(tmp_path: Path, refused: Told) -> None:
    refused(run_command(["report", str(tmp_path / "ledger.sqlite")]), FILE, "there is no ledger here")
    assert list(tmp_path.iterdir()) == []


# --- resume


def test_a_resume_where_there_is_no_ledger_is_refused_and_makes_none(tmp_path: Path, refused: Told) -> None:
    code = run(short_row(tmp_path), tmp_path / "out", "--resume")
    refused(code, USAGE, "no ledger to resume from", "without --resume")
    assert not (tmp_path / "out").exists()


def test_a_resume_of_a_ledger_without_a_task_is_refused(tmp_path: Path, refused: Told) -> None:
    a_ledger(tmp_path / "out")
    code = run(short_row(tmp_path), tmp_path / "out", "--resume")
    refused(code, USAGE, "holds no task to resume", "without --resume")
    assert not (tmp_path / "out" / "truth.jsonl").exists()


@pytest.mark.parametrize("change", ["dose", "seed"])
def test_a_resume_with_a_changed_configuration_is_refused_and_the_machine_left_alone(
    tmp_path: Path, refused: Told, monkeypatch: pytest.MonkeyPatch, done: Path, change: str
) -> None:
    config = short_row(tmp_path, (0.45,))
    shutil.copytree(done, tmp_path / "out")
    before = (tmp_path / "out" / "truth.jsonl").read_bytes()
    if change == "dose":
        monkeypatch.setenv("SPRAYER_DOSING__MAX_ML", "7")
    more = ("--seed", "9") if change == "seed" else ()
    code = run(config, tmp_path / "out", "--resume", *more)
    refused(code, CONFIG, "ledger.sqlite: task 1", "another configuration", "restore it")
    assert (tmp_path / "out" / "truth.jsonl").read_bytes() == before


# --- full disk


def run_with_files_up_to(limit_bytes: int, config: Path, out: Path) -> tuple[int, str]:
    """(exit code, stderr) of a run whose disk takes no file longer than the limit."""

    def full_disk() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))

    done = subprocess.run(
        command(config, out, "--start", "--speed", "0"), capture_output=True, text=True, timeout=DEADLINE_S,
        check=False, preexec_fn=full_disk, env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1", "COLUMNS": "200"},
    )  # fmt: skip
    return done.returncode, done.stderr


def test_with_a_full_disk_from_the_start_nothing_moves_and_nothing_sprays(tmp_path: Path) -> None:
    code, errors = run_with_files_up_to(16_384, short_row(tmp_path), tmp_path / "out")
    assert code == FILE, errors
    assert errors.startswith("sprayer: ")
    assert errors.count("\n") == 1
    assert "ledger.sqlite" in errors
    assert "no ledger, no spray" in errors
    assert not (tmp_path / "out" / "truth.jsonl").exists()


@pytest.mark.parametrize("limit_bytes", [280_000, 380_000])
def test_a_disk_that_fills_up_ends_the_spraying_with_every_opening_written_down(
    tmp_path: Path, limit_bytes: int
) -> None:
    out = tmp_path / "out"
    code, errors = run_with_files_up_to(limit_bytes, short_row(tmp_path, (0.45, 0.85, 1.25)), out)
    assert code == FILE, errors
    assert "Traceback" not in errors
    assert errors.splitlines()[-1].startswith("sprayer: ")
    assert "no ledger, no spray" in errors.splitlines()[-1]
    after = run_on(out / "truth.jsonl")
    assert after.after_ml == pytest.approx(0.0, abs=1e-9)
    assert not any(after.coils.values())
    with LedgerReader.open_read_only(out / "ledger.sqlite") as ledger:
        totals = ledger.totals(1)
        intents = len(ledger.shots(1))
    assert totals.booked_ml + totals.pending_ml >= after.total_ml - 1e-6
    assert _openings(out / "truth.jsonl") <= intents


def _openings(truth: Path) -> int:
    commands = [timed.command for process in read_truth(truth).processes for timed in process.commands]
    assert not any(isinstance(c, RelaySwitch) and c.channel.value == "valve" and c.on for c in commands)
    return sum(isinstance(c, RelayPulse) and c.channel.value == "valve" for c in commands)
