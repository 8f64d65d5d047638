import os
import stat
import tomllib

import pytest

from robot.errors import ConfigError, FileError
from robot.package_files import packaged
from robot.toml_values import difference, read_toml_text, with_numbers, write_toml_text

NEW = {"nozzle_flow_ml_s": 12.25, "valve_open_s": 0.031}
DEMO = packaged("configs") / "demo.toml"


def test_only_the_numbers_change_and_every_other_byte_stays():
    before = read_toml_text(DEMO)
    after = with_numbers(before, "fluid", NEW, "demo.toml")
    expected = before.replace("nozzle_flow_ml_s = 12.6 ", "nozzle_flow_ml_s = 12.25 ")
    assert after == expected.replace("valve_open_s = 0.025", "valve_open_s = 0.031")


@pytest.mark.parametrize(
    "text",
    [
        "[fluid]\r\na = 1.0\r\nvalve_open_s=0.02 # late\r\n  nozzle_flow_ml_s   =   12.6\r\n",
        "[other]\nvalve_open_s = 9.0\n[fluid] # wet\nvalve_open_s = 2e-2\nnozzle_flow_ml_s = 12",
        '[[row]]\nvalve_open_s = 1.0\n[ fluid ]\n"nozzle_flow_ml_s" = +12.6\n\tvalve_open_s = 0.0_2\n[task]\nx = 1\n',
        '[a]\ntext = """\n[fluid]\n"""\n[fluid]\nvalve_open_s = 1.0\nnozzle_flow_ml_s = 1.0\n',
    ],
)
def test_any_spelling_of_a_number_keeps_its_surroundings(text):
    after = with_numbers(text, "fluid", NEW, "x.toml")
    wanted = tomllib.loads(text)
    wanted["fluid"] |= NEW
    assert tomllib.loads(after) == wanted
    changed = [(a, b) for a, b in zip(text.splitlines(True), after.splitlines(True), strict=True) if a != b]
    assert len(changed) == 2
    for old, new in changed:
        assert old.partition("=")[0] == new.partition("=")[0]
        assert old.partition("#")[2] == new.partition("#")[2]
        assert old[len(old.rstrip("\r\n")) :] == new[len(new.rstrip("\r\n")) :]


@pytest.mark.parametrize(
    "text",
    [
        "[task]\nvalve_open_s = 0.02\nnozzle_flow_ml_s = 1.0\n",
        "fluid = { valve_open_s = 0.02, nozzle_flow_ml_s = 1.0 }\n",
        "fluid.valve_open_s = 0.02\nfluid.nozzle_flow_ml_s = 1.0\n",
        "[fluid]\nnozzle_flow_ml_s = 1.0\n#valve_open_s = 0.02\n",
        '[fluid]\nnozzle_flow_ml_s = 1.0\nvalve_open_s = "0.02"\n',
        '[fluid]\nx = """\nvalve_open_s = 0.02\n"""\nnozzle_flow_ml_s = 1.0\n',
        '[a]\nx = """\n[fluid]\nvalve_open_s = 0.02\nnozzle_flow_ml_s = 1.0\n"""\n[fluid]\ny = 1\n',
    ],
)
def test_what_cannot_be_changed_alone_is_refused_with_the_line_to_put_in(text):
    with pytest.raises(ConfigError, match="by hand"):
        with_numbers(text, "fluid", NEW, "x.toml")


def test_a_written_file_keeps_its_permissions_and_a_link_stays_a_link(tmp_path):
    (tmp_path / "real.toml").write_text("a = 1\r\n")
    os.chmod(tmp_path / "real.toml", 0o640)
    (tmp_path / "link.toml").symlink_to("real.toml")
    write_toml_text(tmp_path / "link.toml", "a = 2\r\n")
    assert (tmp_path / "link.toml").is_symlink()
    assert (tmp_path / "real.toml").read_bytes() == b"a = 2\r\n"
    assert stat.S_IMODE((tmp_path / "real.toml").stat().st_mode) == 0o640


def test_the_difference_is_shown_line_by_line():
    assert difference("a = 1\nb = 2\n", "a = 1\nb = 3\n", "x.toml").splitlines()[-2:] == ["-b = 2", "+b = 3"]
    assert difference("a = 1\n", "a = 1\n", "x.toml") == ""


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(FileError, match="cannot be read"):
        read_toml_text(tmp_path / "gone.toml")
    (tmp_path / "latin.toml").write_bytes(b"# \xe4\n")
    with pytest.raises(ConfigError, match="not UTF-8"):
        read_toml_text(tmp_path / "latin.toml")


def test_lists_of_numbers_are_changed_and_nothing_else():
    text = "[rig]\nside = 'left'\ncamera_xyz_m = [ -0.03, 0.05,0.88 ]  # metres\ncamera_rpy_rad = [0.0, 0.0, 1.5]\n"
    changed = with_numbers(text, "rig", {"camera_xyz_m": [0.1, -2e-05, 3.0]}, "x.toml")
    assert changed == text.replace("[ -0.03, 0.05,0.88 ]", "[0.1, -2e-05, 3.0]")


@pytest.mark.parametrize("value", ["[0.0, 'a']", "0.5", "[[0.0]]", "[\n0.0,\n1.0]", "[]"])
def test_what_is_no_list_of_numbers_on_one_line_is_refused_with_the_line_to_put_in(value):
    with pytest.raises(ConfigError, match=r"camera_xyz_m = \[numbers\].*by hand: camera_xyz_m = \[1.0, 2.0, 3.0\]"):
        with_numbers(f"[rig]\ncamera_xyz_m = {value}\n", "rig", {"camera_xyz_m": (1.0, 2.0, 3.0)}, "x.toml")
