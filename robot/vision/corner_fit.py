"""Corners of a chessboard by a fit of their own picture: two blurred edges that cross.

The brightness about a corner is ``level + slope . p + contrast * erf(q1) * erf(q2)`` with q1 and q2 the distances from
the two edges in units of their blur. Edges may bend (lens), shading may slope, and the two blurs may differ (motion).
Nearly all pixels of the four squares take part: the variance is about the least that they allow.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree
from scipy.special import erf

Array = npt.NDArray[np.float64]
GreyImage = npt.NDArray[np.uint8]
Smooth = npt.NDArray[np.float64]

_SMOOTH_PX = 0.5  # an edge along a row of pixels that no lens has blurred shows in one pixel only
_NEAR, _FAR = 0.40, 0.80  # of a square along either edge: a first fit, and how far the second looks
_FARTHEST_PX = 24.0
_LEAST_SHARE = 0.25  # of a square, however small it is in the picture
_NEXT_EDGE_PX = 2.5  # kept from the next edge, whose blur reaches that far
_ODD_SIGMAS, _ODD_CONTRAST = 5.0, 0.15  # a pixel inside a square so far off it shows something else: glare, the rim
_BESIDE_PX = 4.0  # what is that near to such a pixel may belong to the same thing
_SURE = 0.95  # of the contrast: so far from an edge
_STARTING_BLUR_PX = 1.2
_BLUR_PX = (0.3, 10.0)
_LEAST_CONTRAST = 4.0  # codes
_FARTHEST_MOVE = 0.35  # of the shorter side of a square
_ROUNDS = 25
_DONE_PX = 1e-3
_PARAMETERS = 12
_X, _Y, _TURN1, _TURN2, _BEND1, _BEND2, _BLUR1, _BLUR2, _LEVEL, _SLOPE_X, _SLOPE_Y, _CONTRAST = range(_PARAMETERS)


@dataclass(frozen=True, slots=True, eq=False)
class CornerFit:
    """``points_px`` (n, 2); ``sigma_px`` (n,) of the worse axis, from the pixels' noise; ``blur_px`` (n,) of the worse
    edge, one sigma of a Gaussian. A corner without a fit keeps its start and has infinite ``sigma_px``.
    """

    points_px: Array
    sigma_px: Array
    blur_px: Array


def fit_corners(image: GreyImage, start_px: Array, rows: int, columns: int) -> CornerFit:
    """Refine corners ``start_px`` (rows * columns, 2), row by row, that are good to about two pixels."""
    grid = start_px.reshape(rows, columns, 2)
    along, down = (np.asarray(np.gradient(grid, axis=axis)).reshape(-1, 2) for axis in (1, 0))
    points = start_px.astype(np.float64)
    sigma, blur = np.full(len(points), np.inf), np.full(len(points), np.inf)
    smooth = np.asarray(cv2.GaussianBlur(image.astype(np.float64), (0, 0), _SMOOTH_PX), dtype=np.float64)
    for index, (start, u, v) in enumerate(zip(start_px, along, down, strict=True)):
        found = _fit(smooth, start, u, v)
        if found is not None:
            points[index], sigma[index], blur[index] = found
    return CornerFit(points, sigma, blur)


def _fit(image: Smooth, start: Array, u: Array, v: Array) -> tuple[Array, float, float] | None:
    """Point, sigma and blur of the corner whose edges run along ``u`` and ``v``, each as long as a square."""
    offsets, codes = _window(image, start, u, v, _NEAR)
    near = None if len(codes) < 2 * _PARAMETERS else _begin(offsets, codes, u, v)
    near = None if near is None else _adjusted(near, offsets, codes)
    if near is None:
        return None
    noise = float(np.std(codes - _brightness(near, offsets)[0]))
    offsets, codes = _window(image, start, u, v, _FAR)
    plain = _plain(near, offsets, codes, max(_ODD_SIGMAS * noise, _ODD_CONTRAST * abs(float(near[_CONTRAST]))))
    offsets, codes = offsets[plain], codes[plain]
    fit = _adjusted(near, offsets, codes)
    if fit is None or np.hypot(fit[_X], fit[_Y]) > _FARTHEST_MOVE * min(np.linalg.norm(u), np.linalg.norm(v)):
        return None
    model, slopes = _brightness(fit, offsets)
    variance = float(np.sum((codes - model) ** 2)) / max(len(codes) - _PARAMETERS, 1)
    covariance = variance * np.linalg.pinv(slopes.T @ slopes)[:2, :2]
    sigma = float(np.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0)))
    blur = float(max(fit[_BLUR1], fit[_BLUR2])) / np.sqrt(2.0)
    return start + fit[:2], sigma, float(np.sqrt(max(blur**2 - _SMOOTH_PX**2, 0.0)))


def _window(image: Smooth, start: Array, u: Array, v: Array, share: float) -> tuple[Array, Array]:
    """Offsets from ``start`` (n, 2) and codes (n,) of the pixels in a parallelogram along both edges."""
    area = max(abs(float(u[0] * v[1] - u[1] * v[0])), 1e-6)
    u_length, v_length = float(np.linalg.norm(u)), float(np.linalg.norm(v))
    reach = _reach(u_length, area / v_length, share), _reach(v_length, area / u_length, share)
    half = np.abs(u) * reach[0] + np.abs(v) * reach[1]
    low = np.maximum(np.floor(start - half), 0).astype(int)
    high = np.minimum(np.ceil(start + half) + 1, image.shape[::-1]).astype(int)
    y, x = np.mgrid[low[1] : high[1], low[0] : high[0]]
    offsets = np.column_stack([x.ravel(), y.ravel()]) - start
    across_u = np.abs(offsets @ np.array([v[1], -v[0]])) / area
    across_v = np.abs(offsets @ np.array([u[1], -u[0]])) / area
    inside = (across_u <= reach[0]) & (across_v <= reach[1])
    codes = image[low[1] : high[1], low[0] : high[0]].ravel()[inside]
    return offsets[inside], codes


def _plain(fit: Array, offsets: Array, codes: Array, limit: float) -> npt.NDArray[np.bool_]:
    """Which pixels show the board and are not beside one that does not.

    An edge may run otherwise than ``fit`` foretells, the middle of a square may not.
    """
    model, slopes = _brightness(fit, offsets)
    odd = (np.abs(slopes[:, _CONTRAST]) > _SURE) & (np.abs(codes - model) > limit)
    if not odd.any():
        return ~odd
    away_px, _ = KDTree(offsets[odd]).query(offsets, distance_upper_bound=_BESIDE_PX)
    return np.asarray(np.isinf(away_px))


def _reach(side_px: float, between_edges_px: float, share: float) -> float:
    """How far to look along a side, as a share of it."""
    clear = 1.0 - _NEXT_EDGE_PX / between_edges_px
    return max(_LEAST_SHARE, min(share, clear, _FARTHEST_PX / side_px))


def _begin(offsets: Array, codes: Array, u: Array, v: Array) -> Array | None:
    """Parameters by the directions of the sides and a linear fit of the rest; None without contrast."""
    fit = np.zeros(_PARAMETERS)
    fit[_TURN1], fit[_TURN2] = np.arctan2(u[1], u[0]), np.arctan2(v[1], v[0])
    fit[_BLUR1] = fit[_BLUR2] = _STARTING_BLUR_PX
    fit[_CONTRAST] = 1.0
    edges = _brightness(fit, offsets)[0]
    shading = np.column_stack([np.ones(len(codes)), offsets, edges])
    fit[[_LEVEL, _SLOPE_X, _SLOPE_Y, _CONTRAST]] = np.linalg.lstsq(shading, codes, rcond=None)[0]
    return fit if abs(fit[_CONTRAST]) >= _LEAST_CONTRAST else None


def _adjusted(start: Array, offsets: Array, codes: Array) -> Array | None:
    """Least squares by Levenberg and Marquardt; None when the pixels do not determine the parameters."""
    fit, damping = start, 1e-3
    model, slopes = _brightness(fit, offsets)
    rest = codes - model
    for _ in range(_ROUNDS):
        normal = slopes.T @ slopes
        damped = normal + np.diag(damping * np.diag(normal) + 1e-12)
        try:
            tried = fit + np.linalg.solve(damped, slopes.T @ rest)
        except np.linalg.LinAlgError:
            return None
        tried[[_BLUR1, _BLUR2]] = np.clip(tried[[_BLUR1, _BLUR2]], *_BLUR_PX)
        model, tried_slopes = _brightness(tried, offsets)
        if not np.sum((codes - model) ** 2) <= np.sum(rest**2):
            damping *= 10.0
            continue
        moved = float(np.abs(tried[:2] - fit[:2]).max())
        fit, slopes, rest, damping = tried, tried_slopes, codes - model, damping / 10.0
        if moved < _DONE_PX:
            break
    return fit if np.isfinite(fit).all() and abs(fit[_CONTRAST]) >= _LEAST_CONTRAST else None


def _brightness(fit: Array, offsets: Array) -> tuple[Array, Array]:
    """The model's codes (n,) and their derivatives (n, 12) by the parameters."""
    x, y = offsets[:, 0] - fit[_X], offsets[:, 1] - fit[_Y]
    slopes = np.empty((len(x), _PARAMETERS))
    edges: list[tuple[Array, Array, Array]] = []
    for turn, bend, blur in ((_TURN1, _BEND1, _BLUR1), (_TURN2, _BEND2, _BLUR2)):
        cosine, sine = np.cos(fit[turn]), np.sin(fit[turn])
        along, across = cosine * x + sine * y, cosine * y - sine * x
        q = (across + fit[bend] * along**2) / fit[blur]
        bell = 2.0 / np.sqrt(np.pi) * np.exp(-(q**2)) / fit[blur]
        tilt = 2.0 * fit[bend] * along
        slopes[:, turn] = bell * (tilt * across - along)
        slopes[:, bend] = bell * along**2
        slopes[:, blur] = -bell * q
        edges.append((erf(q), bell * (sine - tilt * cosine), -bell * (cosine + tilt * sine)))
    (edge1, x1, y1), (edge2, x2, y2) = edges
    contrast = fit[_CONTRAST]
    slopes[:, _X], slopes[:, _Y] = contrast * (x1 * edge2 + edge1 * x2), contrast * (y1 * edge2 + edge1 * y2)
    slopes[:, [_TURN1, _BEND1, _BLUR1]] *= contrast * edge2[:, None]
    slopes[:, [_TURN2, _BEND2, _BLUR2]] *= contrast * edge1[:, None]
    slopes[:, _LEVEL], slopes[:, [_SLOPE_X, _SLOPE_Y]] = 1.0, offsets
    slopes[:, _CONTRAST] = edge1 * edge2
    model = fit[_LEVEL] + offsets @ fit[[_SLOPE_X, _SLOPE_Y]] + contrast * edge1 * edge2
    return model, slopes
