"""The units as ``sprayer install`` puts them: systemd understands every line, and gives them little to do harm with."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot.cli import run_command
from robot.commands.install_files import UNITS
from robot.package_files import packaged

HIGHEST_EXPOSURE = 20  # tenths
ANALYZE = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed (apt-get install systemd)"
)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A staging root with the service and the programs that it calls."""
    folder = tmp_path_factory.mktemp("root")
    program = folder / "opt/sprayer/bin/sprayer"
    program.parent.mkdir(parents=True)
    for stub in (program, folder / "bin/echo"):
        stub.parent.mkdir(exist_ok=True)
        stub.write_text("#!/bin/sh\n")
        stub.chmod(0o755)
    targets = folder / "etc/systemd/system"
    targets.mkdir(parents=True)
    for target in ("sysinit", "basic", "shutdown", "multi-user"):  # what every unit depends on
        (targets / f"{target}.target").write_text("[Unit]\nDescription=stub\n")
    assert run_command(["install", "--root", str(folder), "--program", "/opt/sprayer/bin/sprayer"]) == 0
    return folder


def lines(unit: str) -> Iterator[tuple[str, str]]:
    """Keys and values of a unit that came along."""
    for line in (packaged("systemd") / unit).read_text().splitlines():
        key, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            yield key, value


def values(unit: str, key: str) -> list[str]:
    return [value for name, value in lines(unit) if name == key]


@ANALYZE
@pytest.mark.parametrize("unit", UNITS)
def test_systemd_has_nothing_to_say_against_it(unit: str, root: Path) -> None:
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", f"--root={root}", unit], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")  # an unknown key is but a line on stderr


@ANALYZE
@pytest.mark.parametrize("line", ["WatchdogSecc=3s", "NoNewPrivileges=yes  # always"])
def test_systemd_would_have_said_so(line: str, root: Path, tmp_path: Path) -> None:
    """The check above is worth something."""
    shutil.copytree(root, tmp_path / "root", symlinks=True)
    unit = tmp_path / "root/etc/systemd/system/sprayer-failed.service"
    unit.write_text(unit.read_text() + f"{line}\n")
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", f"--root={tmp_path / 'root'}", unit.name],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert line.partition("=")[0] in done.stderr or line.partition("=")[2] in done.stderr


@ANALYZE
@pytest.mark.parametrize("unit", UNITS)
def test_its_exposure_is_2_at_the_most(unit: str) -> None:
    path = packaged("systemd") / unit
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", f"--threshold={HIGHEST_EXPOSURE}", str(path)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Overall exposure level" in done.stdout


@pytest.mark.parametrize("unit", UNITS)
def test_no_value_swallows_a_comment(unit: str) -> None:
    assert [value for _, value in lines(unit) if re.search(r"\s[#;]", value)] == []


def test_the_service_keeps_its_ports() -> None:
    """ProtectClock= and DevicePolicy= put a list of devices in force, on which the robot's must stand."""
    assert values("sprayer.service", "PrivateDevices") == []
    allowed = {value.split()[0] for value in values("sprayer.service", "DeviceAllow")}
    assert {"char-ttyUSB", "char-ttyACM", "char-video4linux", "char-usb_device"} <= allowed


def test_the_service_is_watched_and_started_again_except_for_a_wrong_configuration() -> None:
    told = dict(lines("sprayer.service"))
    assert (told["Type"], told["NotifyAccess"], told["WatchdogSec"]) == ("notify", "main", "5s")
    assert (told["Restart"], told["RestartPreventExitStatus"]) == ("always", "78")
    assert (told["StartLimitBurst"], told["StartLimitIntervalSec"]) == ("5", "300")
    assert told["OnFailure"] == "sprayer-failed.service"
    assert told["KillMode"] == "mixed"


@pytest.mark.parametrize(
    ("unit", "key"),
    [("sprayer.service", "ExecStartPre"), ("sprayer.service", "ExecStopPost"), ("sprayer-failed.service", "ExecStart")],
)
def test_all_off_understands_what_the_units_tell_it(unit: str, key: str, root: Path, tmp_path: Path) -> None:
    script, *words = shlex.split(values(unit, key)[0].lstrip("-"))
    assert Path(script).is_relative_to("/")
    words = [str(tmp_path / word[1:]) if word.startswith("/") else word for word in words]
    file = next(Path(word) for word in words if word.endswith("alloff.conf"))
    file.parent.mkdir(parents=True)
    file.write_text("sprayer-alloff 1\nsimulated relay\nend\n")
    done = subprocess.run([f"{root}{script}", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "relay: simulated" in done.stderr
    assert "--verify" in words
    assert "--if-present" in words


def test_the_stop_is_given_more_time_than_all_off_can_take() -> None:
    told = dict(lines("sprayer.service"))
    assert float(told["TimeoutStopSec"].removesuffix("s")) >= 10.0
    assert values("sprayer-failed.service", "Type") == ["oneshot"]  # its steps run one after the other
