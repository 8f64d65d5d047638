"""From a configuration to devices: the back end that is named, and no other; nothing is opened for it."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from drivers.arm.dynamixel import DynamixelArm
from drivers.arm.mock import MockArm
from drivers.camera.controls import Control
from drivers.camera.depthai import DepthAiCamera
from drivers.camera.files import FilesCamera
from drivers.camera.mock import MockCamera
from drivers.camera.stereo_usb import StereoUsb
from drivers.gps.mock import MockGps
from drivers.gps.nmea import NmeaGps
from drivers.inputs.mock import MockInputs
from drivers.inputs.modbus import ModbusInputs
from drivers.modem.gsm import GsmModem
from drivers.modem.mock import MockModem
from drivers.relay.mock import MockRelay
from drivers.relay.modbus import ModbusRelay
from drivers.wheels.mock import MockWheels
from drivers.wheels.zlac8015d import Zlac8015dWheels
from robot.config import load_config
from robot.errors import ConfigError
from robot.package_files import packaged
from robot.runtime.backends import BuildOptions, build_devices, needs_twin
from robot.runtime.devices import Devices, make_twin
from robot.runtime.settings import load_arm, load_camera, load_row

MOCKS = {
    "camera": MockCamera, "arm": MockArm, "relay": MockRelay, "inputs": MockInputs, "gps": MockGps,
    "modem": MockModem, "wheels": MockWheels,
}  # fmt: skip
PRODUCTION = {
    "camera": StereoUsb, "arm": DynamixelArm, "relay": ModbusRelay, "inputs": ModbusInputs, "gps": NmeaGps,
    "modem": GsmModem, "wheels": Zlac8015dWheels,
}  # fmt: skip


CONFIGS = packaged("configs")


@pytest.fixture
def build(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Devices]:
    def build(path: Path, ports: dict[str, str] | None = None, **variables: str) -> Devices:
        """The devices of a configuration; ``variables`` like ARM__BAUD override it."""
        for variable, value in variables.items():
            monkeypatch.setenv(f"SPRAYER_{variable}", value)
        config = load_config(path)
        arm, urdf = load_arm(config, path)
        row, rig = load_row(config, path), load_camera(config, path)
        twin = make_twin(config, row, rig, urdf, None) if needs_twin(config) else None

        async def main() -> Devices:
            async with AsyncExitStack() as stack:
                return build_devices(config, arm, twin, lambda: 0.0, BuildOptions(path, ports or {}), stack)

        return asyncio.run(main())

    return build


def with_section(folder: Path, name: str, *lines: str) -> Path:
    """The emulated rover's configuration with other keys in one of its sections."""
    text = (CONFIGS / "emulated.toml").read_text()
    section = re.compile(rf"^\[{name}\].*?(?=^\[(?!{name}\.))", re.MULTILINE | re.DOTALL)
    changed, count = section.subn("\n".join([f"[{name}]", *lines, "", ""]), text)
    assert count == 1
    path = folder / "changed.toml"
    path.write_text(changed)
    return path


def kinds(devices: Devices) -> dict[str, type]:
    return {name: type(getattr(devices, name)) for name in MOCKS}


@pytest.mark.parametrize(
    ("name", "expected"), [("demo.toml", MOCKS), ("emulated.toml", PRODUCTION), ("rover.toml", PRODUCTION)]
)
def test_each_device_is_of_the_back_end_that_is_named(
    build: Callable[..., Devices], name: str, expected: dict[str, type]
) -> None:
    """Production drivers are made though none of their ports exists: nothing is opened."""
    assert kinds(build(CONFIGS / name)) == expected


@pytest.mark.parametrize("device", ["gps", "modem", "inputs"])
def test_back_ends_can_be_mixed_and_only_the_named_one_is_a_mock(
    build: Callable[..., Devices], tmp_path: Path, device: str
) -> None:
    devices = build(with_section(tmp_path, device, 'backend = "mock"'))
    assert kinds(devices) == PRODUCTION | {device: MOCKS[device]}


@pytest.mark.parametrize(
    ("lines", "kind"),
    [(('backend = "files"', 'source = "pairs"'), FilesCamera), (('backend = "depthai"',), DepthAiCamera)],
)
def test_a_camera_of_another_kind_is_made_where_it_is_named(
    build: Callable[..., Devices], tmp_path: Path, lines: tuple[str, ...], kind: type
) -> None:
    path = with_section(tmp_path, "camera", *lines, 'calibration = "calibration/demo.json"', "exposure_s = 0.004")
    assert type(build(path).camera) is kind


def test_what_a_real_camera_needs_comes_from_its_section(build: Callable[..., Devices]) -> None:
    camera = build(
        CONFIGS / "emulated.toml",
        CAMERA__GAIN_UNITS='{"kind": "decibel", "unity": 64, "units": 10}',
        CAMERA__IN_FLIGHT_FRAMES="3",
        CAMERA__MAY_DIFFER='["power_line_hz"]',
        CAMERA__CONTROLLED="false",
    ).camera
    assert isinstance(camera, StereoUsb)
    assert camera.settings.gain_scale.number(10.0) == pytest.approx(64 + 10 * 20)
    assert camera.settings.in_flight_frames == 3
    assert camera.settings.may_differ == {Control.POWER_LINE_HZ}
    assert not camera.settings.controlled


@pytest.mark.parametrize(
    ("variables", "words"),
    [
        ({"CAMERA__MAY_DIFFER": '["hue"]'}, r"camera\.may_differ"),
        ({"RELAY__PROFILE": "waveshare-9"}, r"\[relay\] .*waveshare-9.*known are .*waveshare-8"),
        ({"RELAY__CHANNELS__VALVE": "12"}, r"\[relay\] .*expected 1 to 8, found 12"),
        ({"ARM__SERVOS__WAIST__IDS": "[7]"}, r"\[arm\] .*servo id 7 stands at two places"),
        ({"ARM__SERVOS__WAIST__MODEL": "AX-12"}, r"arm\.servos: unknown model 'AX-12'; known are"),
        ({"ARM__SERVOS__TAIL": '{"ids": [9], "model": "XM540-W270"}'}, r"the URDF's joints are waist.*correct tail"),
        ({"GPS__PORT": "/tmp/sprayer-emulated/arm"}, r"arm and gps|gps and arm"),
        ({"INPUTS__BAUD": "9600"}, r"relay and inputs share .*115200 8N1 and 9600 8N1"),
        ({"MODEM__PIN": "12"}, r"\[modem\] pin: expected 4 to 8 digits"),
    ],
)
def test_what_a_driver_cannot_keep_names_its_section(
    build: Callable[..., Devices], variables: dict[str, str], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        build(CONFIGS / "emulated.toml", **variables)


def test_the_ports_of_an_emulated_rover_take_the_place_of_the_configured_ones(build: Callable[..., Devices]) -> None:
    devices = build(CONFIGS / "emulated.toml", {"gps": "/dev/pts/97", "modem": "/dev/pts/98"})
    assert isinstance(devices.gps, NmeaGps)
    assert isinstance(devices.modem, GsmModem)
    assert devices.gps.port.settings.path == "/dev/pts/97"
    assert devices.modem.port.settings.path == "/dev/pts/98"
