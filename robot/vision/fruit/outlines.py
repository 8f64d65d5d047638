"""The outline of a sphere in the stored images."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]


def outline_circles(centre_m: Array, radius_m: float, rig: StereoRig) -> tuple[tuple[float, float, float], ...]:
    """The circle (u, v, r) of equal area to a sphere's outline in the stored left and right image."""
    turn = np.arange(32) * (2 * np.pi / 32)
    out = []
    for eye, project in ((np.zeros(3), rig.project_left), (-rig.R.T @ rig.t_m, rig.project_right)):
        to_centre = centre_m - eye
        distance = float(np.linalg.norm(to_centre))
        axis = to_centre / distance
        sine = min(radius_m / distance, 0.99)
        across = np.cross(axis, [0.0, 1.0, 0.0])
        across /= np.linalg.norm(across)
        down = np.cross(axis, across)
        rim_centre = eye + axis * distance * (1 - sine**2)
        rim = radius_m * np.sqrt(1 - sine**2)
        points = project(rim_centre + rim * (np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * down))
        u, v = points.mean(axis=0)
        x, y = (points - [u, v]).T
        area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
        out.append((float(u), float(v), float(np.sqrt(area / np.pi))))
    return tuple(out)
