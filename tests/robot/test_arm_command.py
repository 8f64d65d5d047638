"""``sprayer arm`` on emulated servos that another process serves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from typer.testing import CliRunner

from drivers.errors import DeviceMissing, DeviceRefused
from robot.commands.arm import app
from robot.errors import UsageError
from tests.drivers.arm.served import served


@pytest.fixture(scope="module")
def port() -> Iterator[str]:
    with served(1_000_000, "cold") as path:
        yield path


def call(*arguments: str, answer: str = "") -> Any:
    return CliRunner().invoke(app, list(arguments), input=answer)


def test_scan_lists_the_servos(port: str) -> None:
    done = call("scan", "--port", port)
    assert done.exit_code == 0
    assert done.output.count("XM540-W270") == 7
    assert "XM430-W350" in done.output


def test_scan_names_the_joints_of_a_configuration(port: str) -> None:
    done = call("scan", "--config", "emulated.toml", "--port", port, "--ids", "1-3")
    assert done.exit_code == 0, done.output
    assert "waist" in done.output
    assert done.output.count("shoulder") == 2


def test_read_shows_registers_by_name(port: str) -> None:
    done = call("read", "8", "model_number", "hardware_error_status", "--port", port)
    assert done.exit_code == 0
    assert [line.split() for line in done.output.splitlines()] == [
        ["0", "model_number", "1020"],
        ["70", "hardware_error_status", "none"],
    ]


def test_read_refuses_an_unknown_register(port: str) -> None:
    done = call("read", "8", "speed", "--port", port)
    assert isinstance(done.exception, DeviceRefused)


def test_torque_asks_first(port: str) -> None:
    assert call("torque", "on", "--ids", "1", "--port", port, answer="n\n").exit_code != 0
    assert call("read", "1", "torque_enable", "--port", port).output.split()[-1] == "0"
    assert call("torque", "on", "--ids", "1", "--port", port, answer="y\n").exit_code == 0
    assert call("read", "1", "torque_enable", "--port", port).output.split()[-1] == "1"
    assert call("torque", "off", "--ids", "1", "--port", port, "--yes").exit_code == 0
    assert call("read", "1", "torque_enable", "--port", port).output.split()[-1] == "0"


def test_what_is_called_wrongly_says_so(port: str) -> None:
    assert isinstance(call("scan").exception, UsageError)
    assert isinstance(call("scan", "--port", port, "--ids", "8-1").exception, UsageError)
    assert isinstance(call("torque", "on", "--port", port).exception, UsageError)
    assert isinstance(call("scan", "--config", "demo.toml").exception, UsageError)
    assert isinstance(call("scan", "--port", "/dev/none").exception, DeviceMissing)
