"""Which fault of the catalogue an error of a device is."""

from __future__ import annotations

from drivers.camera.frame_checks import PictureFault
from drivers.camera.frame_watch import BadPicture
from drivers.errors import DeviceError
from robot.safety.failsafe import fault_of

PICTURE_FAULTS: dict[PictureFault, str] = {
    PictureFault.FROZEN: "F51",
    PictureFault.BLACK: "F52",
    PictureFault.WHITE: "F52",
    PictureFault.COVERED: "F52",
    PictureFault.BLURRED: "F52",
    PictureFault.UNEQUAL: "F52",
    PictureFault.SWAPPED: "F53",
    PictureFault.DECALIBRATED: "F54",
}


def fault_of_error(error: DeviceError) -> str:
    """By what the pictures show, or else by the device's name."""
    return PICTURE_FAULTS[error.fault] if isinstance(error, BadPicture) else fault_of(error.device)
