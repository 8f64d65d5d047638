"""``sprayer doctor`` on production drivers and emulated devices, through the command line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from robot.cli import run_command

from .emulated import EMULATED, Emulated, emulator, held, variables

WARNED, UNAVAILABLE, BUSY, CONFIG = 1, 69, 75, 78
Findings = dict[tuple[str, str], dict[str, Any]]


@pytest.fixture(scope="module")
def rover() -> Iterator[Emulated]:
    with emulator() as emulated:
        yield emulated


class Doctor:
    def __init__(self, patch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._patch, self._capsys = patch, capsys

    def examine(self, ports: dict[str, str], **more: str) -> tuple[int, Findings]:
        """Exit code, and what was found by device and name. ``more`` are variables of the environment."""
        for name, value in (variables(ports) | more).items():
            self._patch.setenv(name, value)
        code = run_command(["doctor", "--config", str(EMULATED), "--json"])
        lines = [json.loads(line) for line in self._capsys.readouterr().out.splitlines()]
        return code, {(line["device"], line["what"]): line for line in lines}


@pytest.fixture
def doctor(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Doctor:
    return Doctor(monkeypatch, capsys)


def failed(findings: Findings) -> set[str]:
    return {device for (device, _), line in findings.items() if line["level"] == "fail"}


def devices_in_order(findings: Findings) -> set[str]:
    return {device for (device, what), line in findings.items() if what == "identity" and line["level"] == "ok"}


ALL = {"relay", "inputs", "wheels", "arm", "camera", "gps", "modem"}


def test_a_rover_in_order_is_told_device_by_device(doctor: Doctor, rover: Emulated) -> None:
    code, found = doctor.examine(rover.ports)
    assert devices_in_order(found) == ALL
    wrong = [line for line in found.values() if line["level"] != "ok" and line["device"] not in ("clock", "disk")]
    assert wrong == []
    assert code in (0, WARNED)  # the computer itself may have a clock without a source
    assert found["relay", "pulses"]["found"].startswith("timed by the board")
    assert found["wheels", "supply"]["found"].endswith(" V")
    assert found["arm", "temperatures"]["found"].endswith(")")
    assert found["camera", "calibration"]["level"] == "ok"
    assert found["camera", "pictures"]["found"] == "640x480, 4 ms, gain 1"


def test_a_port_that_is_missing_does_not_keep_the_others_from_being_examined(doctor: Doctor, rover: Emulated) -> None:
    code, found = doctor.examine(rover.ports | {"arm": "/dev/serial/by-id/usb-gone"})
    assert code == UNAVAILABLE
    assert failed(found) == {"arm"}
    assert devices_in_order(found) == ALL - {"arm"}
    assert "ls -l /dev/serial/by-id" in found["arm", "port"]["remedy"]


def test_a_port_that_is_held_is_told_with_its_holder(doctor: Doctor, rover: Emulated) -> None:
    with held(rover.ports["wheels"]) as process:
        code, found = doctor.examine(rover.ports)
    assert code == BUSY
    assert failed(found) == {"wheels"}
    assert found["wheels", "held by"]["found"] == f"process {process}"
    assert found["wheels", "held by"]["code"] == BUSY


def test_the_wrong_device_at_a_port_is_told_in_the_drivers_words(doctor: Doctor, rover: Emulated) -> None:
    ports = rover.ports | {"gps": rover.ports["modem"], "modem": rover.ports["gps"]}
    code, found = doctor.examine(ports)
    assert code == UNAVAILABLE
    assert failed(found) == {"gps", "modem"}
    assert "NMEA sentences" in found["gps", "identity"]["expected"]


def test_a_dark_camera_is_told(doctor: Doctor, rover: Emulated) -> None:
    code, found = doctor.examine(rover.ports, SPRAYER_CAMERA__EXPOSURE_S="0.00001")
    assert code != 0
    wrong = [line for (device, _), line in found.items() if device == "camera" and line["level"] != "ok"]
    assert len(wrong) > 0
    assert all(line["remedy"] for line in wrong)


def test_a_board_without_pulse_support_is_for_spraying_by_hand(doctor: Doctor, rover: Emulated) -> None:
    plain = {"SPRAYER_RELAY__PROFILE": "generic-coils"}
    with emulator("--only=relay", env=plain) as other:
        code, found = doctor.examine(rover.ports | {"relay": other.ports["relay"]}, **plain)
    assert code == WARNED
    assert found["relay", "pulses"]["level"] == "warn"
    assert found["relay", "pulses"]["remedy"] == "spray by hand only"


def test_a_device_that_falls_silent_is_told_and_the_others_are_examined(doctor: Doctor, rover: Emulated) -> None:
    with emulator("--only=wheels", "--only=gps", "--fault", "wheels:off", "--fault", "gps:garbage") as faulty:
        code, found = doctor.examine(rover.ports | faulty.ports)
    assert code == UNAVAILABLE
    assert failed(found) == {"wheels", "gps"}
    assert devices_in_order(found) == ALL - {"wheels", "gps"}


def test_a_wrong_configuration_has_a_code_of_its_own(doctor: Doctor, rover: Emulated) -> None:
    code, found = doctor.examine(rover.ports | {"gps": rover.ports["modem"]})
    assert (code, found) == (CONFIG, {})
