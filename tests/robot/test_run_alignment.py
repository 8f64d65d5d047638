"""A mission tells in its ledger whether the calibration that it works with holds."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from robot.calibration_file import load_rig
from robot.clock import run_virtual
from robot.config import Config
from robot.events import Bus
from robot.geometry import rotation_from_rpy
from robot.ledger import LedgerReader
from robot.package_files import packaged
from robot.runtime import RunOptions, ledger_path, run_robot
from robot.runtime.devices import make_twin
from robot.runtime.settings import load_arm, load_row
from robot.vision.stereo_rig import StereoRig
from robot.vision.values import Fruit
from tests.robot.mission.rover import DEMO, configuration


class Blind:
    """Finds no fruit: the rover looks, and drives on."""

    def detect(self, left: object, right: object, rig: object) -> tuple[Fruit, ...]:
        return ()


def said_of_the_camera(folder: Path, true_rig: StereoRig, config: Config) -> list[str]:
    """A row of ten stops with a camera whose lenses are those of ``true_rig``."""
    _, urdf = load_arm(config, DEMO)
    options = RunOptions(DEMO, folder / "run", True, False, None)
    twin = make_twin(config, load_row(config, DEMO), true_rig, urdf, None)
    run_virtual(run_robot(config, options, Bus(), detector=Blind(), twin=twin))  # type: ignore[arg-type]
    with LedgerReader.open_read_only(ledger_path(options.folder)) as ledger:
        return [event.text for event in ledger.events("camera")]


def test_the_ledger_of_a_run_tells_a_calibration_that_holds_and_one_off_by_a_pixel(tmp_path: Path) -> None:
    config = configuration(tmp_path, (0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0), 2.4, "left", {})
    rig = load_rig(packaged("configs") / "calibration/demo.json")
    turn = rotation_from_rpy(1.0 / float(rig.K_left[0, 0]), 0.0, 0.0)
    (tmp_path / "true").mkdir()
    (tmp_path / "turned").mkdir()
    (holds,) = said_of_the_camera(tmp_path / "true", rig, config)
    assert holds.startswith("calibration holds: rows 0.0")
    (turned,) = said_of_the_camera(tmp_path / "turned", replace(rig, R=turn @ rig.R, t_m=turn @ rig.t_m), config)
    told = re.match(r"calibration decalibrated: rows ([\d.]+) px off", turned)
    assert told is not None
    assert 0.8 < float(told[1]) < 1.7  # leaves of the twin are drawn to whole pixels, real ones give 1.0 to 1.1
