"""The contract of a stereo camera."""

from __future__ import annotations

from typing import Protocol

from drivers.camera.values import StereoFrame


class StereoCamera(Protocol):
    """A stereo pair whose exposure stays as it was set last.

    Every method raises a ``DeviceError``; every wait ends in ``DeviceTimeout``.
    """

    @property
    def image_size(self) -> tuple[int, int]:
        """(width, height) of each view in pixels."""
        ...

    async def open(self) -> None: ...

    async def close(self) -> None: ...

    async def capture(self) -> StereoFrame:
        """A pair whose exposure began after this call."""
        ...

    async def set_exposure(self, exposure_s: float, gain: float) -> None:
        """Exposure in seconds and linear gain (>= 1) of the frames that follow; ``ValueError`` outside the bounds.

        ``DeviceRefused`` where the exposure is fixed (a recording).
        """
        ...
