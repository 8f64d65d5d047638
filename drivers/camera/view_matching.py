"""Points that both views show, found cheaply: enough to tell which is left, and whether the calibration holds."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Grey = npt.NDArray[np.uint8]
Array = npt.NDArray[np.float64]
Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]

COARSE = 4  # full pixels a coarse one
_POINTS = 48
_HALF = 5  # of a template, coarse pixels
_REACH = 30  # to either side, coarse pixels: a disparity of 120 px
_SLACK = 4  # up and down, coarse pixels
_LIKENESS = 0.80  # normalised correlation
_DISTINCT = 0.08  # that much better than the best on the other side of zero
_WINDOW = (15, 15)
_RETURNS_PX = 0.5  # there and back again


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """(n, 2) pixels of the same points in the left and in the right view, to a fraction of a pixel."""

    left: Array
    right: Array

    def __len__(self) -> int:
        return len(self.left)


def match(left: Grey, right: Grey) -> Matches:
    """Matches of corners of the left view, searched for on both sides so that swapped views match as well."""
    near = _coarse(_small(left), _small(right))
    if len(near) == 0:
        return near
    return _refined(left, right, _full(near.left), _full(near.right))


def _small(view: Grey) -> Grey:
    height, width = view.shape
    small = cv2.resize(view, (width // COARSE, height // COARSE), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def _full(coarse: Array) -> Floats:
    """Coarse pixels to those of the whole view; centres of pixels are at whole numbers in both."""
    return np.asarray((coarse + 0.5) * COARSE - 0.5, dtype=np.float32)


def _coarse(left: Grey, right: Grey) -> Matches:
    height, width = left.shape
    corners = cv2.goodFeaturesToTrack(left, _POINTS, 0.01, 6, useHarrisDetector=False)
    pairs: list[tuple[int, int, int, int]] = []
    for x, y in np.empty((0, 2)) if corners is None else corners.reshape(-1, 2).astype(int):
        if not (_HALF <= x < width - _HALF and _HALF + _SLACK <= y < height - _HALF - _SLACK):
            continue
        x0, x1 = max(0, x - _HALF - _REACH), min(width, x + _HALF + _REACH + 1)
        y0 = y - _HALF - _SLACK
        template = left[y - _HALF : y + _HALF + 1, x - _HALF : x + _HALF + 1]
        likeness = cv2.matchTemplate(right[y0 : y + _HALF + _SLACK + 1, x0:x1], template, cv2.TM_CCOEFF_NORMED)
        row, column = divmod(int(likeness.argmax()), likeness.shape[1])
        best, found = float(likeness[row, column]), x0 + column + _HALF
        here = x - _HALF - x0  # the column without disparity
        other = likeness[:, :here] if found > x else likeness[:, here + 1 :]
        if best >= _LIKENESS and best - float(other.max(initial=-1.0)) >= _DISTINCT:
            pairs.append((x, y, found, y0 + row + _HALF))
    found_all = np.array(pairs, dtype=np.float64).reshape(-1, 4)
    return Matches(found_all[:, :2], found_all[:, 2:])


def _refined(left: Grey, right: Grey, begin: Floats, guess: Floats) -> Matches:
    there, found = _follow(left, right, begin, guess)
    back, returned = _follow(right, left, there, begin)
    near_guess = np.abs(there - guess).max(axis=1) <= 1.5 * COARSE
    good = found & returned & near_guess & (np.hypot(*(back - begin).T) <= _RETURNS_PX)
    return Matches(begin[good].astype(np.float64), there[good].astype(np.float64))


def _follow(one: Grey, other: Grey, points: Floats, guess: Floats) -> tuple[Floats, Bools]:
    """Where the points of one view are in the other (Lucas and Kanade), and whether they were found."""
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        one, other, points, guess.copy(), winSize=_WINDOW, maxLevel=1,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 15, 0.02), flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )  # fmt: skip
    return np.asarray(there, dtype=np.float32), np.asarray(found, dtype=np.bool_).ravel()
