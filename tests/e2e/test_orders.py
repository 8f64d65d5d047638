"""``sprayer status``, ``stop``, ``arm`` and the other orders, given to a robot that lives beside."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot.cli import run_command
from tests.robot.control.living import Living, living

from .rover_process import SPRAYER, short_row


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Living]:
    with living(tmp_path_factory.mktemp("robot")) as alive:
        yield alive


@pytest.fixture
def give(robot: Living, capsys: pytest.CaptureFixture[str]):  # type: ignore[no-untyped-def]
    """(exit code, standard output, standard error) of an order to that robot."""

    def order(*words: str) -> tuple[int, str, str]:
        code = run_command([*words, "--socket", str(robot.path)])
        told = capsys.readouterr()
        return code, told.out, told.err

    return order


def test_status_shows_mode_and_every_task_under_its_owner(give) -> None:  # type: ignore[no-untyped-def]
    code, out, _ = give("status")
    assert code == 0
    lines = out.splitlines()
    assert lines[0].split()[:2] == ["demo-rover", "DISARMED"]
    assert "mission: idle" in out
    heading = next(number for number, line in enumerate(lines) if line.startswith("owner"))
    assert "last error" in lines[heading]
    sensors = next(line for line in lines if "sensors" in line)
    assert sensors.split()[:2] == ["actuation", "sensors"]
    assert "10.0/s" in sensors


def test_status_as_json_is_what_the_robot_answers(give, robot: Living) -> None:  # type: ignore[no-untyped-def]
    code, out, _ = give("status", "--json")
    assert code == 0
    assert json.loads(out).keys() == robot.get("/v1/status").body.keys()


def test_from_disarmed_to_started_and_stopped_and_back(give, robot: Living) -> None:  # type: ignore[no-untyped-def]
    assert give("start") == (1, "", "sprayer: start: start is not possible in mode disarmed\n")
    assert give("arm") == (0, "ready\n", "")
    code, out, _ = give("start")  # no terminal: the plan and its token
    assert code == 0
    assert out.startswith("a new task: A, stops 1 to 1, the rover at the row's start")
    token = out.rstrip().rpartition(" ")[2]
    assert give("start", "--confirm", "0000") == (
        1, "", "sprayer: start: no plan waits under this token; ask for a plan first, and confirm the newest\n",
    )  # fmt: skip
    assert give("start", "--confirm", token) == (0, "task 1 started\n", "")
    robot.until(lambda: robot.get("/v1/status").body["mission"]["state"] == "move")
    assert give("pause")[:2] == (0, "paused\n")
    assert give("resume")[:2] == (0, "auto\n")
    assert give("refill", "5000") == (
        1, "", "sprayer: refill: the tank is not filled in mode auto; pause or stop first\n",
    )  # fmt: skip
    assert give("stop") == (0, "valve: stopped\nbase: stopped\narm: stopped\npump: stopped\n", "")
    assert "cause: STOP at the command line" in give("status")[1]
    assert give("refill", "5000.5") == (0, "5000.5 ml in the tank, safe_stop\n", "")
    assert robot.get("/v1/status").body["tank_left_ml"] == 5000.5
    assert give("arm")[0] == 1
    assert give("acknowledge") == (0, "disarmed\n", "")
    assert give("reset")[0] == 1
    assert give("disarm") == (0, "disarmed\n", "")


def test_a_wrong_use_is_told_in_one_line(give) -> None:  # type: ignore[no-untyped-def]
    assert give("start", "--new", "--resume")[0] == 64
    code, _, errors = give("arm", "--config", "x.toml", "scan")
    assert code == 64
    assert errors.count("\n") == 1


PROJECT = Path(__file__).parents[2]
VERBS = ("status", "stop", "arm", "start", "pause", "resume", "acknowledge", "reset", "disarm", "refill")


@pytest.mark.parametrize("verb", VERBS)
def test_where_no_robot_runs_every_order_ends_with_69_and_one_line(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [verb, "8000"] if verb == "refill" else [verb]
    assert run_command([*words, "--socket", str(tmp_path / "none.sock")]) == 69
    errors = capsys.readouterr().err
    assert errors.startswith("sprayer: no robot answers at")
    assert errors.count("\n") == 1


def test_the_socket_is_found_by_the_configurations_run_directory(
    robot: Living, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SPRAYER_ROBOT__RUN_DIRECTORY", str(robot.path.parent))
    assert run_command(["status", "--config", str(short_row(tmp_path))]) == 0
    assert "DISARMED" in capsys.readouterr().out


def test_a_run_whose_journal_listens_tells_its_life_in_lines_with_priorities(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    with journal.open("w") as stream:
        status = os.fstat(stream.fileno())
        environment = os.environ | {"JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino}", "OPENBLAS_NUM_THREADS": "1"}
        words = ["run", "--config", str(short_row(tmp_path)), "--out", str(tmp_path / "out"), "--speed", "1"]
        process = subprocess.Popen([*SPRAYER, *words], stderr=stream, env=environment)
        try:
            until_written(journal, "up waiting=True")
        finally:
            process.send_signal(signal.SIGTERM)
            code = process.wait(30.0)
    lines = journal.read_text().splitlines()
    assert code == 0, lines
    assert lines[0] == "<6>robot.run: up waiting=True task=None control=None"  # virtual time takes no orders
    assert not (tmp_path / "out" / "control.sock").exists()


def until_written(path: Path, words: str) -> None:
    deadline = time.monotonic() + 60.0
    while words not in path.read_text():
        assert time.monotonic() < deadline, path.read_text()
        time.sleep(0.02)


def python(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program], check=False, capture_output=True, text=True, timeout=60.0, cwd=PROJECT
    )


def test_a_stop_is_given_before_cameras_networks_and_planners_are_loaded(tmp_path: Path) -> None:
    ended = python(
        f"import sys; sys.argv = ['sprayer', 'stop', '--socket', {str(tmp_path / 'none.sock')!r}]\n"
        "from robot.entry import main\n"
        "try:\n    main()\n"
        "except SystemExit as end:\n"
        "    print(end.code, sorted({'numpy', 'cv2', 'scipy', 'aiohttp'} & set(sys.modules)))"
    )
    assert ended.stdout == "69 []\n", ended.stderr


def test_the_commands_entry_gives_a_stop_to_the_robot(robot: Living) -> None:
    ended = python(
        f"import sys; sys.argv = ['sprayer', 'stop', '--socket', {str(robot.path)!r}]\n"
        "from robot.entry import main; main()"
    )
    assert (ended.returncode, ended.stdout.splitlines()[0]) == (0, "valve: stopped")
    assert robot.post("acknowledge").ok
