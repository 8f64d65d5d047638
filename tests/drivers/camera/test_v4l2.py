"""The ioctls of a video node, against one that answers as the kernel's driver does."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from drivers.camera import v4l2
from drivers.camera.controls import Control, GainScale, Limits, apply
from drivers.camera.v4l2 import V4l2Device, holder
from drivers.errors import DeviceBusy, DeviceFault, DeviceMissing, WrongDevice
from tests.drivers.camera.fake_v4l2 import Node

WANTED = {
    Control.AUTO_FOCUS: 0.0, Control.AUTO_RATE: 0.0, Control.AUTO_EXPOSURE: 0.0, Control.AUTO_WHITE_BALANCE: 0.0,
    Control.POWER_LINE_HZ: 50.0, Control.WHITE_BALANCE_K: 5600.0, Control.EXPOSURE_S: 0.004, Control.GAIN: 20.0,
}  # fmt: skip


@pytest.fixture
def node() -> Node:
    return Node.at_power_on()


@pytest.fixture
def path(tmp_path: Path) -> str:
    (tmp_path / "video0").write_bytes(b"")
    return str(tmp_path / "video0")


def test_the_layouts_are_those_of_the_kernels_headers() -> None:
    """The size of a struct is in its ioctl's number (bits 16 to 29)."""
    sizes = {
        v4l2.VIDIOC_QUERYCAP: v4l2.CAPABILITY.size,
        v4l2.VIDIOC_S_FMT: v4l2.FORMAT_SIZE,
        v4l2.VIDIOC_G_CTRL: v4l2.CONTROL.size,
        v4l2.VIDIOC_S_CTRL: v4l2.CONTROL.size,
        v4l2.VIDIOC_QUERYCTRL: v4l2.QUERY.size,
    }
    assert {number: number >> 16 & 0x3FFF for number in sizes} == sizes


def test_a_camera_tells_what_it_is(node: Node, path: str) -> None:
    device = V4l2Device(path, node.ioctl)
    assert (device.identity.driver, device.identity.card) == ("uvcvideo", "Stereo Cam")
    device.close()


def test_every_control_is_set_in_the_cameras_own_numbers(node: Node, path: str) -> None:
    kept = apply(V4l2Device(path, node.ioctl), WANTED)
    numbers = {control: held.value for control, held in node.controls.items()}
    assert numbers == {
        Control.GAIN: 20, Control.AUTO_WHITE_BALANCE: 0, Control.WHITE_BALANCE_K: 5600, Control.POWER_LINE_HZ: 1,
        Control.AUTO_EXPOSURE: 1, Control.EXPOSURE_S: 40, Control.AUTO_RATE: 0,
    }  # fmt: skip
    assert kept[Control.EXPOSURE_S] == 0.004
    assert Control.AUTO_FOCUS not in kept  # it has none, which is as good as off


def test_an_exposure_between_two_units_becomes_the_nearest(node: Node, path: str) -> None:
    node.controls[Control.EXPOSURE_S].low, node.controls[Control.EXPOSURE_S].step = 3, 5
    kept = apply(V4l2Device(path, node.ioctl), WANTED | {Control.EXPOSURE_S: 0.00412})
    assert node.controls[Control.EXPOSURE_S].value == 43
    assert kept[Control.EXPOSURE_S] == 0.0043


def test_a_value_out_of_the_cameras_limits_is_told_with_them(node: Node, path: str) -> None:
    device = V4l2Device(path, node.ioctl)
    with pytest.raises(DeviceFault, match="white_balance_k to take 9999, found 2800 to 6500"):
        apply(device, WANTED | {Control.WHITE_BALANCE_K: 9999.0})
    kept = apply(device, WANTED | {Control.WHITE_BALANCE_K: 9999.0}, frozenset({Control.WHITE_BALANCE_K}))
    assert kept[Control.WHITE_BALANCE_K] == 6500.0


def test_limits_are_in_seconds_kelvin_and_hertz(node: Node, path: str) -> None:
    device = V4l2Device(path, node.ioctl)
    exposure = device.limits(Control.EXPOSURE_S)
    assert exposure is not None
    assert (exposure.low, exposure.high) == (pytest.approx(0.0001), pytest.approx(0.5))
    assert device.limits(Control.WHITE_BALANCE_K) == Limits(2800.0, 6500.0, 10.0)
    assert device.limits(Control.POWER_LINE_HZ) == Limits(0.0, 60.0, 10.0)
    assert device.limits(Control.AUTO_FOCUS) is None
    node.controls[Control.GAIN].disabled = True
    assert device.limits(Control.GAIN) is None


