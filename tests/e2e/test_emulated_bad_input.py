"""What can be wrong at the ports when the robot comes up: named in time, with the remedy, before any order."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from drivers.arm.dynamixel import DynamixelArm
from drivers.camera.stereo_usb import StereoUsb
from drivers.gps.nmea import NmeaGps
from drivers.inputs.modbus import ModbusInputs
from drivers.modem.gsm import GsmModem
from drivers.relay.modbus import ModbusRelay
from drivers.wheels.zlac8015d import Zlac8015dWheels
from tests.drivers.arm.served import served

from .emulated import EMULATED, Emulated, emulator, held, motions_in, orders_in, run_until, variables, written
from .rover_process import SPRAYER

UNAVAILABLE, BUSY, CONFIG = 69, 75, 78
OPEN_S = 3.0  # what is promised
LOADED_S = 2.0  # what a loaded machine may add
GUARD_S = 40.0
DRIVERS = {
    "relay": ModbusRelay, "inputs": ModbusInputs, "wheels": Zlac8015dWheels, "arm": DynamixelArm,
    "camera": StereoUsb, "gps": NmeaGps, "modem": GsmModem,
}  # fmt: skip
SERIAL = ("relay", "wheels", "arm", "gps", "modem")


# --- the machines


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Emulated, Path]]:
    """A rover as configured, and its truth."""
    truth = tmp_path_factory.mktemp("right") / "truth.jsonl"
    with emulator("--truth", str(truth)) as rover:
        yield rover, truth


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Emulated, Path]]:
    """A second one, whose devices stand at the wrong ports."""
    truth = tmp_path_factory.mktemp("other") / "truth.jsonl"
    with emulator(*(f"--only={name}" for name in SERIAL), "--truth", str(truth)) as rover:
        yield rover, truth


@pytest.fixture(scope="module")
def odd(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Emulated]:
    """One that is set otherwise than the robot believes: rates, models, board, SIM; its receiver is silent."""
    env = {
        "SPRAYER_ARM__BAUD": "57600",
        "SPRAYER_RELAY__PROFILE": "lc-8",
        "SPRAYER_WHEELS__BAUD": "9600",
        "SPRAYER_MODEM__PIN": "4711",
    }
    with emulator(*(f"--only={name}" for name in SERIAL), "--strict-baud", "--fault", "gps:off", env=env) as rover:
        yield rover


@pytest.fixture(scope="module")
def odder() -> Iterator[Emulated]:
    env = {
        "SPRAYER_ARM__SERVOS__FOREARM_ROLL__MODEL": "XM430-W350",
        "SPRAYER_RELAY__BAUD": "9600",
        "SPRAYER_GPS__BAUD": "9600",
    }
    with emulator("--only=arm", "--only=relay", "--only=gps", "--strict-baud", env=env) as rover:
        yield rover


# --- the robot


class Robot:
    """Comes up on given ports, through the command line, and tells how that ended."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._folder, self._patch, self._capsys = folder, patch, capsys
        self.opening_s: dict[str, float] = {}
        self.error = ""
        for name, kind in DRIVERS.items():
            patch.setattr(kind, "open", self._timed(name, kind.open))

    def _timed(self, name: str, open_: Callable[[Any], Any]) -> Callable[[Any], Any]:
        async def timed(driver: Any) -> None:
            began_s = time.monotonic()
            try:
                await open_(driver)
            finally:
                self.opening_s[name] = time.monotonic() - began_s

        return timed

    def come_up(self, ports: dict[str, str], **more: str) -> int:
        """The exit code. ``more`` are variables of the environment."""
        for name, value in (variables(ports) | more).items():
            self._patch.setenv(name, value)
        self._capsys.readouterr()
        code = run_until(
            ["run", "--config", str(EMULATED), "--out", str(self._folder / "out"), "--trace", str(self.trace)], GUARD_S
        )
        self.error = self._capsys.readouterr().err
        return code

    @property
    def trace(self) -> Path:
        return self._folder / "trace"

    def orders(self, device: str) -> list[str]:
        """What was ordered at the device's port."""
        return orders_in(written(self.trace / f"{device}.trace.jsonl"))

    def require_refused(self, device: str, *words: str) -> None:
        """One line names the device, in the promised time, and nothing was ordered at its port."""
        assert self.error.startswith(f"sprayer: {device}: expected "), self.error
        assert self.error.count("\n") == 1, self.error
        for word in words:
            assert word in self.error, self.error
        sys.stdout.write(f"{device} refused {self.opening_s[device]:.2f} s after its opening began\n")
        assert self.opening_s[device] < OPEN_S + LOADED_S
        assert self.orders(device) == []


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Robot:
    return Robot(tmp_path, monkeypatch, capsys)


