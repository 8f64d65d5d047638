"""How likely each pixel is to be the skin of a tomato, from chroma, light and texture at several scales."""

from __future__ import annotations

import cv2
import numpy as np

from robot.vision.fruit.network import Network, sigmoid
from robot.vision.fruit.planes import Plane, Planes, chroma

FEATURES = 24


def skin_features(planes: Planes) -> Plane:
    """(h * w, FEATURES) inputs of the pixel network."""
    width, height = planes.size
    out = np.empty((FEATURES, width * height), dtype=np.float32)
    fine = cv2.GaussianBlur(planes.light, (0, 0), 1.3)
    quarter = _down(planes.light, 4)
    middle = cv2.GaussianBlur(quarter, (0, 0), 0.8)
    coarse = cv2.GaussianBlur(quarter, (0, 0), 2.5)
    logs = [planes.log_light]
    for k, light in enumerate((planes.light, fine, middle, coarse)):
        red_green, yellow_blue, log_light = (
            (planes.red_green, planes.yellow_blue, planes.log_light) if k == 0 else chroma(light, planes.dark)
        )
        out[2 * k] = _up(red_green, (width, height)).ravel()
        out[2 * k + 1] = _up(yellow_blue, (width, height)).ravel()
        if k:
            logs.append(_up(log_light, (width, height)))
    out[8] = (logs[0] - logs[3]).ravel()
    out[9] = (logs[0] - logs[2]).ravel()
    out[10] = (logs[1] - logs[3]).ravel()
    out[11] = (logs[2] - np.float32(logs[3].mean())).ravel()
    fine_log = np.log(fine.sum(axis=2) + np.float32(3 * planes.dark))
    energy = _gradient_size(fine_log)
    out[12] = cv2.blur(energy, (5, 5)).ravel()
    out[13] = cv2.blur(energy, (13, 13)).ravel()
    fine_red, fine_yellow, _ = chroma(fine, planes.dark)
    out[14] = cv2.blur(_gradient_size(fine_yellow), (7, 7)).ravel()
    out[15] = np.median(out[2, ::7])
    out[16] = np.median(out[3, ::7])
    for k, side in enumerate((9, 15, 25)):
        out[17 + k] = _spread(fine_log, side).ravel()
    out[20] = _spread(fine_red, 9).ravel()
    out[21] = _spread(fine_yellow, 9).ravel()
    grain = np.abs(planes.log_light - cv2.GaussianBlur(planes.log_light, (0, 0), 1.0))
    out[22] = cv2.blur(grain, (9, 9)).ravel()
    bend = cv2.Laplacian(_down(fine_log, 4), cv2.CV_32F)
    out[23] = _up(np.abs(bend), (width, height)).ravel()
    return out.T


def skin_map(planes: Planes, network: Network) -> Plane:
    """(h, w) probability of fruit skin."""
    width, height = planes.size
    return np.asarray(sigmoid(network.logits(skin_features(planes))[:, 0]).reshape(height, width))


def _down(light: Plane, factor: int) -> Plane:
    height, width = light.shape[:2]
    size = (max(2, width // factor), max(2, height // factor))
    return np.asarray(cv2.resize(light, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _up(plane: Plane, size: tuple[int, int]) -> Plane:
    if (plane.shape[1], plane.shape[0]) == size:
        return plane
    return np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR), dtype=np.float32)


def _spread(plane: Plane, side: int) -> Plane:
    """Standard deviation over a square."""
    mean = cv2.blur(plane, (side, side))
    return np.sqrt(np.maximum(cv2.blur(plane * plane, (side, side)) - mean * mean, 0.0))


def _gradient_size(plane: Plane) -> Plane:
    x, y = cv2.Scharr(plane, cv2.CV_32F, 1, 0), cv2.Scharr(plane, cv2.CV_32F, 0, 1)
    return np.asarray(np.sqrt(x * x + y * y) / 32, dtype=np.float32)  # cv2.magnitude differs from run to run
