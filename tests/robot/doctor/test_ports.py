"""Ports as the operating system shows them to a user who is not root, and among other programs."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers import port_lock
from robot.doctor import Finding, Level
from robot.doctor.ports import adapter_findings, port_findings

NOBODY = 65534
USB = os.makedev(188, 0)
AS_NOBODY = f"""
import encodings.ascii, json, os, sys  # what is imported later would have to be readable for nobody
from dataclasses import asdict
from robot.doctor.ports import port_findings
os.setgroups([]); os.setgid({NOBODY}); os.setuid({NOBODY})
print(json.dumps([asdict(finding) for finding in port_findings("arm", sys.argv[1])]))
"""


@pytest.fixture
def terminal() -> Iterator[str]:
    master, slave = pty.openpty()
    yield os.ttyname(slave)
    port_lock.lock_file(os.ttyname(slave)).unlink(missing_ok=True)
    os.close(master)
    os.close(slave)


def a_dead_holder(path: str) -> None:
    port_lock.lock_file(path).write_text(f"{99999999:10d}\n")


def by_what(findings: Iterator[Finding]) -> dict[str, Finding]:
    return {finding.what: finding for finding in findings}


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user to try it")
def test_a_port_that_the_user_may_not_open_fails_with_the_group_to_join(terminal: str) -> None:
    a_dead_holder(terminal)
    os.chmod(terminal, 0o600)
    done = subprocess.run(
        [sys.executable, "-c", AS_NOBODY, terminal], capture_output=True, text=True, timeout=60, check=True
    )
    (permission,) = [found for found in json.loads(done.stdout) if found["what"] == "permission"]
    assert (permission["level"], permission["code"]) == ("fail", 69)
    assert "dialout" in permission["remedy"]
    os.chmod(terminal, 0o666)
    done = subprocess.run(
        [sys.executable, "-c", AS_NOBODY, terminal], capture_output=True, text=True, timeout=60, check=True
    )
    assert [found["level"] for found in json.loads(done.stdout)] == ["ok", "ok"]


def test_a_stable_name_is_shown_with_the_device_behind_it(terminal: str, tmp_path: Path) -> None:
    link = tmp_path / "usb-arm"
    link.symlink_to(terminal)
    assert by_what(port_findings("arm", str(link)))["port"].found == f"{link} -> {terminal}"


def test_an_address_has_nothing_to_be_seen_from_here() -> None:
    (finding,) = port_findings("relay", "tcp://10.0.0.5:502")
    assert (finding.level, finding.found) == (Level.OK, "tcp://10.0.0.5:502")


def a_process(root: Path, number: int, name: str, *opened: str) -> None:
    folder = root / "proc" / str(number)
    (folder / "fd").mkdir(parents=True)
    (folder / "comm").write_text(name + "\n")
    for descriptor, path in enumerate(opened):
        (folder / "fd" / str(descriptor)).symlink_to(path)


def test_a_program_that_has_the_port_open_without_a_lock_is_named(tmp_path: Path) -> None:
    a_process(tmp_path, 71, "screen", "/dev/null", "/dev/ttyUSB0")
    a_process(tmp_path, 72, "cat", "/dev/ttyUSB1")
    found = by_what(adapter_findings("arm", "ttyUSB0", USB, tmp_path))
    assert (found["open in"].level, found["open in"].found) == (Level.WARN, "process 71 (screen)")
    assert "open in" not in by_what(adapter_findings("arm", "ttyUSB2", USB, tmp_path))


def test_brltty_is_told_to_go(tmp_path: Path) -> None:
    a_process(tmp_path, 71, "brltty")
    found = by_what(adapter_findings("arm", "ttyUSB0", USB, tmp_path))
    assert found["left alone"].level is Level.WARN
    assert found["left alone"].remedy == "apt remove brltty"


def test_a_port_that_nobody_probes_is_left_alone(tmp_path: Path) -> None:
    a_process(tmp_path, 71, "bash")
    assert by_what(adapter_findings("arm", "ttyUSB0", USB, tmp_path))["left alone"].level is Level.OK


def test_an_adapter_without_a_latency_timer_has_no_line_for_it(tmp_path: Path) -> None:
    assert "latency timer" not in by_what(adapter_findings("arm", "ttyACM0", USB, tmp_path))