# --- ports


@pytest.mark.parametrize("device", [*SERIAL, "inputs"])
def test_a_port_that_is_not_there_is_named(robot: Robot, right: tuple[Emulated, Path], device: str) -> None:
    code = robot.come_up(right[0].ports | {device: "/dev/serial/by-id/usb-gone"})
    assert code == UNAVAILABLE
    robot.require_refused(device, "/dev/serial/by-id/usb-gone", "found nothing there", "check cable and power")


def test_a_camera_that_is_not_there_is_named(robot: Robot, right: tuple[Emulated, Path]) -> None:
    assert robot.come_up(right[0].ports | {"camera": "http://127.0.0.1:9/stream"}) == UNAVAILABLE
    robot.require_refused("camera", "http://127.0.0.1:9/stream")


@pytest.mark.parametrize(
    "device", ["relay", "arm", *(pytest.param(name, marks=pytest.mark.long) for name in ("wheels", "gps", "modem"))]
)
def test_a_port_that_another_process_holds_is_named_with_the_process(
    robot: Robot, right: tuple[Emulated, Path], other: tuple[Emulated, Path], device: str
) -> None:
    port = other[0].ports[device]
    with held(port) as process:
        assert robot.come_up(right[0].ports | {device: port}) == BUSY
    robot.require_refused(device, port, f"process {process} (", "stop that process first")
    assert written(robot.trace / f"{device}.trace.jsonl") == b""


def test_two_devices_on_one_port_are_refused_before_any_is_opened(robot: Robot, right: tuple[Emulated, Path]) -> None:
    ports = right[0].ports
    assert robot.come_up(ports | {"gps": ports["modem"]}) == CONFIG
    assert "gps and modem both name" in robot.error or "modem and gps both name" in robot.error
    assert robot.opening_s == {}


def test_orders_are_given_once_the_identity_is_proven(robot: Robot, right: tuple[Emulated, Path]) -> None:
    """What the tests here look for is there to be seen: outputs off, servos and wheels prepared."""
    assert robot.come_up(right[0].ports | {"modem": "/dev/serial/by-id/usb-gone"}) == UNAVAILABLE
    for device in ("relay", "wheels", "arm"):
        assert robot.orders(device) != []
    assert motions_in(right[1]) == []


def test_the_program_itself_ends_with_one_line_and_the_code(right: tuple[Emulated, Path], tmp_path: Path) -> None:
    command = [*SPRAYER, "run", "--config", str(EMULATED), "--out", str(tmp_path / "out")]
    env = os.environ | variables(right[0].ports | {"arm": "/dev/serial/by-id/usb-gone"})
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (UNAVAILABLE, "")
    assert done.stderr.startswith("sprayer: arm: expected a serial device at /dev/serial/by-id/usb-gone")
    assert done.stderr.count("\n") == 1


# --- the wrong device

PAIRS = [(asked, there) for asked in DRIVERS if asked != "camera" for there in SERIAL
         if asked != there and (asked, there) != ("inputs", "relay")]  # fmt: skip
