"""What the doctor sees of ports and computer, and what it makes of a whole rover."""

from __future__ import annotations

import asyncio
import json
import os
import pty
from contextlib import AsyncExitStack
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from drivers import port_lock
from drivers.errors import DeviceBusy, DeviceMissing
from drivers.relay.values import BoardCapability, Channel, RelayState
from drivers.twin import Twin
from drivers.twin import commands as c
from robot.cli import run_command
from robot.clock import run_virtual
from robot.config import load_config
from robot.doctor import Finding, Level, exit_code
from robot.doctor.computer import calibration_findings, clock_finding, disk_finding
from robot.doctor.devices import examine, look_at_arm, look_at_camera, look_at_inputs, look_at_relay
from robot.doctor.ports import adapter_findings, port_findings
from robot.doctor.values import of_device_error
from robot.geometry import rotation_from_rpy
from robot.package_files import packaged
from robot.runtime.backends import BuildOptions, build_devices, watched
from robot.runtime.settings import load_arm
from robot.vision.stereo_rig import StereoRig
from tests.drivers.twin import rig

DEMO = packaged("configs") / "demo.toml"
NOW = datetime(2026, 7, 1, 12, 0, tzinfo=UTC)


def levels(findings: list[Finding]) -> dict[str, Level]:
    return {finding.what: finding.level for finding in findings}


def test_a_port_that_is_not_there_fails_with_the_way_to_find_it() -> None:
    (finding,) = port_findings("arm", "/dev/ttyNOWHERE")
    assert (finding.level, finding.code) == (Level.FAIL, 69)
    assert "by-id" in finding.remedy


def test_a_file_in_a_ports_place_is_no_device(tmp_path: Path) -> None:
    (finding,) = port_findings("arm", str(tmp_path))
    assert finding.level is Level.FAIL
    assert "is not a device" in finding.found


def test_a_free_terminal_is_fine() -> None:
    master, slave = pty.openpty()
    try:
        found = list(port_findings("gps", os.ttyname(slave)))
        assert {finding.level for finding in found} == {Level.OK}
    finally:
        os.close(master)
        os.close(slave)


def test_a_port_that_is_held_names_the_process() -> None:
    master, slave = pty.openpty()
    name = os.ttyname(slave)
    file = port_lock.lock_file(name)
    file.write_text(f"{os.getppid():10d}\n")
    try:
        found = {finding.what: finding for finding in port_findings("gps", name)}
        assert found["held by"].level is Level.FAIL
        assert str(os.getppid()) in found["held by"].found
        assert found["held by"].code == 75
    finally:
        file.unlink()
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize(("latency", "level"), [("16", Level.WARN), ("1", Level.OK)])
def test_a_slow_latency_timer_is_told(tmp_path: Path, latency: str, level: Level) -> None:
    folder = tmp_path / "sys/bus/usb-serial/devices/ttyUSB0"
    folder.mkdir(parents=True)
    (folder / "latency_timer").write_text(latency + "\n")
    assert levels(list(adapter_findings("arm", "ttyUSB0", os.makedev(188, 0), tmp_path)))["latency timer"] is level


@pytest.mark.parametrize(("marks", "level"), [("", Level.WARN), ("E:ID_MM_DEVICE_IGNORE=1\n", Level.OK)])
def test_a_port_that_modem_manager_may_probe_is_told(tmp_path: Path, marks: str, level: Level) -> None:
    (tmp_path / "proc/77").mkdir(parents=True)
    (tmp_path / "proc/77/comm").write_text("ModemManager\n")
    (tmp_path / "run/udev/data").mkdir(parents=True)
    (tmp_path / "run/udev/data/c188:0").write_text(marks)
    assert levels(list(adapter_findings("arm", "ttyUSB0", os.makedev(188, 0), tmp_path)))["left alone"] is level


def test_a_clock_of_long_ago_or_without_a_source_is_told() -> None:
    assert clock_finding(datetime(1970, 1, 1, tzinfo=UTC), True).level is Level.WARN
    assert clock_finding(NOW, False).level is Level.WARN
    assert clock_finding(NOW, True).level is clock_finding(NOW, None).level is Level.OK


def test_an_old_calibration_is_told(tmp_path: Path) -> None:
    file = tmp_path / "rig.json"
    file.write_text("{}")
    now = datetime.fromtimestamp(file.stat().st_mtime, UTC)
    assert levels(list(calibration_findings(file, now)))["calibration"] is Level.OK
    assert levels(list(calibration_findings(file, now + timedelta(days=200))))["calibration"] is Level.WARN


