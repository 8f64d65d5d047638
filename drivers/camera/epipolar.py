"""Whether matches lie where the calibration says: on the same rectified row; and if not, how the eyes have turned."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np
import numpy.typing as npt

from drivers.camera.view_matching import Matches

Array = npt.NDArray[np.float64]

_TRIMMED_SHARE = 0.10  # of the matches, the worst: wrong ones
_ROUNDS = 5
_HUBER_PX = 0.5
SHIFT_LIMIT_PX = 0.5
LEAST_MATCHES = 30
_UNSURE = 0.4  # of the limit: one sigma of a judgement
_CERTAIN = 4.0  # sigmas


@dataclass(frozen=True, slots=True, eq=False)
class StereoCalibration:
    """A calibrated pair: ``x_right = R x_left + t_m`` (metres), ``image_size`` (width, height), ``dist_*`` as OpenCV.

    It may come from the camera itself; it is a fact about the optics, not about the world.
    """

    image_size: tuple[int, int]
    K_left: Array
    dist_left: Array
    K_right: Array
    dist_right: Array
    R: Array
    t_m: Array


class Rectifier:
    """Pixels of both views to rectified rays: (n, 2) x/z, y/z in two frames whose rows agree."""

    def __init__(self, calibration: StereoCalibration) -> None:
        self._calibration = calibration
        R_left, R_right, P_left, *_ = cv2.stereoRectify(
            calibration.K_left, calibration.dist_left, calibration.K_right, calibration.dist_right,
            calibration.image_size, calibration.R, calibration.t_m.reshape(3, 1),
        )  # fmt: skip
        self._R_left, self._R_right = np.asarray(R_left, dtype=np.float64), np.asarray(R_right, dtype=np.float64)
        self.focal_px = float(P_left[1, 1])

    def __call__(self, matches: Matches) -> tuple[Array, Array]:
        if len(matches) == 0:
            return matches.left, matches.right
        c = self._calibration
        return (
            _rays(matches.left, c.K_left, c.dist_left, self._R_left),
            _rays(matches.right, c.K_right, c.dist_right, self._R_right),
        )


def _rays(pixels: Array, K: Array, dist: Array, R: Array) -> Array:
    return np.asarray(cv2.undistortPoints(pixels.reshape(-1, 1, 2), K, dist, R=R), dtype=np.float64).reshape(-1, 2)


class Verdict(StrEnum):
    """Whether a calibration still describes the lenses."""

    HOLDS = "holds"
    DECALIBRATED = "decalibrated"
    UNSURE = "cannot be told"


@dataclass(frozen=True, slots=True)
class Misalignment:
    """How matches miss their rows: ``row_px`` the mean of |y_left - y_right|, the worst tenth left out.

    ``pitch_rad``, ``yaw_rad``, ``roll_rad``: by how much the right eye has turned about its x, y and z. ``shift_px`` is
    what that turn moves the points off their rows (root mean square), without the noise of matching. A turn about y
    shifts every disparity, by ``disparity_px``, and shows only in the corners of the picture. ``*_sigma_px`` are one
    sigma of the two; ``matches`` is how many points there were.
    """

    row_px: float
    pitch_rad: float
    yaw_rad: float
    roll_rad: float
    shift_px: float
    shift_sigma_px: float
    disparity_px: float
    disparity_sigma_px: float
    matches: int

    def verdict(self, limit_px: float = SHIFT_LIMIT_PX) -> Verdict:
        """Decalibrated when points lie more than ``limit_px`` off their rows, or disparities by twice that."""
        if self.matches < LEAST_MATCHES or self.shift_sigma_px > _UNSURE * limit_px:
            return Verdict.UNSURE
        yaw_px = abs(self.disparity_px)
        if self.shift_px > limit_px or (yaw_px > 2.0 * limit_px and yaw_px > _CERTAIN * self.disparity_sigma_px):
            return Verdict.DECALIBRATED
        return Verdict.HOLDS

    def __str__(self) -> str:
        pitch, yaw, roll = (math.degrees(turn) for turn in (self.pitch_rad, self.yaw_rad, self.roll_rad))
        return (
            f"rows {self.shift_px:.2f} px off (one sigma {self.shift_sigma_px:.2f}, {self.matches} points), as if the "
            f"right lens had turned by {pitch:.2f} deg in pitch, {yaw:.2f} in yaw, {roll:.2f} in roll"
        )


def misalignment(left: Array, right: Array, focal_px: float) -> Misalignment:
    """By rectified rays (n, 2) of the same points; n >= 3."""
    missed = right[:, 1] - left[:, 1]
    sizes = np.sort(np.abs(missed))
    kept = sizes[: max(1, round((1.0 - _TRIMMED_SHARE) * len(sizes)))]
    x, y = right[:, 0], right[:, 1]
    # a small turn (wx, wy, wz) of the eye moves the ray (x, y) by dy = (1 + y^2) wx - x y wy - x wz
    design = np.column_stack([1.0 + y * y, -x * y, -x])
    turn: Array = np.zeros(3)
    weight: Array = np.ones(len(x))
    for _ in range(_ROUNDS):
        rest_px = focal_px * np.abs(missed - design @ turn)
        weight = np.sqrt(np.minimum(1.0, _HUBER_PX / np.maximum(rest_px, 1e-9)) * (rest_px < 8.0 * _HUBER_PX))
        if np.count_nonzero(weight) < 3:
            weight = np.ones(len(x))
        turn = np.asarray(np.linalg.lstsq(design * weight[:, None], missed * weight, rcond=None)[0])
    noise_px = 1.4826 * focal_px * float(np.median(np.abs(missed - design @ turn)))
    used = design[weight > 0.0]
    yaw_variance = float(np.linalg.pinv(used.T @ used)[1, 1])
    return Misalignment(
        row_px=focal_px * float(kept.mean()),
        pitch_rad=float(turn[0]),
        yaw_rad=float(turn[1]),
        roll_rad=float(turn[2]),
        shift_px=focal_px * float(np.sqrt(np.mean((used @ turn) ** 2))),
        shift_sigma_px=noise_px * math.sqrt(3.0 / len(used)),  # three parameters
        disparity_px=focal_px * float(turn[1]),
        disparity_sigma_px=noise_px * math.sqrt(yaw_variance),
        matches=len(x),
    )
