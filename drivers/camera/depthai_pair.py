"""What the depthai library gives, in our own values: calibration, synchronised pairs, and what can go wrong with them.

The library is imported by ``load`` only, so that nothing of it is needed where no OAK camera is used.
"""

from __future__ import annotations

import importlib
import os
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.camera.epipolar import StereoCalibration
from drivers.camera.values import Image
from drivers.errors import DeviceFault, DeviceMissing, WrongDevice

Array = npt.NDArray[np.float64]

_SEARCH_MS = "500"
_ISO_AT_GAIN_1 = 100.0
_LEFT, _RIGHT = "left", "right"


def load() -> Any:
    """The library, silent and without its telemetry. ``DeviceMissing`` when it is not installed."""
    os.environ["DEPTHAI_TELEMETRY"] = "0"
    os.environ["DEPTHAI_INSTALL_SIGNAL_HANDLER"] = "0"  # it would end the process on a full disk (SIGXFSZ) and the like
    os.environ["DEPTHAI_SEARCH_TIMEOUT"] = _SEARCH_MS
    os.environ.setdefault("DEPTHAI_LEVEL", "off")
    try:
        return importlib.import_module("depthai")
    except ImportError as error:
        raise DeviceMissing(
            "camera", "the depthai library", f"none ({error})", "install it: pip install 'sprayer[oak]'"
        ) from error


@dataclass(frozen=True, slots=True, eq=False)
class OakPair:
    """A pair with the camera's own word on it: ``middle_s`` of the exposure is on the host's monotonic clock."""

    left: Image
    right: Image
    middle_s: float
    exposure_s: float
    gain: float


def iso_of(gain: float) -> int:
    return round(_ISO_AT_GAIN_1 * gain)


def add_sync(dai: Any, pipeline: Any, apart_s: float) -> Any:
    """The library's own node that makes pairs of what comes to its inputs ``left`` and ``right``, on this machine."""
    sync = pipeline.create(dai.node.Sync)
    sync.setRunOnHost(True)
    sync.setSyncThreshold(timedelta(seconds=apart_s))
    sync.setSyncAttempts(-1)  # a frame without a partner is left out
    return sync


def sync_inputs(sync: Any) -> tuple[Any, Any]:
    return sync.inputs[_LEFT], sync.inputs[_RIGHT]


def pair_of(dai: Any, group: Any) -> OakPair:
    """The pair in a message of the sync node. ``DeviceFault`` for views of different sizes or none."""
    left, right = group[_LEFT], group[_RIGHT]
    views = [np.asarray(frame.getCvFrame(), dtype=np.uint8) for frame in (left, right)]
    if views[0].shape != views[1].shape or views[0].ndim != 3 or 0 in views[0].shape:
        raise DeviceFault(
            "camera", "two colour views of one size", f"{views[0].shape} and {views[1].shape}", "restart the camera"
        )
    middle = dai.CameraExposureOffset.MIDDLE
    return OakPair(
        views[0], views[1],
        middle_s=min(frame.getTimestamp(middle).total_seconds() for frame in (left, right)),
        exposure_s=left.getExposureTime().total_seconds(),
        gain=left.getSensitivity() / _ISO_AT_GAIN_1,
    )  # fmt: skip


def sockets(dai: Any, features: list[Any]) -> tuple[Any, Any]:
    """The sockets of the left and the right eye. ``WrongDevice`` unless both have a colour sensor."""
    eyes = dai.CameraBoardSocket.CAM_B, dai.CameraBoardSocket.CAM_C
    by_socket = {feature.socket: feature for feature in features}
    for name, socket in zip((_LEFT, _RIGHT), eyes, strict=True):
        feature = by_socket.get(socket)
        kinds = [] if feature is None else list(feature.supportedTypes)
        if dai.CameraSensorType.COLOR not in kinds:
            found = "no sensor" if feature is None else f"{feature.sensorName}, which sees no colour"
            raise WrongDevice(
                "camera", f"a colour sensor as the {name} eye ({socket.name})", found,
                "use a model whose stereo pair is in colour (OV9782), such as the OAK-D Pro W with colour or the SR",
            )  # fmt: skip
    return eyes


def calibration_of(dai: Any, handler: Any, size: tuple[int, int]) -> StereoCalibration:
    """The stereo calibration in a camera's memory for pictures of ``size`` (scaled to fill it, the rest cut off).

    Metres. Lens distortion is OpenCV's, without the zeros at the end. ``DeviceFault`` when there is none in the memory,
    or one of a lens model that OpenCV's ``dist`` does not hold.
    """
    left, right = dai.CameraBoardSocket.CAM_B, dai.CameraBoardSocket.CAM_C
    try:
        matrices = []
        for socket in (left, right):
            if handler.getDistortionModel(socket) != dai.CameraModel.Perspective:
                raise _no_calibration(f"that of a {handler.getDistortionModel(socket).name} lens")
            K, width, height = handler.getDefaultIntrinsics(socket)
            dist = np.asarray(handler.getDistortionCoefficients(socket), dtype=np.float64)
            matrices.append((scaled_K(np.asarray(K, dtype=np.float64), (width, height), size), _trimmed(dist)))
        pose = np.asarray(handler.getCameraExtrinsics(left, right, False, dai.LengthUnit.METER), dtype=np.float64)
    except RuntimeError as error:
        raise _no_calibration(str(error)) from error
    (K_left, dist_left), (K_right, dist_right) = matrices
    if not np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-3) or not pose[0, 3] < 0.0:
        raise _no_calibration(f"a right eye at {(-pose[:3, :3].T @ pose[:3, 3]).round(3).tolist()} m of the left")
    return StereoCalibration(size, K_left, dist_left, K_right, dist_right, pose[:3, :3], pose[:3, 3])


def scaled_K(K: Array, native: tuple[int, int], size: tuple[int, int]) -> Array:
    """The camera matrix of pictures scaled to fill ``size`` and cut to it in the middle; pixel centres at integers."""
    scale = max(size[0] / native[0], size[1] / native[1])
    out = K.copy()
    out[:2] *= scale
    for axis in (0, 1):
        cut = 0.5 * (native[axis] * scale - size[axis])
        out[axis, 2] = (K[axis, 2] + 0.5) * scale - 0.5 - cut
    return out


def _trimmed(dist: Array) -> Array:
    """Without the zeros at the end, in one of the lengths that OpenCV takes."""
    used = int(np.max(np.flatnonzero(dist), initial=-1)) + 1
    length = next(length for length in (5, 8, 12, 14) if length >= used)
    return np.concatenate([dist, np.zeros(14)])[:length]


def _no_calibration(found: str) -> DeviceFault:
    return DeviceFault(
        "camera", "the stereo calibration in the camera's memory", found,
        "calibrate with sprayer calibrate camera, and name that file",
    )  # fmt: skip