def test_the_disk_of_a_folder_that_is_not_there_yet_is_its_parents(tmp_path: Path) -> None:
    assert str(tmp_path) in disk_finding(tmp_path / "not" / "yet").found


def test_the_exit_code_says_the_worst() -> None:
    missing = of_device_error("arm", "identity", DeviceMissing("arm", "a", "b", "c"))
    busy = of_device_error("gps", "identity", DeviceBusy("gps", "a", "b", "c"))
    fine = Finding("relay", "coils", Level.OK, "all off")
    assert (exit_code([fine]), exit_code([fine, busy]), exit_code([busy, missing, fine])) == (0, 75, 69)


def look(twin: Twin, name: str, before: c.Command | None = None) -> list[Finding]:
    async def main() -> list[Finding]:
        config, clock = load_config(DEMO), asyncio.get_running_loop().time
        stack = AsyncExitStack()  # nothing is traced, so nothing is left to it
        devices = build_devices(config, load_arm(config, DEMO)[0], twin, clock, BuildOptions(DEMO), stack)
        if before is not None:
            twin.apply(0.0, before)
        looks = {
            "relay": (devices.relay, lambda: look_at_relay(devices.relay)),
            "inputs": (devices.inputs, lambda: look_at_inputs(devices.inputs)),
            "arm": (devices.arm, lambda: look_at_arm(devices.arm)),
            "camera": (devices.camera, lambda: look_at_camera(devices.camera)),
        }
        device, looking = looks[name]
        return await examine(name, device, looking)

    return run_virtual(main())


def test_a_pressed_estop_and_a_faulty_servo_are_told() -> None:
    assert levels(look(rig.twin(), "inputs", c.WorldEstop(True)))["e-stop"] is Level.WARN
    assert levels(look(rig.twin(), "arm", c.WorldServoError(2, 0x20)))["elbow"] is Level.FAIL


@pytest.mark.parametrize(("turned_px", "level"), [(0.0, Level.OK), (1.0, Level.WARN)])
def test_the_doctor_tells_whether_points_lie_on_their_rows(turned_px: float, level: Level) -> None:
    twin = rig.twin()
    optics = twin.nominal.optics
    turn = rotation_from_rpy(turned_px / float(optics.K_left[0, 0]), 0.0, 0.0)
    calibrated = StereoRig(
        optics.image_size, optics.K_left, optics.K_right, optics.dist_left, optics.dist_right,
        turn @ optics.R, turn @ optics.t_m,
    )  # fmt: skip

    async def main() -> list[Finding]:
        config, clock = load_config(DEMO), asyncio.get_running_loop().time
        devices = build_devices(config, load_arm(config, DEMO)[0], twin, clock, BuildOptions(DEMO), AsyncExitStack())
        camera = watched(devices, calibrated, clock).camera
        return await examine("camera", camera, lambda: look_at_camera(camera))

    (rows,) = [finding for finding in run_virtual(main()) if finding.what == "rows"]
    assert rows.level is level, rows.found
    assert "px off" in rows.found
    assert (rows.remedy == "") is (level is Level.OK)


def test_a_silent_board_is_told_in_the_drivers_words() -> None:
    (finding,) = look(rig.twin("relay:off"), "relay")
    assert finding.level is Level.FAIL
    assert finding.code == 69
    assert finding.remedy


def test_a_dark_picture_is_told() -> None:
    dark = rig.twin(exposure_s=0.0001)
    assert Level.WARN in {finding.level for finding in look(dark, "camera")}
    assert {finding.level for finding in look(rig.twin(), "camera")} == {Level.OK}


def test_a_board_that_cannot_end_a_pulse_is_for_spraying_by_hand() -> None:
    class Plain:
        capability = BoardCapability(0.001, 0.0, None)

        async def read(self) -> RelayState:
            return RelayState(asyncio.get_running_loop().time(), {Channel.VALVE: False})

    async def main() -> dict[str, Level]:
        return levels([finding async for finding in look_at_relay(Plain())])  # type: ignore[arg-type]

    assert run_virtual(main())["pulses"] is Level.WARN


def test_a_healthy_simulated_rover_has_nothing_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    code = run_command(["doctor", "--config", "demo.toml", "--json"])
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {"relay", "inputs", "wheels", "arm", "camera", "gps", "modem"} <= {item["device"] for item in found}
    wrong = [item for item in found if item["level"] != "ok" and item["device"] not in ("clock", "disk")]
    assert wrong == []
    assert code in (0, 1)  # the computer itself may have a clock without a source
