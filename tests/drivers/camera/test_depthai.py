"""Calibration and synchronisation on the real library, without a device. (The hardware has its test card.)"""

from __future__ import annotations

import asyncio
import importlib.util
import os
import time
from datetime import timedelta
from typing import Any

import numpy as np
import pytest

from drivers.camera import depthai_pair
from drivers.camera.depthai import DepthAiCamera, DepthAiSettings
from drivers.camera.depthai_pair import add_sync, calibration_of, load, pair_of, scaled_K, sockets, sync_inputs
from drivers.camera.epipolar import Rectifier
from drivers.camera.view_matching import Matches
from drivers.errors import DeviceFault, DeviceLost, DeviceMissing, WrongDevice
from tests.drivers.camera.rig import run

needs_depthai = pytest.mark.skipif(
    importlib.util.find_spec("depthai") is None, reason="depthai is not installed (pip install 'sprayer[oak]')"
)
SIZE = (640, 480)
K_LEFT = [[800.0, 0.0, 641.0], [0.0, 801.0, 402.0], [0.0, 0.0, 1.0]]
K_RIGHT = [[810.0, 0.0, 632.0], [0.0, 811.0, 395.0], [0.0, 0.0, 1.0]]
TURN = 0.02  # about y


def eeprom(dai: Any, **changes: Any) -> Any:
    """A camera's memory, as the library reads it from JSON: lengths in centimetres."""
    c, s = np.cos(TURN), np.sin(TURN)
    handler = dai.CalibrationHandler()
    left, right = dai.CameraBoardSocket.CAM_B, dai.CameraBoardSocket.CAM_C
    handler.setCameraIntrinsics(left, K_LEFT, 1280, 800)
    handler.setCameraIntrinsics(right, K_RIGHT, 1280, 800)
    handler.setDistortionCoefficients(left, [0.1, -0.05, 0.001, 0.002, 0.01, *[0.0] * 9])
    handler.setDistortionCoefficients(right, [0.1, -0.05, 0.001, 0.002, 0.01, 0.3, 0.2, 0.1, *[0.0] * 6])
    rotation = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
    handler.setCameraExtrinsics(left, right, rotation, changes.get("translation_cm", [-7.5, 0.1, 0.2]))
    if "model" in changes:
        handler.setCameraType(right, changes["model"])
    return dai.CalibrationHandler.fromJson(handler.eepromToJson())


@pytest.fixture(scope="module")
def dai() -> Any:
    return load()


@needs_depthai
def test_the_library_is_imported_without_its_telemetry(dai: Any) -> None:
    assert os.environ["DEPTHAI_TELEMETRY"] == "0"
    assert dai.__version__.startswith("3.")


@needs_depthai
def test_the_calibration_comes_in_metres_from_left_to_right(dai: Any) -> None:
    found = calibration_of(dai, eeprom(dai), SIZE)
    assert found.image_size == SIZE
    assert found.t_m == pytest.approx([-0.075, 0.001, 0.002], abs=1e-6)
    assert found.R[0, 2] == pytest.approx(np.sin(TURN), abs=1e-6)
    assert found.dist_left == pytest.approx([0.1, -0.05, 0.001, 0.002, 0.01], abs=1e-6)
    assert found.dist_right == pytest.approx([0.1, -0.05, 0.001, 0.002, 0.01, 0.3, 0.2, 0.1], abs=1e-6)


@needs_depthai
def test_the_camera_matrix_is_that_of_the_pictures_that_come(dai: Any) -> None:
    """1280x800 fills 640x480 at 0.6 and loses 64 columns at either side."""
    found = calibration_of(dai, eeprom(dai), SIZE)
    assert found.K_left[0, 0] == pytest.approx(480.0, abs=1e-3)
    assert found.K_left[1, 1] == pytest.approx(480.6, abs=1e-3)
    assert found.K_left[0, 2] == pytest.approx((641.0 + 0.5) * 0.6 - 0.5 - 64.0, abs=1e-3)
    assert found.K_left[1, 2] == pytest.approx((402.0 + 0.5) * 0.6 - 0.5, abs=1e-3)


@needs_depthai
def test_without_a_cut_the_camera_matrix_agrees_with_the_librarys_own(dai: Any) -> None:
    handler = eeprom(dai)
    found = calibration_of(dai, handler, (640, 400))
    theirs = handler.getCameraIntrinsics(dai.CameraBoardSocket.CAM_B, 640, 400)
    assert found.K_left == pytest.approx(np.array(theirs), abs=0.5)  # they scale corners, we pixel centres


@needs_depthai
def test_a_point_before_the_camera_lies_on_one_row_of_both_views(dai: Any) -> None:
    """The calibration rectifies what a pair with that memory would see."""
    import cv2

    found = calibration_of(dai, eeprom(dai), SIZE)
    points = np.array([[0.1, -0.1, 0.7], [-0.15, 0.1, 0.9], [0.0, 0.0, 0.5], [0.2, 0.15, 1.2]])
    none = np.zeros(3)
    left, _ = cv2.projectPoints(points, none, none, found.K_left, found.dist_left)
    right, _ = cv2.projectPoints(points, cv2.Rodrigues(found.R)[0], found.t_m, found.K_right, found.dist_right)
    rays_left, rays_right = Rectifier(found)(Matches(left.reshape(-1, 2), right.reshape(-1, 2)))
    assert rays_left[:, 1] == pytest.approx(rays_right[:, 1], abs=2e-4)
    disparity = rays_left[:, 0] - rays_right[:, 0]
    assert 0.075 / disparity == pytest.approx(points[:, 2], rel=0.04)


