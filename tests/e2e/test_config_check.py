"""``sprayer config check``: what is configured, and everything that is wrong with it."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot.cli import run_command

from .rover_process import DEMO, short_row
from .test_bad_input import CONFIG, Told, refused

__all__ = ["refused"]


@pytest.mark.parametrize("name", ["demo.toml", "emulated.toml", "rover.toml"])
def test_every_configuration_that_comes_along_is_sound(name: str, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert run_command(["config", "check", str(DEMO.parent / name)]) == 0
    told = capsys.readouterr().out
    for device in ("camera", "arm", "relay", "inputs", "gps", "modem", "wheels"):
        assert f" {device} " in told
    assert "row A: 10 stops" in told
    assert told.rstrip().endswith("sound")


def test_it_shows_back_ends_and_ports(capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert run_command(["config", "check", "rover.toml"]) == 0
    told = capsys.readouterr().out
    for words in ("dynamixel", "/dev/sprayer-arm", "waveshare-8", "zlac8015d", "shoulder 2+3", "valve 1, pump 2"):
        assert words in told


def test_it_shows_what_each_fruit_would_get(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    config = short_row(
        tmp_path,
        **{
            'ripeness = ["red", "turning", "green"]': 'ripeness = ["red", "green"]\nturning_from = 0.3',
            "green = 1.0": "green = 0.5",
            'hidden = "minimum"': 'hidden = "estimate"',
        },
    )
    assert run_command(["config", "check", str(config)]) == 0
    told = capsys.readouterr().out
    sizes = next(line.split("┃") for line in told.splitlines() if "80 mm" in line)
    column = [cell.strip() for cell in sizes].index("80 mm")
    cells = {line.split("│")[1].strip(): line.split("│")[column].strip() for line in told.splitlines() if "│" in line}
    assert cells["red, factor 1"] == "5.36"  # 0.02 ml a cm3, 268 cm3
    assert cells["green, factor 0.5"] == "2.68"
    assert cells["turning, not treated"] == "–"
    assert "turning from a score of 0.3, red from 0.75" in told
    assert "too hidden to measure: the dose of the estimated diameter less one sigma" in told


def test_a_secret_is_not_shown(capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("SPRAYER_MODEM__PIN", "7391")
    assert run_command(["config", "check", "rover.toml"]) == 0
    told = capsys.readouterr()
    assert "7391" not in told.out + told.err


def test_nothing_is_opened_and_nothing_is_written(tmp_path: Path, monkeypatch) -> None:
    config = short_row(tmp_path)
    before = sorted(path.name for path in tmp_path.rglob("*"))
    monkeypatch.chdir(tmp_path)
    assert run_command(["config", "check", str(config)]) == 0
    assert sorted(path.name for path in tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("replaced", "words"),
    [
        ({"max_ml = 12.0": "max_ml = 12.0\nmin_pulze_s = 1"}, ("'dosing.min_pulze_s'", "did you mean 'min_pulse_s'?")),
        (
            {"valve_open_s = 0.025": "valve_open_s = 25", "hour = 12.0": "hour = 3.0"},
            ("'fluid.valve_open_s'", "'twin.hour'"),
        ),
        (
            {"arms/viperx300_nozzle.urdf": "arms/gone.urdf", "calibration/demo.json": "calibration/gone.json"},
            ("names 'arms/gone.urdf'", "names 'calibration/gone.json'"),
        ),
        (
            {"green = 1.0": "gren = 0.5", '"turning", "green"]': '"turning", "gren"]'},
            ("unknown key 'dosing.factor.gren'; did you mean 'green'?", "found 'gren'; did you mean 'green'?"),
        ),
        ({"green = 1.0": "green = 0.0"}, ("dosing.factor.green is 0", "take 'green' out of targets.ripeness")),
        (
            {"image_size_px = [640, 480]": "image_size_px = [800, 600]", "routes/short.toml": "routes/gone.toml"},
            ("640x480 pixels, the camera gives 800x600", "names 'routes/gone.toml'"),
        ),
    ],
)
def test_everything_that_is_wrong_is_told_at_once(tmp_path: Path, refused: Told, replaced, words) -> None:
    config = short_row(tmp_path)
    text = config.read_text()
    for old, new in replaced.items():
        assert old in text, old
        text = text.replace(old, new)
    config.write_text(text)
    refused(run_command(["config", "check", str(config)]), CONFIG, *words)


def test_servos_that_do_not_fit_the_arm_are_told_without_a_servo_at_hand(tmp_path: Path, refused: Told) -> None:
    config = tmp_path / "mine.toml"
    config.write_text((DEMO.parent / "rover.toml").read_text().replace("wrist_angle = {", "wrist_angel = {"))
    refused(run_command(["config", "check", str(config)]), CONFIG, "arm.servos", "wrist_angel")


def test_a_board_that_no_profile_knows_is_told(tmp_path: Path, refused: Told) -> None:
    config = tmp_path / "mine.toml"
    config.write_text((DEMO.parent / "rover.toml").read_text().replace('"waveshare-8"', '"waveshare-9"'))
    refused(run_command(["config", "check", str(config)]), CONFIG, "waveshare-9")


def test_a_file_that_is_not_there_is_told(refused: Told) -> None:
    refused(run_command(["config", "check", "gone.toml"]), CONFIG, "gone.toml: no such configuration file")
