"""A camera whose every pair is looked at before anybody gets it."""

from __future__ import annotations

from collections.abc import Callable

from drivers.camera.frame_checks import PictureFault
from drivers.camera.frame_watch import BadPicture, FrameWatch
from drivers.camera.interface import StereoCamera
from drivers.camera.values import StereoFrame

PERSISTS_S = 1.0  # a fault that stays for that long is told; a fly before the lens is waited for

SURE_AT_ONCE = frozenset({PictureFault.FROZEN, PictureFault.DECALIBRATED})  # found over several pairs already


class WatchedCamera:
    """Implements ``drivers.camera.interface.StereoCamera`` around another; ``clock`` gives loop time.

    ``capture`` gives only pairs in which the watch finds nothing. A pair with a fault is taken again; a fault that
    stays is a ``BadPicture`` (a ``DeviceFault``) that names it and its remedy.
    """

    def __init__(self, camera: StereoCamera, watch: FrameWatch, clock: Callable[[], float]) -> None:
        self.camera, self.watch = camera, watch
        self._clock = clock

    @property
    def image_size(self) -> tuple[int, int]:
        return self.camera.image_size

    async def open(self) -> None:
        await self.camera.open()

    async def close(self) -> None:
        await self.camera.close()

    async def set_exposure(self, exposure_s: float, gain: float) -> None:
        await self.camera.set_exposure(exposure_s, gain)

    async def capture(self) -> StereoFrame:
        since_s: float | None = None
        while True:
            frame = await self.camera.capture()
            finding = self.watch.look(frame)
            if finding is None and not (self.watch.repeats or self.watch.undecided):
                return frame
            if finding is None:
                continue  # the next pairs tell whether it is frozen, or the lenses have moved
            since_s = self._clock() if since_s is None else since_s
            if finding.fault in SURE_AT_ONCE or self._clock() - since_s >= PERSISTS_S:
                raise BadPicture(finding, frame)
