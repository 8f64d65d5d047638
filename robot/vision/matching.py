"""Left-right matching by row, section 3.4.2 of the paper."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]


def rectified(rig: StereoRig, left_px: npt.ArrayLike, right_px: npt.ArrayLike) -> tuple[Array, Array]:
    """Stored pixels (n, 2), (m, 2) to pixels of a common pair of views whose rows are epipolar lines.

    Both are undistorted and turned so that x lies along the baseline and z as near to the left camera's as can be; the
    common focal length is the mean of the rig's, the principal point is 0.
    """
    right_centre_m = -rig.R.T @ rig.t_m
    x = right_centre_m / np.linalg.norm(right_centre_m)
    y = np.cross([0.0, 0.0, 1.0], x)
    y /= np.linalg.norm(y)
    rectified_from_left = np.array([x, y, np.cross(x, y)])
    focal_px = mean_focal_px(rig.K_left, rig.K_right)
    views = []
    for undistorted, K, turn in (
        (rig.undistort_left(left_px), rig.K_left, rectified_from_left),
        (rig.undistort_right(right_px), rig.K_right, rectified_from_left @ rig.R.T),
    ):
        rays = np.column_stack([undistorted, np.ones(len(undistorted))]) @ np.linalg.inv(K).T @ turn.T
        views.append(rays[:, :2] / rays[:, 2:] * focal_px)
    return views[0], views[1]


def mean_focal_px(*matrices: Array) -> float:
    """The mean of fx and fy over camera matrices (3, 3)."""
    return float(np.mean([(K[0, 0], K[1, 1]) for K in matrices]))


def match_by_row(
    left: Array, right: Array, row_tolerance_px: float, disparity_px: tuple[float, float]
) -> list[tuple[int, int]]:
    """Pairs (left index, right index) of rectified points (n, 2), (m, 2): nearest rows first, each point once.

    A pair's rows differ by at most ``row_tolerance_px`` and its disparity u_l - u_r lies within ``disparity_px``.
    """
    row_distance = np.abs(left[:, None, 1] - right[None, :, 1])
    disparity = left[:, None, 0] - right[None, :, 0]
    fits = (row_distance <= row_tolerance_px) & (disparity >= disparity_px[0]) & (disparity <= disparity_px[1])
    pairs: list[tuple[int, int]] = []
    free_left, free_right = np.ones(len(left), dtype=bool), np.ones(len(right), dtype=bool)
    for flat in np.argsort(np.where(fits, row_distance, np.inf), axis=None, kind="stable"):
        i, j = divmod(int(flat), len(right))
        if not fits[i, j]:
            break
        if free_left[i] and free_right[j]:
            free_left[i] = free_right[j] = False
            pairs.append((i, j))
    return sorted(pairs)