def test_an_exposure_set_while_its_automatic_is_on_is_told_as_that(node: Node, path: str) -> None:
    with pytest.raises(DeviceFault, match="an automatic drives it"):
        apply(V4l2Device(path, node.ioctl), {Control.EXPOSURE_S: 0.004})


@pytest.mark.parametrize("control", [Control.EXPOSURE_S, Control.GAIN, Control.AUTO_EXPOSURE, Control.WHITE_BALANCE_K])
def test_a_control_that_forgets_its_value_is_named_unless_it_may_differ(
    control: Control, node: Node, path: str
) -> None:
    node.controls[control].forgets = True
    device = V4l2Device(path, node.ioctl)
    with pytest.raises(DeviceFault, match=f"{control}|an automatic"):
        apply(device, WANTED)
    if control is not Control.AUTO_EXPOSURE:
        kept = apply(device, WANTED, frozenset({control}))
        assert kept[control] != pytest.approx(WANTED[control])


def test_a_read_only_control_is_told_as_that(node: Node, path: str) -> None:
    node.controls[Control.GAIN].read_only = True
    with pytest.raises(DeviceFault, match="gain to be set, found it is read-only"):
        apply(V4l2Device(path, node.ioctl), WANTED)


def test_a_camera_that_goes_while_it_is_set_is_an_error_of_the_system(node: Node, path: str) -> None:
    device = V4l2Device(path, node.ioctl)
    node.gone = True
    with pytest.raises(OSError, match="No such device"):
        apply(device, WANTED)


def test_size_and_format_are_asked_for_and_verified(node: Node, path: str) -> None:
    device = V4l2Device(path, node.ioctl)
    device.ask_format(1280, 480, "YUYV")
    assert node.set_format == (1280, 480, "YUYV")
    with pytest.raises(WrongDevice, match="1600x600 MJPG, found 1280x480 MJPG from Stereo Cam"):
        device.ask_format(1600, 600, "MJPG")
    with pytest.raises(WrongDevice, match="2560x720 YUYV, found 1280x480 YUYV"):
        device.ask_format(2560, 720, "YUYV")


def test_a_camera_that_another_program_holds_is_busy(node: Node, path: str) -> None:
    node.streaming_elsewhere = True
    with pytest.raises(DeviceBusy, match="held by"):
        V4l2Device(path, node.ioctl).ask_format(1280, 480, "MJPG")


def test_the_holder_of_a_device_is_named(tmp_path: Path) -> None:
    device = tmp_path / "video0"
    device.write_bytes(b"")
    process = tmp_path / "proc" / "812"
    (process / "fd").mkdir(parents=True)
    (process / "fd" / "7").symlink_to(device)
    (process / "comm").write_text("guvcview\n")
    (tmp_path / "proc" / "self").mkdir()
    assert holder(str(device), str(tmp_path / "proc")) == "guvcview (PID 812)"
    assert holder(str(tmp_path / "video1"), str(tmp_path / "proc")) == "another program"


def test_a_node_that_is_no_capture_device_is_the_wrong_one(node: Node, path: str) -> None:
    node.captures = False
    with pytest.raises(WrongDevice, match="video-index0"):
        V4l2Device(path, node.ioctl)
    node.video = False
    with pytest.raises(WrongDevice, match="something else"):
        V4l2Device(path, node.ioctl)


def test_a_refused_device_is_not_left_open(node: Node, path: str) -> None:
    node.captures = False
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(5):
        with pytest.raises(WrongDevice):
            V4l2Device(path, node.ioctl)
    assert len(os.listdir("/proc/self/fd")) == before


def test_a_path_without_a_device_and_one_without_permission_are_missing(tmp_path: Path) -> None:
    with pytest.raises(DeviceMissing, match="No such file"):
        V4l2Device(str(tmp_path / "video9"))


@pytest.mark.parametrize(
    ("scale", "gain", "number"),
    [
        (GainScale(), 4.0, 4.0),
        (GainScale("linear", 16.0, 16.0), 4.0, 64.0),
        (GainScale("decibel", 0.0, 10.0), 10.0, 200.0),
    ],
)
def test_a_gain_is_the_cameras_number_and_back(scale: GainScale, gain: float, number: float) -> None:
    assert scale.number(gain) == pytest.approx(number)
    assert scale.gain(number) == pytest.approx(gain)
    assert scale.gain(scale.number(1.0)) == pytest.approx(1.0)
