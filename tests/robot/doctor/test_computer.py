"""The computer that the robot runs on."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from robot.doctor import Level
from robot.doctor.computer import clock_synchronised, disk_finding

GIB = 2**30


@pytest.mark.parametrize(
    ("free", "total", "level", "code"),
    [(50 * GIB, 100 * GIB, Level.OK, 0), (5 * GIB, 100 * GIB, Level.WARN, 1), (10 * 2**20, 100 * GIB, Level.FAIL, 74)],
)
def test_a_full_disk_is_told_before_the_ledger_finds_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int, total: int, level: Level, code: int
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=free, total=total))
    finding = disk_finding(tmp_path)
    assert (finding.level, finding.code) == (level, code)
    assert (finding.remedy == "") == (level is Level.OK)


@pytest.mark.parametrize(("says", "means"), [("yes", True), ("no", False), ("", None)])
def test_the_clocks_source_is_what_systemd_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, says: str, means: bool | None
) -> None:
    program = tmp_path / "timedatectl"
    program.write_text(f"#!/bin/sh\necho {says}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    assert clock_synchronised() is means


def test_without_systemd_nothing_is_known_of_the_clocks_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert clock_synchronised() is None
