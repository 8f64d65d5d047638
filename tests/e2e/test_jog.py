"""``sprayer jog`` and ``sprayer arm home``: what moved in truth, and what a person was told."""

from __future__ import annotations

import os
import pty
import re
import select
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from drivers.twin.aftermath import run_on
from drivers.twin.commands import ArmGoal
from drivers.twin.kinematics import read_urdf
from robot.cli import run_command
from robot.ledger import Ledger
from robot.runtime import ledger_path

from .by_hand import STOW_RAD, at_rest, command, process
from .rover_process import DEADLINE_S, DEMO, SPRAYER
from .test_bad_input import BUSY, FILE, UNAVAILABLE, USAGE, Told, refused

__all__ = ["refused"]

FAILED = 1
HARDWARE = str(DEMO.parent / "rover.toml")
ARM = read_urdf((DEMO.parent / "arms" / "viperx300_nozzle.urdf").read_text())
BASE_FROM_ARM = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # mounted a quarter turned to the left


def nozzle(out: Path) -> tuple[np.ndarray, np.ndarray]:
    """True place and direction of the nozzle, turned into the base frame."""
    pose = ARM.nozzle_pose(at_rest(out).joints_rad)
    return BASE_FROM_ARM @ pose[:3, 3], BASE_FROM_ARM @ pose[:3, 0]


def told_angles(text: str) -> dict[str, tuple[float, ...]]:
    """Joint angles as printed before and after."""
    lines = [line.partition(":") for line in text.splitlines() if line.startswith(("before:", "after:"))]
    return {when: tuple(map(float, re.findall(r"[-+]\d\.\d{3}", told.partition("rad")[0]))) for when, _, told in lines}


def nothing_moved(out: Path) -> bool:
    if not (out / "truth.jsonl").exists():
        return True
    commands = [timed.command for timed in process(out).commands]
    return not any(isinstance(command, ArmGoal) for command in commands) and at_rest(out).base_pose == (0.0, 0.0, 0.0)


# --- arm


def test_a_joint_turns_by_what_was_asked_and_the_others_stand_still(tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert command(out, "jog", "joint", "waist", "0.4") == 0
    assert at_rest(out).joints_rad == pytest.approx((0.4, *STOW_RAD[1:]), abs=0.01)
    told = told_angles(capsys.readouterr().out)
    assert told["before"] == pytest.approx(STOW_RAD, abs=0.01)
    assert told["after"] == pytest.approx((0.4, *STOW_RAD[1:]), abs=0.01)
    assert command(out, "jog", "joint", "waist", "-0.7") == 0
    assert at_rest(out).joints_rad == pytest.approx((-0.3, *STOW_RAD[1:]), abs=0.01)


def test_no_joint_turns_faster_than_the_limit(tmp_path: Path) -> None:
    goals = {}
    for limit in ("0.1", "0.5"):
        out = tmp_path / limit
        assert command(out, "jog", "joint", "waist", "0.3", "--speed-limit", limit) == 0
        goals[limit] = [timed for timed in process(out).commands if isinstance(timed.command, ArmGoal)]
        for before, after in zip(goals[limit], goals[limit][1:], strict=False):
            turned = np.abs(np.subtract(after.command.rad, before.command.rad)).max()
            assert turned <= float(limit) * (after.t - before.t) + 1e-6
    spans = {limit: sent[-1].t - sent[0].t for limit, sent in goals.items()}
    assert spans["0.1"] > 3 * spans["0.5"]


@pytest.mark.parametrize("by_m", [(0.0, 0.05, 0.0), (0.03, 0.0, 0.02), (-0.02, 0.04, 0.03)])
def test_the_nozzle_shifts_in_the_rovers_frame_and_keeps_its_direction(tmp_path: Path, by_m) -> None:
    out = tmp_path / "out"
    for name, by_rad in (("elbow", "-0.5"), ("wrist_angle", "-0.3")):
        assert command(out, "jog", "joint", name, by_rad) == 0
    start_m, start_axis = nozzle(out)
    assert command(out, "jog", "nozzle", *map(str, by_m)) == 0
    end_m, end_axis = nozzle(out)
    assert end_m - start_m == pytest.approx(by_m, abs=0.004)
    assert float(start_axis @ end_axis) > np.cos(0.02)


def test_home_folds_the_arm_from_where_the_last_command_left_it(tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    for name, by_rad in (("waist", "0.6"), ("elbow", "-0.8"), ("shoulder", "0.3")):
        assert command(out, "jog", "joint", name, by_rad) == 0
    assert command(out, "arm", "home") == 0
    assert at_rest(out).joints_rad == pytest.approx(STOW_RAD, abs=0.015)
    assert command(out, "arm", "home") == 0
    assert "stowed already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (("joint", "waste", "0.1"), USAGE, ("no joint 'waste'", "waist, shoulder")),
        (("joint", "waist", "1.5"), USAGE, ("at most 1 rad", "in steps")),
        (("joint", "waist", "nan"), USAGE, ("waist by nan rad",)),
        (("joint", "waist", "inf"), USAGE, ("waist by inf rad",)),
        (("joint", "waist", "much"), USAGE, ("'BY_RAD'", "valid number")),
        (("joint", "elbow", "0.9"), USAGE, ("2.2", "outside its limits", "smaller step")),
        (("joint", "shoulder", "1.0"), FAILED, ("shoulder by 1 rad", "touch itself or the rover")),
        (("joint", "waist", "0.1", "--speed-limit", "9"), USAGE, ("--speed-limit",)),
        (("nozzle", "0.5", "0", "0"), USAGE, ("at most 0.3 m",)),
        (("nozzle", "nan", "0", "0"), USAGE, ("the nozzle by nan 0 0 m",)),
        (("nozzle", "0", "0", "-0.29"), FAILED, ("the nozzle by 0 0 -0.29 m",)),
        (("nozzle", "0.1", "0"), USAGE, ("DZ",)),
        (("base", "--forward-m", "0.7"), USAGE, ("at most 0.5 m",)),
        (("base", "--forward-m", "nan"), USAGE, ("--forward-m nan",)),
        (("base", "--forward-m", "0"), USAGE, ("--forward-m 0",)),
        (("base", "--forward-m", "0.2", "--speed-limit", "0.9"), USAGE, ("allows 0.4 m/s",)),
        (("joint", "waist", "0.1", "--emulate"), USAGE, ("no emulated rover",)),
        (("joint", "waist", "0.1", "--fault", "arm:asleep"), USAGE, ("--fault", "asleep")),
        (("joint", "waist", "0.1", "--fault", "arm:off"), UNAVAILABLE, ("arm: expected", "silence")),
    ],
)
def test_what_cannot_be_done_is_refused_with_the_reason_and_nothing_moves(
    tmp_path: Path, refused: Told, words, code, told
) -> None:
    refused(command(tmp_path / "out", "jog", *words), code, *told)
    assert nothing_moved(tmp_path / "out")


