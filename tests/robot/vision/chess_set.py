"""The rendered calibration sequence that lies beside the project, with its truth."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from robot.calibration_file import load_rig
from robot.geometry import Transform
from robot.image_folder import Image, read_grey_image
from robot.vision.board_corners import Board
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]

GREENHOUSE = Path(os.environ.get("SPRAYER_SHARED", Path(__file__).parents[4] / "shared")) / "data/greenhouse"
BOARD = Board(7, 5, 0.03)
needs_chess_set = pytest.mark.skipif(
    not GREENHOUSE.is_dir(), reason="no greenhouse set: put it beside the project or set SPRAYER_SHARED"
)


def true_rig() -> StereoRig:
    return load_rig(GREENHOUSE / "calib_real.json")


def chess_images() -> Iterator[tuple[str, Image, Array]]:
    """Name, image and true corners (35, 2) of every left and right image."""
    rig = true_rig()
    for pose in json.loads((GREENHOUSE / "chess_poses.json").read_text())["poses"]:
        in_left = Transform(np.array(pose["R_board_to_left"]), np.array(pose["t_m"])).apply(BOARD.points_m())
        for side, project in (("left", rig.project_left), ("right", rig.project_right)):
            name = f"chess_{pose['index']:02d}_{side}"
            yield name, read_grey_image(GREENHOUSE / f"{name}.png"), project(in_left)
