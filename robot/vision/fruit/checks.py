"""Pictures that no fruit can be sought in are refused, with the reason."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from robot.vision.stereo_rig import StereoRig

Image = npt.NDArray[np.uint8]

LEAST_SIDE_PX = 32
BLACK_CODE = 3
"""A picture in which nothing is brighter is black, were it night or not: read noise alone goes beyond it."""


def check_image(image: Image, name: str = "the") -> None:
    """Raise ``ValueError`` unless it is (height, width, 3) of uint8, in colour, and shows something."""
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise ValueError(
            f"expected {name} image as (height, width, 3) uint8 BGR, found {image.shape} of {image.dtype}; "
            "convert it first"
        )
    if min(image.shape[:2]) < LEAST_SIDE_PX:
        raise ValueError(
            f"expected {name} image to be at least {LEAST_SIDE_PX} x {LEAST_SIDE_PX} pixels, "
            f"found {image.shape[1]} x {image.shape[0]}"
        )
    few = image[::8, ::8]
    if int(few.max()) <= BLACK_CODE and int(image.max()) <= BLACK_CODE:
        raise ValueError(
            f"expected {name} image to show something, found it black (nothing above code {BLACK_CODE}); "
            "uncover the lens, or expose longer"
        )
    if np.array_equal(few[..., 0], few[..., 1]) and np.array_equal(few[..., 1], few[..., 2]) and few.std() > 1.0:
        raise ValueError(
            f"expected {name} image in colour, found all three channels equal; set the camera to colour: ripe and "
            "green fruit are told apart by it"
        )


def check_pair(left: Image, right: Image, rig: StereoRig) -> None:
    """Raise ``ValueError`` unless both images are of the rig's size, in colour and not black, and the rig is finite."""
    for name, image in (("the left", left), ("the right", right)):
        check_image(image, name)
        if (image.shape[1], image.shape[0]) != tuple(rig.image_size):
            raise ValueError(
                f"expected {name} image of {rig.image_size[0]} x {rig.image_size[1]} pixels like the rig, "
                f"found {image.shape[1]} x {image.shape[0]}; use the calibration made at this size"
            )
    for field in ("K_left", "K_right", "dist_left", "dist_right", "R", "t_m"):
        if not np.isfinite(getattr(rig, field)).all():
            raise ValueError(f"expected finite numbers in the rig's {field}, found nan or infinity; calibrate again")