def test_a_ledger_that_another_robot_holds_keeps_the_arm_still(tmp_path: Path, refused: Told) -> None:
    out = tmp_path / "out"
    out.mkdir()
    with Ledger.open(ledger_path(out)):
        refused(command(out, "jog", "joint", "waist", "0.1"), BUSY, f"in use by process {os.getpid()}")
    assert nothing_moved(out)


def test_a_run_directory_that_cannot_be_made_is_named(tmp_path: Path, refused: Told) -> None:
    (tmp_path / "file").write_text("no folder")
    code = run_command(["jog", "joint", "waist", "0.1", "--config", str(DEMO), "--out", str(tmp_path / "file" / "out")])
    refused(code, FILE, "cannot be created", "choose another --out")


@pytest.mark.parametrize(
    "words",
    [
        ("jog", "joint", "waist", "0.1"),
        ("jog", "base", "--forward-m", "0.1"),
        ("arm", "home"),
        ("spray", "--ml", "5"),
        ("calibrate", "flow"),
    ],
)
def test_real_hardware_is_not_moved_without_a_person_at_its_terminal(tmp_path: Path, refused: Told, words) -> None:
    code = run_command([*words, "--config", HARDWARE, "--out", str(tmp_path / "out")])
    refused(code, USAGE, "real hardware must be confirmed at a terminal")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("words", [("spray", "--ml", "5", "--yes"), ("calibrate", "flow", "--yes")])
def test_a_flag_does_not_stand_in_for_that_person(tmp_path: Path, refused: Told, words) -> None:
    code = run_command([*words, "--config", HARDWARE, "--out", str(tmp_path / "out")])
    refused(code, USAGE, "--yes is for simulation")
    assert not (tmp_path / "out").exists()


# --- base


