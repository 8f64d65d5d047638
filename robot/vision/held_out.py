"""How good a calibration is on views that it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot.vision.board_corners import Board
from robot.vision.board_pose import estimate_board_pose
from robot.vision.board_scale import measure_board
from robot.vision.camera_calibration import MIN_VIEWS, BoardView, calibrate_stereo
from robot.vision.stereo_rig import StereoRig

FOLDS = 5
MUCH_WORSE = 1.6  # times the error of the views that were used
MUCH_WORSE_PX = 0.03


@dataclass(frozen=True, slots=True)
class RigErrors:
    """A rig judged by views: ``rms_px`` distance of corners from where the best pose of the board puts them.

    ``scale_rms`` the share by which the triangulated board is too large or too small; ``square_rms_m`` the error of a
    square's side and ``flatness_rms_m`` that of the plane, root mean squares over the views.
    """

    views: int
    rms_px: float
    scale_rms: float
    square_rms_m: float
    flatness_rms_m: float


@dataclass(frozen=True, slots=True)
class HeldOut:
    """``used`` is the error on the views that made each calibration, ``held_out`` on those that did not."""

    used: RigErrors
    held_out: RigErrors

    @property
    def much_worse(self) -> bool:
        """Whether the calibration has learnt its views rather than the lenses."""
        return (
            self.held_out.rms_px > MUCH_WORSE * self.used.rms_px
            and self.held_out.rms_px > self.used.rms_px + MUCH_WORSE_PX
        )


def hold_out(views: Sequence[BoardView], board: Board, image_size: tuple[int, int]) -> HeldOut:
    """Calibrate on all but a fifth of the views (all but one of fewer than ten) in turn, and judge by those left out.

    Views that follow each other are held out together: a burst of alike ones must not judge itself. Raises
    ``ValueError`` for fewer than four views, and when what is left does not determine the rig.
    """
    if len(views) <= MIN_VIEWS:
        raise ValueError(f"at least {MIN_VIEWS + 1} views are needed to hold one out, found {len(views)}")
    folds = FOLDS if len(views) >= 2 * FOLDS else len(views)
    used: list[RigErrors] = []
    held: list[RigErrors] = []
    for chunk in np.array_split(np.arange(len(views)), folds):
        out = [views[index] for index in chunk]
        rest = [view for index, view in enumerate(views) if index not in chunk]
        rig = calibrate_stereo(rest, board, image_size).rig
        used.append(judge_rig(rest, board, rig))
        try:
            held.append(judge_rig(out, board, rig))
        except ValueError as error:
            names = ", ".join(view.name for view in out)
            raise ValueError(
                f"the views but for {names} say nothing of these: {error}; add views like these"
            ) from error
    return HeldOut(_pooled(used), _pooled(held))


def judge_rig(views: Sequence[BoardView], board: Board, rig: StereoRig) -> RigErrors:
    """``ValueError`` without views, and for corners that fit no board before the camera."""
    if not views:
        raise ValueError("at least one view of the board is needed to judge a calibration, found none")
    poses = [estimate_board_pose(view, board, rig) for view in views]
    scales = [measure_board(view, board, rig) for view in views]
    return RigErrors(
        views=len(views),
        rms_px=_rms([pose.rms_px for pose in poses]),
        scale_rms=_rms([scale.scale_error for scale in scales]),
        square_rms_m=_rms([scale.square_rms_m for scale in scales]),
        flatness_rms_m=_rms([scale.flatness_rms_m for scale in scales]),
    )


def _pooled(folds: Sequence[RigErrors]) -> RigErrors:
    counts = [fold.views for fold in folds]

    def pooled(values: Sequence[float]) -> float:
        return float(np.sqrt(np.average(np.square(values), weights=counts)))

    return RigErrors(
        views=sum(counts),
        rms_px=pooled([fold.rms_px for fold in folds]),
        scale_rms=pooled([fold.scale_rms for fold in folds]),
        square_rms_m=pooled([fold.square_rms_m for fold in folds]),
        flatness_rms_m=pooled([fold.flatness_rms_m for fold in folds]),
    )


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
