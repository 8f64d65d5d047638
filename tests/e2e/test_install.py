"""``sprayer install``: may be repeated, says what it does, leaves what is the operator's, takes back what it put."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from robot.cli import run_command
from robot.config import load_config

USAGE, IO = 64, 74
PROGRAM = "/opt/sprayer/bin/sprayer"
UNIT = "etc/systemd/system/sprayer.service"
CONFIG = "etc/sprayer/rover.toml"
RULES = "etc/udev/rules.d/60-sprayer-ports.rules"
ALLOFF = "usr/lib/sprayer/sprayer-alloff"
LINK = "usr/local/bin/sprayer-alloff"


def install(root: Path, *more: str, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """The lines that a successful run said."""
    assert run_command(["install", "--root", str(root), "--program", PROGRAM, *more]) == 0
    return capsys.readouterr().out.splitlines()


def tree(root: Path) -> dict[str, tuple[int, bytes]]:
    return {
        str(path.relative_to(root)): (path.stat().st_mode & 0o777, path.read_bytes())
        for path in root.rglob("*")
        if path.is_file() and not path.is_symlink()
    }


def test_everything_is_there_and_calls_this_computers_programs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = install(tmp_path, "--python", "/opt/python/bin/python3", capsys=capsys)
    assert f"write {tmp_path / UNIT}" in said
    unit = (tmp_path / UNIT).read_text()
    assert f"ExecStart={PROGRAM} run --config /etc/sprayer/rover.toml" in unit
    assert "/usr/bin/sprayer" not in unit
    assert (tmp_path / ALLOFF).read_text().startswith("#!/opt/python/bin/python3 -IS\n")
    assert os.access(tmp_path / ALLOFF, os.X_OK)
    assert os.readlink(tmp_path / LINK) == f"/{ALLOFF}"
    assert sorted(tree(tmp_path)) == [
        CONFIG, "etc/systemd/system/sprayer-failed.service", UNIT, "etc/sysusers.d/sprayer.conf",
        "etc/tmpfiles.d/sprayer.conf", RULES, ALLOFF,
    ]  # fmt: skip
    assert not [line for line in said if line.startswith("run ")]  # a staging root asks no systemd


def test_the_example_configuration_is_a_valid_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    install(tmp_path, capsys=capsys)
    assert load_config(tmp_path / CONFIG).robot.run_directory == Path("/var/lib/sprayer")


def test_a_second_run_changes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    install(tmp_path, capsys=capsys)
    before = tree(tmp_path)
    said = install(tmp_path, capsys=capsys)
    assert [line for line in said[:8] if not line.startswith("unchanged ")] == []
    assert tree(tmp_path) == before


def test_an_update_writes_its_own_files_and_keeps_yours(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    install(tmp_path, capsys=capsys)
    (tmp_path / UNIT).write_text("old")
    (tmp_path / ALLOFF).chmod(0o600)
    (tmp_path / CONFIG).write_text("# mine\n")
    (tmp_path / RULES).write_text("# my adapters\n")
    said = install(tmp_path, capsys=capsys)
    assert f"update {tmp_path / UNIT}" in said
    assert f"update {tmp_path / ALLOFF}" in said
    assert [line.split(" (")[0] for line in said if line.startswith("keep")] == [
        f"keep {tmp_path / RULES}", f"keep {tmp_path / CONFIG}"
    ]  # fmt: skip
    assert (tmp_path / CONFIG).read_text() == "# mine\n"
    assert "sprayer run" in (tmp_path / UNIT).read_text()
    assert os.access(tmp_path / ALLOFF, os.X_OK)


@pytest.mark.parametrize("more", [(), ("--uninstall",)])
def test_a_dry_run_says_each_thing_and_does_none(
    more: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if more:
        install(tmp_path, capsys=capsys)
    before = tree(tmp_path)
    said = install(tmp_path, "--dry-run", *more, capsys=capsys)
    assert sum(line.startswith("would ") for line in said) == 8
    assert tree(tmp_path) == before


def test_uninstalling_leaves_nothing_of_an_untouched_installation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install(tmp_path, capsys=capsys)
    install(tmp_path, "--uninstall", capsys=capsys)
    assert tree(tmp_path) == {}
    assert not (tmp_path / LINK).is_symlink()
    assert install(tmp_path, "--uninstall", capsys=capsys) == []


def test_uninstalling_leaves_what_is_yours(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    install(tmp_path, capsys=capsys)
    ledger = tmp_path / "var/lib/sprayer/ledger.sqlite"
    ledger.parent.mkdir(parents=True)
    ledger.write_text("doses")
    (tmp_path / CONFIG).write_text("# mine\n")
    (tmp_path / LINK).unlink()
    (tmp_path / LINK).write_text("not from here")
    install(tmp_path, "--uninstall", capsys=capsys)
    assert sorted(tree(tmp_path)) == [CONFIG, LINK, "var/lib/sprayer/ledger.sqlite"]


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--root", "{tmp}/nowhere"], IO, "no such folder"),
        (["--root", "{tmp}", "--program", "bin/sprayer"], USAGE, "whole paths"),
        (["--root", "{tmp}", "--program", "/opt/my sprayer"], USAGE, "plain path"),
        (["--root", "{tmp}", "--program", "/opt/%n"], USAGE, "plain path"),
        (["--dry-run", "--program", "/nowhere/sprayer"], USAGE, "no program there"),
        (["--dry-run", "--program", "{tmp}/sprayer"], USAGE, "the service is kept out of /tmp"),
    ],
)
def test_what_the_service_could_not_start_is_refused(
    arguments: list[str], code: int, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sprayer").write_text("#!/bin/sh\n")
    (tmp_path / "sprayer").chmod(0o755)
    assert run_command(["install", *(argument.format(tmp=tmp_path) for argument in arguments)]) == code
    shown = capsys.readouterr()
    assert words in shown.err
    assert "write" not in shown.out


def test_without_root_it_says_so(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert run_command(["install"]) == USAGE
    shown = capsys.readouterr()
    assert "sudo sprayer install" in shown.err
    assert shown.out == ""