@pytest.mark.parametrize("by_m", [0.5, 0.12, -0.25])
def test_the_base_drives_the_step_that_was_asked(tmp_path: Path, capsys, by_m: float) -> None:
    out = tmp_path / "out"
    assert command(out, "jog", "base", "--forward-m", str(by_m)) == 0
    x_m, y_m, heading = at_rest(out).base_pose
    assert x_m == pytest.approx(by_m, abs=0.004 + 0.012 * abs(by_m))  # wheels deviate by a percent
    assert abs(y_m) < 0.005
    assert abs(heading) < 0.01
    told = re.search(r"driven: (\S+) m", capsys.readouterr().out)
    assert told is not None
    assert float(told[1]) == pytest.approx(by_m, abs=0.004)


def test_the_base_is_not_driven_with_the_arm_unfolded(tmp_path: Path, refused: Told, capsys) -> None:
    out = tmp_path / "out"
    assert command(out, "jog", "joint", "waist", "0.3") == 0
    capsys.readouterr()
    refused(command(out, "jog", "base", "--forward-m", "0.2"), FAILED, "arm unfolded", "sprayer arm home")
    assert at_rest(out).base_pose == (0.0, 0.0, 0.0)
    assert command(out, "arm", "home") == 0
    assert command(out, "jog", "base", "--forward-m", "0.2") == 0
    assert at_rest(out).base_pose[0] == pytest.approx(0.2, abs=0.01)


def test_holding_to_run_needs_a_terminal(tmp_path: Path, refused: Told) -> None:
    done = subprocess.run(
        [*SPRAYER, "jog", "base", "--config", str(DEMO), "--out", str(tmp_path / "out")], stdin=subprocess.DEVNULL,
        capture_output=True, text=True, timeout=DEADLINE_S, check=False,
    )  # fmt: skip
    assert done.returncode == USAGE
    assert "the standard input is none; give --forward-m X for one step" in done.stderr
    assert not (tmp_path / "out").exists()


class Seat:
    """A terminal with the command at it."""

    def __init__(self, out: Path) -> None:
        self.truth = out / "truth.jsonl"
        self.master, slave = pty.openpty()
        out.mkdir()
        words = ["jog", "base", "--config", str(DEMO), "--out", str(out), "--truth", str(self.truth)]
        self.process = subprocess.Popen([*SPRAYER, *words], stdin=slave, stdout=slave, stderr=slave)
        os.close(slave)

    def until(self, wanted: str, press: bytes = b"") -> None:
        """Until the truth file holds ``wanted``, pressing meanwhile."""
        deadline_s = time.monotonic() + DEADLINE_S
        while not (self.truth.exists() and wanted in self.truth.read_text(errors="replace")):
            assert time.monotonic() < deadline_s, f"no {wanted}"
            assert self.process.poll() is None
            if press:
                os.write(self.master, press)
            self._drain(0.03)

    def end(self) -> int:
        deadline_s = time.monotonic() + DEADLINE_S
        while self.process.poll() is None and time.monotonic() < deadline_s:
            self._drain(0.05)
        return self.process.wait(1.0)

    def _drain(self, wait_s: float) -> None:
        try:
            if select.select([self.master], [], [], wait_s)[0]:
                os.read(self.master, 4096)
        except OSError:
            time.sleep(wait_s)


DRIVING = '"verb":"drive"'
STOPPED = '"what":"base_stopped"'


@pytest.fixture
def seat(tmp_path: Path) -> Iterator[Seat]:
    seat = Seat(tmp_path / "out")
    yield seat
    if seat.process.poll() is None:
        seat.process.kill()
    seat.process.wait()
    os.close(seat.master)


def test_at_a_terminal_the_base_runs_while_the_key_repeats_and_stands_when_it_does_not(seat: Seat) -> None:
    seat.until(DRIVING, press=b"w")
    seat.until(STOPPED)
    os.write(seat.master, b"q")
    assert seat.end() == 0
    after = run_on(seat.truth)
    assert 0.01 < after.base_pose[0] < 1.0
    assert not any(after.coils.values())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_at_the_terminal_stops_the_base_and_ends_clean(seat: Seat, number: signal.Signals) -> None:
    seat.until(DRIVING, press=b"\x1b[A")
    seat.process.send_signal(number)
    assert seat.end() == 0
    after = run_on(seat.truth)
    assert 0.0 < after.base_pose[0] < 1.0
    assert not any(after.coils.values())


def test_a_terminal_that_hangs_up_leaves_the_base_at_rest(tmp_path: Path) -> None:
    seat = Seat(tmp_path / "out")
    seat.until(DRIVING, press=b"w")
    os.close(seat.master)
    seat.process.wait(DEADLINE_S)
    after = run_on(seat.truth)
    assert 0.0 < after.base_pose[0] < 1.0
    assert not any(after.coils.values())
