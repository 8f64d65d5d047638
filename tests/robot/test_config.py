import tomllib
from pathlib import Path

import pytest

from robot.config import Config, load_config
from robot.errors import ConfigError
from robot.mission import LightSettings
from robot.package_files import config_file, named_file, packaged
from robot.runtime.settings import dose_rules, light_settings
from robot.vision.light import ExposureBounds, LampPolicy, LightGoals
from robot.vision.values import Ripeness

DEMO = Path(__file__).parents[2] / "configs" / "demo.toml"


def _changed(tmp_path: Path, old: str, new: str) -> Path:
    text = DEMO.read_text()
    assert old in text
    path = tmp_path / "changed.toml"
    path.write_text(text.replace(old, new))
    return path


def test_the_demo_configuration_loads_and_is_simulated():
    config = load_config(DEMO)
    assert config.simulated
    assert config.fluid.nozzle_flow_ml_s == 12.6


def test_an_unknown_key_is_named_with_its_path_and_the_nearest_key(tmp_path):
    path = _changed(tmp_path, "max_ml = 12.0", "max_ml = 12.0\nmin_pulze_s = 0.1")
    with pytest.raises(ConfigError, match=r"unknown key 'dosing\.min_pulze_s'; did you mean 'min_pulse_s'\?"):
        load_config(path)


def test_an_unknown_key_without_a_neighbour_lists_the_known_ones(tmp_path):
    path = _changed(tmp_path, "max_ml = 12.0", "max_ml = 12.0\nzzz = 0.1")
    with pytest.raises(ConfigError, match=r"unknown key 'dosing\.zzz'; known keys here: coefficient, factor, hid"):
        load_config(path)


@pytest.mark.parametrize(
    ("old", "new", "path"),
    [
        ("valve_open_s = 0.025", "valve_open_s = 25", "fluid.valve_open_s"),  # ms for s
        ("radius_m = 0.10", "radius_m = 100", "wheels.radius_m"),  # mm for m
        ("cone_half_angle_rad = 0.2618", "cone_half_angle_rad = 15", "fluid.cone_half_angle_rad"),  # deg for rad
        ("pump_pressure_bar = 2.76", "pump_pressure_bar = 40", "fluid.pump_pressure_bar"),  # psi for bar
        ("coefficient = 0.02 ", "coefficient = nan ", "dosing.coefficient"),
        ("exposure_s = 0.004", "exposure_s = inf", "camera.exposure_s"),
        ('exposure = "auto"', 'exposure = "sometimes"', "camera.exposure"),
        ("gain = 1.0", "gain = 1.0\nmax_exposure_s = 20", "camera.max_exposure_s"),  # ms for s
        ("gain = 1.0", "gain = 1.0\nmains_hz = 55", "camera.mains_hz"),
        ("gain = 1.0", "gain = 1.0\ndark_signal = 0.5", "camera.dark_signal"),
        ('side = "left"', 'side = "up"', "rig.side"),
        ("green = 1.0", "green = 50", "dosing.factor.green"),  # per cent
        ('hidden = "minimum"', 'hidden = "maybe"', "dosing.hidden"),
        ("[targets]", "[targets]\nred_from = 75", "targets.red_from"),
        ('backend = "mock"\ncalibration', 'backend = "hardware"\ncalibration', "camera.backend"),
    ],
)
def test_an_impossible_value_is_named_with_its_path(tmp_path, old, new, path):
    with pytest.raises(ConfigError, match=path.replace(".", r"\.")):
        load_config(_changed(tmp_path, old, new))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("min_ml = 1.5", "min_ml = 12.5", "min_ml must not exceed max_ml"),
        ("max_shot_ml = 15.0", "max_shot_ml = 5.0", "exceeds safety.max_shot_ml"),
        ("pulse_max_s = 25.5", "pulse_max_s = 1.0", "the longest pulse that the board can time"),
        ("tank_fill_ml = 8000.0", "tank_fill_ml = 80000.0", "exceeds fluid.tank_ml"),
        ("valve = 1, pump = 2", "valve = 2, pump = 2", "two channels share one relay number"),
        ("datum_longitude_deg = 5.0", "", "datum_latitude_deg and datum_longitude_deg together"),
        ("max_speed_m_s = 0.4", "max_speed_m_s = 0.1", "cruise_speed_m_s exceeds"),
        ("green = 1.0", "green = 0", r"factor\.green is 0, but targets\.ripeness lists green"),
        ("min_ml = 1.5", "min_ml = 0.5", r"'minimum', but dosing\.min_ml \(0\.5\) is less than .* \(0\.94 ml in"),
        ('ripeness = ["red", "turning", "green"]', "ripeness = []", "nothing would be treated"),
        ("[targets]", "[targets]\nturning_from = 0.6", "red_from must be 0.2 or more above turning_from"),
    ],
)
def test_values_that_contradict_each_other_are_refused_with_the_reason(tmp_path, old, new, words):
    with pytest.raises(ConfigError, match=words):
        load_config(_changed(tmp_path, old, new))


def test_a_factor_for_a_ripeness_that_does_not_exist_names_the_nearest(tmp_path):
    path = _changed(tmp_path, "green = 1.0", "gren = 0.5")
    with pytest.raises(ConfigError, match=r"unknown key 'dosing\.factor\.gren'; did you mean 'green'\?"):
        load_config(path)


