"""The page is whole, asks for nothing from outside, and says what the ledger says."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from robot.commands.report import load_truth, report
from robot.errors import FileError
from robot.ledger import Ledger, LedgerReader
from robot.report import kind_rows, light_rows, read_evidence, render
from robot.targets import TargetState
from robot.vision.light import LightState
from tests.robot.ledger.rows import INTENT, LIGHT, NOON, SPRAYED, STOP, TASK, started, target
from tests.robot.report.sprayed_row import write_frame, write_ledger, write_truth

TOO_HIDDEN_SHOT = "too hidden to measure: minimum dose"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_ledger(tmp_path / "ledger.sqlite")
    write_truth(tmp_path / "truth.jsonl")
    write_frame(tmp_path / "frames")
    return tmp_path


def make(folder: Path, *options: str) -> str:
    app = typer.Typer()
    app.command()(report)
    result = CliRunner().invoke(app, [str(folder / "ledger.sqlite"), *options], catch_exceptions=False)
    assert result.exit_code == 0
    assert "Result" in result.output
    return (folder / "report.html").read_text(encoding="utf-8")


def drawings(page: str) -> list[ET.Element]:
    return [ET.fromstring(text) for text in re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL)]


def test_page_refers_to_nothing_outside_itself(folder: Path) -> None:
    page = make(folder, "--truth", str(folder / "truth.jsonl"))
    assert not re.search(r"https?://|<script|<link|@import|url\(", page)
    assert set(re.findall(r'src="([^:]+):', page)) == {"data"}


def test_every_target_is_drawn_to_scale_in_both_views(folder: Path) -> None:
    views = [svg for svg in drawings(make(folder)) if svg.get("role") == "img"][:2]
    for view in views:
        discs = [c for c in view.iter("circle") if "true" not in (c.get("class") or "").split()]
        radii = sorted(float(c.get("r") or 0) for c in discs)
        assert len(discs) == 4
        assert radii[0] / radii[-1] == pytest.approx(0.06 / 0.08, rel=0.02)
        assert {c.get("class") for c in discs} == {"sprayed", "unreachable"}


def test_all_that_is_drawn_lies_inside_its_drawing(folder: Path) -> None:
    for svg in drawings(make(folder, "--truth", str(folder / "truth.jsonl"))):
        left, top, width, height = (float(v) for v in (svg.get("viewBox") or "").split())
        for circle in svg.iter("circle"):
            x, y = float(circle.get("cx") or 0), float(circle.get("cy") or 0)
            assert left <= x <= left + width
            assert top <= y <= top + height
        for bar in svg.iter("rect"):
            assert float(bar.get("height") or -1) >= 0.0
            assert top <= float(bar.get("y") or 0) <= top + height


def test_true_fruits_are_outlined_and_the_one_never_found_is_marked(folder: Path) -> None:
    page = make(folder, "--truth", str(folder / "truth.jsonl"))
    assert page.count('class="true known"') == 2 * 3
    assert page.count('class="true missed"') == 2 * 1 + 1
    assert "never found; at best 30 % visible" in page
    assert "phantom" in page


def test_frames_travel_in_the_page(folder: Path) -> None:
    assert make(folder).count("data:image/jpeg;base64,") == 1
    assert "data:image" not in make(folder, "--frames", str(folder))


def test_without_truth_the_page_tells_what_the_robot_knows(folder: Path) -> None:
    page = make(folder)
    assert "Delivered" not in page
    assert "Targets found" in page


def test_with_a_configuration_the_dose_is_judged_by_its_law(folder: Path) -> None:
    page = make(folder, "--truth", str(folder / "truth.jsonl"), "--config", "demo.toml")
    found = re.search(r"due of the true fruit, median</th><td>([\d.]+) %", page)
    assert found is not None
    assert float(found.group(1)) > 0.0


def test_a_pending_shot_is_shown_as_its_full_pulse(tmp_path: Path) -> None:
    ledger, task_id = started(tmp_path / "ledger.sqlite")
    ledger.write_intent(task_id, INTENT)
    page = render(read_evidence(ledger), None, None, None)
    ledger.close()
    assert "pending" in page
    assert "6.30 ml of it pending" in page


def test_a_task_that_sprayed_nothing_has_a_page(tmp_path: Path) -> None:
    with Ledger.open(tmp_path / "ledger.sqlite", utc=lambda: NOON) as ledger:
        ledger.begin_run("boot", NOON)
        ledger.begin_task(TASK)
        page = render(read_evidence(ledger), None, None, None)
    assert "Nothing was sprayed." in page


def test_factor_ripeness_and_the_reason_of_a_dose_are_shown(tmp_path: Path) -> None:
    ledger, task_id = started(tmp_path / "ledger.sqlite")
    hidden = replace(target(1, TargetState.SPRAYED), measured=False, diameter_m=0.063)
    ledger.upsert_targets(task_id, [hidden, target(2, TargetState.SPRAYED)])
    ledger.write_result(
        ledger.write_intent(task_id, replace(INTENT, factor=1.0, reason=TOO_HIDDEN_SHOT)), SPRAYED
    )
    ledger.write_result(
        ledger.write_intent(task_id, replace(INTENT, target_id=2, factor=0.5, reason="")),
        replace(SPRAYED, reason="cut by a stop"),
    )
    evidence = read_evidence(ledger)
    page = render(evidence, None, None, None)
    ledger.close()
    rows = [re.sub(r"<[^>]*>", "|", row) for row in re.findall(r"<tr>.*?</tr>", page, flags=re.DOTALL)]
    first, second = (next(row for row in rows if f"|{words}|" in row) for words in (TOO_HIDDEN_SHOT, "cut by a stop"))
    assert "|turning 0.55|" in first
    assert "|~63|" in first
    assert "|80|" in second
    assert "|0.50|" in second
    told = dict(kind_rows(evidence))
    per_cm3 = 5.0 / (math.pi / 6.0 * 8.0**3)
    assert told == {
        "Turning fruit": f"2 of 3 sprayed, 10.0 ml, {per_cm3:.4f} ml/cm3, factor 0.50, 1 too hidden to measure"
    }
    assert told["Turning fruit"] in page


def test_names_from_outside_cannot_inject_markup(tmp_path: Path) -> None:
    with Ledger.open(tmp_path / "ledger.sqlite", utc=lambda: NOON) as ledger:
        ledger.begin_run("boot", NOON)
        task_id = ledger.begin_task(replace(TASK, product="<script>alert(1)</script>"))
        ledger.upsert_targets(task_id, [replace(target(), reason="a<b> & c")])
        page = render(read_evidence(ledger), None, None, None)
    assert "<script>" not in page
    assert "a&lt;b&gt; &amp; c" in page


def test_another_task_of_the_ledger_can_be_chosen(folder: Path) -> None:
    with Ledger.open(folder / "ledger.sqlite", utc=lambda: NOON) as ledger:
        ledger.begin_run("boot-3", NOON)
        ledger.begin_task(replace(TASK, route="second"))
    assert "row “second”" in make(folder)
    assert "row “demo”" in make(folder, "--task", "1")


def test_wrong_paths_are_named(folder: Path) -> None:
    with pytest.raises(FileError, match="no such folder"):
        make(folder, "--frames", str(folder / "none"))
    with pytest.raises(FileError, match="cannot be read"):
        load_truth(folder / "none")
    (folder / "broken").write_text("{}\n")
    with pytest.raises(FileError, match=r"line 1.*sprayer run --truth"):
        load_truth(folder / "broken")


def test_a_report_of_a_robot_at_work_can_be_made(tmp_path: Path) -> None:
    ledger, _ = started(tmp_path / "ledger.sqlite")
    with LedgerReader.open_read_only(ledger.path) as reader:
        assert "<html" in render(read_evidence(reader), None, None, None)
    ledger.close()


def test_the_light_of_every_stop_is_told_and_where_it_was_not_trusted(tmp_path: Path) -> None:
    ledger, task_id = started(tmp_path / "ledger.sqlite")
    dark = replace(LIGHT, state=LightState.DARK, plant_level=0.004, lamp=False, remark="no plants seen")
    for number, light in enumerate((None, LIGHT, dark), start=1):
        ledger.record_stop(task_id, replace(STOP, stop=number, light=light))
    evidence = read_evidence(ledger)
    assert light_rows(evidence) == (
        ("Light at the stops", "dim 1, dark 1"),
        ("plants, of full scale", "0.4 to 3.1 %"),
        ("lamp lit at", "1 of 2"),
        ("not looked for fruit, light not to be trusted", "1 of 2"),
    )
    page = render(evidence, None, None, None)
    ledger.close()
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr><td.*?</tr>", page, flags=re.DOTALL)]
    assert ["4", "dim", "3.1", "20.0", "8.0", "lit", "backlight"] in [row[4:] for row in rows]
    assert ["4", "dark", "0.4", "20.0", "8.0", "off", "no plants seen"] in [row[4:] for row in rows]
    assert ["4", "grey 102 of 255"] in [row[4:] for row in rows]
    assert "not looked for fruit, light not to be trusted" in page


def test_a_row_of_an_older_program_has_no_light_to_tell_of(folder: Path) -> None:
    with LedgerReader.open_read_only(folder / "ledger.sqlite") as ledger:
        assert light_rows(read_evidence(ledger)) == ()
