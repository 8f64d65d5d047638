"""What the driver of a USB stereo camera is told."""

from __future__ import annotations

from dataclasses import dataclass, field

from drivers.camera.controls import Control, GainScale
from drivers.camera.pictures import PixelFormat


@dataclass(frozen=True, slots=True)
class StereoUsbSettings:
    """``places``: one side-by-side device, or the left and the right one. ``image_size`` (width, height) of each view.

    ``latency_s`` is from the end of an exposure to its grab (readout and transfer; the test card measures it). At least
    ``in_flight_frames`` that arrive after a call are discarded, as they may have been exposed before it, and
    ``settle_frames`` more after the controls changed. Two devices' frames make a pair when they arrive within
    ``pair_apart_s``. ``swapped``: the side-by-side picture has the right view on its left. ``white_balance_k`` and
    ``power_line_hz`` None are left as they are. ``may_differ``: controls that need not keep their value. ``controlled``
    False: a bare stream, whose exposure is as given here and fixed.
    """

    places: tuple[str, ...]
    image_size: tuple[int, int]
    exposure_s: float
    gain: float = 1.0
    pixel_format: PixelFormat = "MJPG"
    rate_hz: float = 15.0
    white_balance_k: float | None = None
    power_line_hz: int | None = 50
    gain_scale: GainScale = field(default_factory=GainScale)
    latency_s: float = 0.03
    in_flight_frames: int = 1
    settle_frames: int = 2
    pair_apart_s: float = 0.010
    frame_timeout_s: float = 0.5
    swapped: bool = False
    controlled: bool = True
    may_differ: frozenset[Control] = field(default_factory=frozenset)

    def __post_init__(self) -> None:
        if len(self.places) not in (1, 2) or len(set(self.places)) != len(self.places):
            raise ValueError(f"places: expected one device or two different ones, found {self.places}; name them")
        if self.in_flight_frames < 1:
            raise ValueError(f"in_flight_frames: expected at least 1, found {self.in_flight_frames}; one is always")