def test_a_ripeness_that_does_not_exist_names_the_nearest(tmp_path):
    path = _changed(tmp_path, '"red", "turning", "green"', '"red", "turnin"')
    with pytest.raises(ConfigError, match=r"'targets\.ripeness\.1'.*found 'turnin'; did you mean 'turning'\?"):
        load_config(path)


def test_a_factor_of_0_is_sound_for_fruit_that_is_not_treated(tmp_path):
    path = _changed(tmp_path, '"red", "turning", "green"', '"red", "turning"')
    path.write_text(path.read_text().replace("green = 1.0", "green = 0"))
    rules = dose_rules(load_config(path))
    assert rules.dose_ml(0.08, Ripeness.GREEN) == 0.0
    assert rules.dose_ml(0.08, Ripeness.RED) == pytest.approx(5.36, abs=0.01)


@pytest.mark.parametrize("lamp", ["on", "auto"])
def test_a_lamp_that_is_not_wired_cannot_be_asked_for(tmp_path, lamp, monkeypatch):
    monkeypatch.setenv("SPRAYER_CAMERA__LAMP", lamp)
    load_config(DEMO)
    with pytest.raises(ConfigError, match=r"relay\.channels names no lamp"):
        load_config(_changed(tmp_path, "lamp = 3, ", ""))


def test_the_light_of_a_mission_follows_from_the_camera_section(monkeypatch):
    light = light_settings(load_config(DEMO))
    assert (light.adjusts, light.lamp, light.bounds.mains_hz) == (True, LampPolicy.OFF, 50)
    assert not light.stops_when_dark
    for key, value in (
        ("EXPOSURE", "fixed"), ("LAMP", "auto"), ("MAINS_HZ", "60"), ("MAX_EXPOSURE_S", "0.05"), ("MAX_GAIN", "4"),
        ("DARK_SIGNAL", "0.01"), ("WHEN_DARK", "stop"), ("LAMP_BEYOND_S", "0.1"),
    ):  # fmt: skip
        monkeypatch.setenv(f"SPRAYER_CAMERA__{key}", value)
    light = light_settings(load_config(DEMO))
    assert light == LightSettings(
        LightGoals(dark_signal=0.01), ExposureBounds(longest_s=0.05, greatest_gain=4.0, mains_hz=60), False,
        LampPolicy.AUTO, 0.1, True,
    )  # fmt: skip


def test_a_usb_cameras_filter_says_which_mains_there_is(monkeypatch):
    rover = DEMO.with_name("rover.toml")
    monkeypatch.setenv("SPRAYER_CAMERA__POWER_LINE_HZ", "60")
    assert light_settings(load_config(rover)).bounds.mains_hz == 60
    monkeypatch.setenv("SPRAYER_CAMERA__MAINS_HZ", "0")
    assert light_settings(load_config(rover)).bounds.mains_hz == 0


def test_the_environment_overrides_a_single_value(monkeypatch):
    monkeypatch.setenv("SPRAYER_DOSING__MAX_ML", "7")
    assert load_config(DEMO).dosing.max_ml == 7.0


def test_a_wrong_key_in_the_environment_is_refused(monkeypatch):
    monkeypatch.setenv("SPRAYER_DOSING__MAXX_ML", "7")
    with pytest.raises(ConfigError, match=r"dosing\.maxx_ml"):
        load_config(DEMO)


def test_a_file_that_is_no_toml_is_named_with_the_line(tmp_path):
    path = tmp_path / "broken.toml"
    path.write_text("[robot]\nname = \n")
    with pytest.raises(ConfigError, match=r"broken\.toml: not valid TOML .*line 2"):
        load_config(path)


def test_a_missing_file_lists_the_configurations_that_came_along():
    with pytest.raises(ConfigError, match=r"no such configuration file.*demo\.toml"):
        load_config(Path("nowhere.toml"))


def test_a_packaged_configuration_is_found_from_any_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert config_file(Path("configs/demo.toml")) == packaged("configs") / "demo.toml"
    assert config_file(Path("demo.toml")) == packaged("configs") / "demo.toml"


def test_a_file_beside_the_configuration_wins_over_the_packaged_one(tmp_path):
    (tmp_path / "calibration").mkdir()
    mine = tmp_path / "calibration" / "demo.json"
    mine.write_text("{}")
    assert named_file("calibration/demo.json", tmp_path / "my.toml") == mine


def test_a_named_file_that_is_nowhere_is_an_error(tmp_path):
    with pytest.raises(ConfigError, match=r"names 'gone\.json'"):
        named_file("gone.json", tmp_path / "my.toml")


def test_the_hash_changes_with_any_value(tmp_path):
    changed = load_config(_changed(tmp_path, "max_ml = 12.0", "max_ml = 11.0"))
    assert changed.content_hash() != load_config(DEMO).content_hash()
    assert load_config(DEMO).content_hash() == load_config(DEMO).content_hash()


def test_the_models_are_frozen():
    config = Config(**tomllib.loads(DEMO.read_text()))
    with pytest.raises(ValueError, match="frozen"):
        config.dosing.max_ml = 100.0
