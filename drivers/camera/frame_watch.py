"""Looks at every pair for the camera's own faults, and remembers what one pair alone cannot tell."""

from __future__ import annotations

import math
import zlib
from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.camera import frame_checks as checks
from drivers.camera.epipolar import Misalignment, Rectifier, StereoCalibration, misalignment
from drivers.camera.frame_checks import Grey, PictureFault, ViewMeasures
from drivers.camera.values import StereoFrame
from drivers.camera.view_matching import Matches, match
from drivers.errors import DeviceFault

Array = npt.NDArray[np.float64]

_HASHED_ROWS = 8  # every eighth: the noise of a living sensor is in each

_WITHOUT_NOISE = frozenset({PictureFault.BLACK, PictureFault.WHITE})  # such pictures may well be identical
ALL_FAULTS = frozenset(PictureFault)
REMEDIES = {
    PictureFault.FROZEN: "unplug the camera and plug it in again",
    PictureFault.BLACK: "take the cap off the lens; if it is dark outside, switch on the lamp or expose longer",
    PictureFault.WHITE: "expose shorter, or shade the camera",
    PictureFault.COVERED: "clean the lens and take away what is before it",
    PictureFault.BLURRED: "clean the lens (dew, spray, dust); if it is clean, focus it and calibrate",
    PictureFault.UNEQUAL: "clean the darker lens and take away what is before it",
    PictureFault.SWAPPED: "change left and right in the configuration, or the two plugs",
    PictureFault.DECALIBRATED: "something has moved the lenses: fasten the camera and calibrate it again",
}


@dataclass(frozen=True, slots=True)
class Finding:
    """A fault, what was expected instead, and what was found."""

    fault: PictureFault
    expected: str
    found: str

    @property
    def remedy(self) -> str:
        return REMEDIES[self.fault]


class BadPicture(DeviceFault):
    """A fault that stays in the pictures; ``frame`` is the last of them."""

    def __init__(self, finding: Finding, frame: StereoFrame) -> None:
        super().__init__("camera", finding.expected, finding.found, finding.remedy)
        self.fault, self.frame = finding.fault, frame


class FrameWatch:
    """``look`` at pairs in their order. ``calibration`` None: whether it still holds is not watched.

    ``faults`` are those to look for: a recording that loops may well repeat a picture.
    """

    def __init__(
        self, calibration: StereoCalibration | None = None, faults: frozenset[PictureFault] = ALL_FAULTS
    ) -> None:
        self._rectify = None if calibration is None else Rectifier(calibration)
        self._faults = faults
        self._last_hash: int | None = None
        self._identical = 1
        self._pool: deque[tuple[Array, Array]] = deque(maxlen=checks.POOLED_FRAMES)
        self._suspect = False
        self.misalignment: Misalignment | None = None

    def look(self, frame: StereoFrame) -> Finding | None:
        """The first fault that this pair shows or completes. About 6 ms for 640x480."""
        frozen = self._frozen(frame)
        greys = checks.grey_of(frame.left), checks.grey_of(frame.right)
        unclear = self._unclear(*(checks.measure(grey) for grey in greys))
        if unclear is not None and unclear.fault in _WITHOUT_NOISE:
            return unclear
        return frozen or unclear or self._misplaced(*greys)

    @property
    def repeats(self) -> bool:
        """Whether the last pair was the same as the one before, which noise alone forbids."""
        return self._identical > 1

    @property
    def undecided(self) -> bool:
        """Whether the last pair by itself looks as if the lenses had moved, and more are needed to be sure."""
        return self._suspect and not self._enough

    @property
    def _enough(self) -> bool:
        return (
            len(self._pool) >= checks.LEAST_FRAMES and sum(len(left) for left, _ in self._pool) >= checks.ROW_MATCHES
        )

    def _frozen(self, frame: StereoFrame) -> Finding | None:
        if PictureFault.FROZEN not in self._faults:
            return None
        this = zlib.crc32(frame.right[::_HASHED_ROWS].tobytes(), zlib.crc32(frame.left[::_HASHED_ROWS].tobytes()))
        self._identical = self._identical + 1 if this == self._last_hash else 1
        self._last_hash = this
        if self._identical < checks.IDENTICAL_FRAMES:
            return None
        return Finding(PictureFault.FROZEN, "every picture to differ", f"{self._identical} identical ones in a row")

    def _unclear(self, left: ViewMeasures, right: ViewMeasures) -> Finding | None:
        for side, view in (("left", left), ("right", right)):
            fault = checks.fault_of_view(view)
            if fault is not None and fault in self._faults:
                return Finding(fault, "a clear picture", f"the {side} view {fault} ({_numbers(view)})")
        fault = checks.fault_between(left, right)
        if fault is None or fault not in self._faults:
            return None
        return Finding(fault, "two views alike", f"the left one {_numbers(left)}, the right one {_numbers(right)}")

    def _misplaced(self, left: Grey, right: Grey) -> Finding | None:
        if not self._faults & {PictureFault.SWAPPED, PictureFault.DECALIBRATED}:
            return None
        matches = match(left, right)
        return self._swapped(matches) or self._decalibrated(matches)

    def _swapped(self, matches: Matches) -> Finding | None:
        if PictureFault.SWAPPED not in self._faults or len(matches) < checks.SWAPPED_MATCHES:
            return None
        backwards = int(np.count_nonzero(matches.left[:, 0] < matches.right[:, 0]))
        if backwards < checks.SWAPPED_SHARE * len(matches):
            return None
        return Finding(
            PictureFault.SWAPPED, "the left view from the left lens",
            f"{backwards} of {len(matches)} points before the lens as only swapped views show them",
        )  # fmt: skip

    def _decalibrated(self, matches: Matches) -> Finding | None:
        if self._rectify is None or PictureFault.DECALIBRATED not in self._faults or len(matches) == 0:
            return None
        self._suspect_from(pair := self._rectify(matches), self._rectify.focal_px)
        self._pool.append(pair)
        if not self._enough:
            return None
        left, right = (np.concatenate(side) for side in zip(*self._pool, strict=True))
        self.misalignment = found = misalignment(left, right, self._rectify.focal_px)
        turned = len(left) >= checks.YAW_MATCHES and abs(found.yaw_rad) > checks.YAW_LIMIT_RAD
        if found.row_px <= checks.ROW_LIMIT_PX and not turned:
            return None
        pitch, yaw, roll = (math.degrees(turn) for turn in (found.pitch_rad, found.yaw_rad, found.roll_rad))
        return Finding(
            PictureFault.DECALIBRATED, f"points on the same row of both views to {checks.ROW_LIMIT_PX:g} px",
            f"{found.row_px:.1f} px apart, as if the right lens had turned by {pitch:.1f} deg in pitch, {yaw:.1f} in "
            f"yaw, {roll:.1f} in roll",
        )  # fmt: skip

    def _suspect_from(self, pair: tuple[Array, Array], focal_px: float) -> None:
        """One pair is too few to be sure. The first that is suspect begins a new pool: what moved has moved since."""
        few = len(pair[0]) < checks.SWAPPED_MATCHES
        suspect = not few and misalignment(*pair, focal_px).row_px > checks.SUSPECT_ROW_PX
        if suspect and not self._suspect:
            self._pool.clear()
        self._suspect = suspect


def _numbers(view: ViewMeasures) -> str:
    return f"mean {view.mean:.0f}, contrast {view.contrast:.1f}, sharpness {view.sharpness:.2f}"