REPRESENTATIVE = {
    ("relay", "arm"), ("inputs", "gps"), ("wheels", "relay"), ("arm", "relay"), ("gps", "wheels"), ("modem", "gps"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("asked", "there"),
    [pytest.param(*pair, marks=() if pair in REPRESENTATIVE else pytest.mark.long) for pair in PAIRS],
)
def test_another_device_at_the_port_is_told_before_it_is_ordered_anything(
    robot: Robot, right: tuple[Emulated, Path], other: tuple[Emulated, Path], asked: str, there: str
) -> None:
    code = robot.come_up(right[0].ports | {asked: other[0].ports[there]})
    assert code == UNAVAILABLE
    robot.require_refused(asked)
    assert motions_in(other[1]) == []
    assert motions_in(right[1]) == []


# --- the right device, otherwise than the robot believes


def test_a_receiver_of_another_kind_at_the_cameras_place_is_told(
    robot: Robot, right: tuple[Emulated, Path], other: tuple[Emulated, Path]
) -> None:
    assert robot.come_up(right[0].ports | {"camera": other[0].ports["gps"]}) == UNAVAILABLE
    robot.require_refused("camera", other[0].ports["gps"])


def test_a_wrong_baud_rate_of_the_servos_is_told_with_the_right_one(
    robot: Robot, right: tuple[Emulated, Path], odd: Emulated
) -> None:
    assert robot.come_up(right[0].ports | {"arm": odd.ports["arm"]}) == UNAVAILABLE
    robot.require_refused("arm", "at 1000000 baud", "57600 baud", "set arm.baud = 57600")


def test_a_wrong_baud_rate_of_the_board_is_told(robot: Robot, right: tuple[Emulated, Path], odder: Emulated) -> None:
    bus = odder.ports["relay"]
    assert robot.come_up(right[0].ports | {"relay": bus}) == UNAVAILABLE
    robot.require_refused("relay", "baud rate")


def test_a_wrong_baud_rate_of_the_wheels_is_told(robot: Robot, right: tuple[Emulated, Path], odd: Emulated) -> None:
    assert robot.come_up(right[0].ports | {"wheels": odd.ports["wheels"]}) == UNAVAILABLE
    robot.require_refused("wheels", "baud rate")


def test_a_wrong_baud_rate_of_the_receiver_is_told_with_the_right_one(
    robot: Robot, right: tuple[Emulated, Path], odder: Emulated
) -> None:
    assert robot.come_up(right[0].ports | {"gps": odder.ports["gps"]}) == UNAVAILABLE
    robot.require_refused("gps", "at 115200 baud", "NMEA at 9600 baud", "set baud to 9600")


def test_two_servos_with_one_id_are_told(robot: Robot, right: tuple[Emulated, Path]) -> None:
    with served(1_000_000, "twice", "cold") as port:
        assert robot.come_up(right[0].ports | {"arm": port}) == UNAVAILABLE
    robot.require_refused("arm", "two servos may have the id 3")


def test_a_servo_of_another_model_is_told_beside_the_expected_one(
    robot: Robot, right: tuple[Emulated, Path], odder: Emulated
) -> None:
    assert robot.come_up(right[0].ports | {"arm": odder.ports["arm"]}) == UNAVAILABLE
    robot.require_refused("arm", "forearm_roll (servo 6): is an XM430-W350, not an XM540-W270", "correct arm.servos")


def test_a_board_that_does_not_answer_as_its_profile_says_is_told(
    robot: Robot, right: tuple[Emulated, Path], odd: Emulated
) -> None:
    assert robot.come_up(right[0].ports | {"relay": odd.ports["relay"]}) == UNAVAILABLE
    robot.require_refused("relay", "Waveshare", "profile")


def test_a_locked_sim_is_told_with_where_its_pin_belongs(
    robot: Robot, right: tuple[Emulated, Path], odd: Emulated
) -> None:
    assert robot.come_up(right[0].ports | {"modem": odd.ports["modem"]}) == UNAVAILABLE
    robot.require_refused("modem", "PIN")


def test_a_wrong_pin_is_told_without_showing_it_and_never_tried_again(
    robot: Robot, right: tuple[Emulated, Path], odd: Emulated
) -> None:
    ports, tried = right[0].ports | {"modem": odd.ports["modem"]}, 0
    for words in (("refused its PIN", "2"), ("has refused a PIN before", "2"), ("has refused a PIN before", "2")):
        assert robot.come_up(ports, SPRAYER_MODEM__PIN="1234") == UNAVAILABLE
        robot.require_refused("modem", *words)
        assert "1234" not in robot.error
        tried += written(robot.trace / "modem.trace.jsonl").count(b"AT+CPIN=")
    assert tried == 1


def test_a_silent_receiver_is_told(robot: Robot, right: tuple[Emulated, Path], odd: Emulated) -> None:
    assert robot.come_up(right[0].ports | {"gps": odd.ports["gps"]}) == UNAVAILABLE
    robot.require_refused("gps", "found silence", "check power and cable")
