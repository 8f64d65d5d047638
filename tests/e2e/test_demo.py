"""``sprayer demo`` and ``sprayer report``: the table in the terminal and the page to look at."""

from __future__ import annotations

import contextlib
import io
import re
import shutil
from pathlib import Path
from typing import NamedTuple

import pytest

from robot.cli import run_command
from robot.ledger import LedgerReader

from .rover_process import short_row


class Shown(NamedTuple):
    config: Path
    out: Path
    text: str

    @property
    def table(self) -> list[str]:
        return [line for line in self.text.splitlines() if not line.startswith("report: ")]


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    folder = tmp_path_factory.mktemp("demo")
    return demo(short_row(folder), folder / "out")


def demo(config: Path, out: Path) -> Shown:
    return Shown(config, out, told(["demo", "--config", str(config), "--out", str(out), "--speed", "0"]))


def told(arguments: list[str]) -> str:
    """What a command that goes well prints."""
    with contextlib.redirect_stdout(io.StringIO()) as shown:
        assert run_command(arguments) == 0
    return shown.getvalue()


def test_the_demo_prints_the_result_and_where_the_report_is(first: Shown) -> None:
    assert f"report: {first.out / 'report.html'}" in first.text.splitlines()
    assert "demo-rover, seed 1, detector paper" in first.text
    for label in (
        "Fruits in the row", "seen", "sprayed twice", "Phantoms", "Liquid on the fruit", "Seconds a target",
        "Delivered against commanded", "Delivered against due", "Booked", "Delivered (truth)",
    ):  # fmt: skip
        assert label in first.text
    assert re.search(r"sprayed twice\W+0\b", first.text)
    assert re.search(r"  sprayed\W+[1-9]", first.text)


def test_the_same_seed_gives_the_same_table_and_a_new_demo_takes_the_place_of_a_former_one(
    first: Shown, tmp_path: Path
) -> None:
    out = tmp_path / "copy"
    shutil.copytree(first.out, out)
    (out / "frames" / "stop_099.jpg").write_bytes(b"of a longer row")
    (out / "notes.txt").write_text("mine")
    assert demo(first.config, out).table == first.table
    with LedgerReader.open_read_only(out / "ledger.sqlite") as ledger:
        assert len(ledger.tasks()) == 1
    assert not (out / "frames" / "stop_099.jpg").exists()
    assert (out / "notes.txt").read_text() == "mine"


def test_the_report_loads_nothing_from_outside(first: Shown) -> None:
    page = (first.out / "report.html").read_text(encoding="utf-8")
    assert page.lstrip().lower().startswith("<!doctype html>")
    addresses = set(re.findall(r"https?://[^\s\"'<>)]+", page))
    assert addresses <= {"http://www.w3.org/2000/svg"}  # a name, which nothing loads
    loaded = re.findall(r"(?:src|href)\s*=\s*[\"']?([^\"'\s>]+)", page)
    assert all(source.startswith(("data:", "#")) for source in loaded), loaded
    assert any(source.startswith("data:image/jpeg;base64,") for source in loaded)
    assert not re.search(r"@import|url\((?!#|['\"]?data:)", page)


def test_a_report_made_later_shows_the_demos_figures(first: Shown, tmp_path: Path) -> None:
    page = tmp_path / "later [1].html"
    truth = ["--truth", str(first.out / "truth.jsonl"), "--config", str(first.config)]
    again = told(["report", str(first.out / "ledger.sqlite"), "--out", str(page), *truth])
    assert f"report: {page}" in again.splitlines()
    lines = [line.split() for line in again.splitlines()]
    for label in ("Booked", "Delivered (truth)", "Liquid on the fruit", "Delivered against due", "sprayed twice"):
        (line,) = [line for line in first.text.splitlines() if label in line]
        assert line.split() in lines
    assert page.read_text(encoding="utf-8").count("data:image/jpeg;base64,") == 2