@needs_depthai
def test_a_memory_without_calibration_or_with_the_eyes_changed_is_a_fault(dai: Any) -> None:
    with pytest.raises(DeviceFault, match="sprayer calibrate camera"):
        calibration_of(dai, dai.CalibrationHandler(), SIZE)
    with pytest.raises(DeviceFault, match="a right eye at"):
        calibration_of(dai, eeprom(dai, translation_cm=[7.5, 0.0, 0.0]), SIZE)
    with pytest.raises(DeviceFault, match="Fisheye"):
        calibration_of(dai, eeprom(dai, model=dai.CameraModel.Fisheye), SIZE)


def test_scaling_keeps_the_rays_of_the_middle() -> None:
    K = np.array([[800.0, 0.0, 639.5], [0.0, 800.0, 399.5], [0.0, 0.0, 1.0]])
    for size in ((640, 480), (1280, 800), (320, 200), (400, 400)):
        scaled = scaled_K(K, (1280, 800), size)
        assert scaled[:2, 2] == pytest.approx([(size[0] - 1) / 2, (size[1] - 1) / 2])


class Bench:
    """The real sync node on this machine, fed by hand."""

    def __init__(self, dai: Any, apart_s: float) -> None:
        self._dai = dai
        self._pipeline = dai.Pipeline(createImplicitDevice=False)
        sync = add_sync(dai, self._pipeline, apart_s)
        self._ways = [entry.createInputQueue() for entry in sync_inputs(sync)]
        self._out = sync.out.createOutputQueue(maxSize=8, blocking=False)
        self._pipeline.start()
        self.zero_s = dai.Clock.now().total_seconds()

    def send(self, eye: int, code: int, at_s: float, size: tuple[int, int] = (64, 48)) -> None:
        frame = self._dai.ImgFrame()
        view = np.full((size[1], size[0], 3), code, np.uint8)
        frame.setCvFrame(view, self._dai.ImgFrame.Type.BGR888i)
        frame.setTimestamp(timedelta(seconds=self.zero_s + at_s))
        self._ways[eye].send(frame)

    def next(self) -> Any:
        return self._out.get(timedelta(seconds=1.0))

    def close(self) -> None:
        """The node of depthai 3.12 never ends when it is stopped in the moment in which it begins to wait."""
        time.sleep(0.02)
        self._pipeline.stop()


@pytest.fixture
def bench(dai: Any):
    made = Bench(dai, 0.005)
    yield made
    made.close()


@needs_depthai
def test_views_of_one_moment_are_a_pair_with_its_stamp(dai: Any, bench: Bench) -> None:
    bench.send(0, 10, 0.000)
    bench.send(1, 20, 0.002)
    pair = pair_of(dai, bench.next())
    assert (pair.left.mean(), pair.right.mean()) == (10.0, 20.0)
    assert pair.left.shape == (48, 64, 3)
    assert pair.middle_s - bench.zero_s == pytest.approx(0.0, abs=1e-5)


@needs_depthai
def test_a_view_without_its_partner_is_left_out(dai: Any, bench: Bench) -> None:
    """F55."""
    bench.send(0, 10, 0.000)  # its partner never came
    bench.send(0, 11, 0.066)
    bench.send(1, 21, 0.067)
    bench.send(1, 22, 0.133)
    bench.send(0, 12, 0.132)
    pairs = [pair_of(dai, bench.next()) for _ in range(2)]
    assert [(pair.left.mean(), pair.right.mean()) for pair in pairs] == [(11.0, 21.0), (12.0, 22.0)]


@needs_depthai
def test_views_of_two_sizes_are_a_fault(dai: Any, bench: Bench) -> None:
    bench.send(0, 10, 0.0)
    bench.send(1, 20, 0.0, size=(32, 48))
    group = bench.next()
    with pytest.raises(DeviceFault, match="one size"):
        pair_of(dai, group)


@needs_depthai
def test_a_pair_of_eyes_that_see_no_colour_is_the_wrong_device(dai: Any) -> None:
    def eye(socket: Any, kind: Any) -> Any:
        feature = dai.CameraFeatures()
        feature.socket, feature.supportedTypes, feature.sensorName = socket, [kind], "OV9282"
        return feature

    left, right = dai.CameraBoardSocket.CAM_B, dai.CameraBoardSocket.CAM_C
    colour, mono = dai.CameraSensorType.COLOR, dai.CameraSensorType.MONO
    assert sockets(dai, [eye(left, colour), eye(right, colour)]) == (left, right)
    with pytest.raises(WrongDevice, match="no colour"):
        sockets(dai, [eye(left, colour), eye(right, mono)])
    with pytest.raises(WrongDevice, match="no sensor"):
        sockets(dai, [eye(left, colour)])


@needs_depthai
def test_no_camera_is_told_within_three_seconds() -> None:
    async def main() -> None:
        load()  # the first import is the installation's, not the camera's
        loop = asyncio.get_running_loop()
        device = DepthAiCamera(DepthAiSettings(SIZE, 0.004), loop.time)
        began_s = loop.time()
        with pytest.raises(DeviceMissing, match="an OAK camera"):
            await device.open()
        assert loop.time() - began_s < 5.0  # three, and what a busy machine adds
        with pytest.raises(DeviceLost):
            await device.capture()

    run(main)


def test_a_missing_library_is_told_with_the_way_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(name: str) -> Any:
        raise ImportError(f"No module named {name!r}")

    monkeypatch.setattr(depthai_pair.importlib, "import_module", nothing)

    async def main() -> None:
        device = DepthAiCamera(DepthAiSettings(SIZE, 0.004), asyncio.get_running_loop().time)
        with pytest.raises(DeviceMissing, match=r"sprayer\[oak\]"):
            await device.open()

    run(main)
