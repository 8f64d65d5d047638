"""``sprayer emulate``: what it promises to programs that start it, and that it leaves nothing behind."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from dynamixel_sdk import COMM_SUCCESS, PacketHandler, PortHandler

from drivers.relay.values import Channel
from drivers.twin.aftermath import run_on
from robot.cli import run_command

from .emulated import EMULATED, emulator, start_emulator
from .rover_process import SPRAYER

USAGE, CONFIG = 64, 78
TORQUE_ENABLE, OPERATING_MODE, EXTENDED_POSITION, PRESENT_POSITION, GOAL_POSITION = 64, 11, 4, 132, 116


def until(condition: Callable[[], bool], longest_s: float = 20.0) -> None:
    end_s = time.monotonic() + longest_s
    while not condition():
        assert time.monotonic() < end_s, "waited in vain"
        time.sleep(0.02)


# --- what it prints, and how it ends


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.long)])
def test_one_line_of_json_is_all_it_says_until_a_signal_ends_it_clean(number: signal.Signals) -> None:
    command = [*SPRAYER, "emulate", "--json", "--only", "gps", "--only", "relay"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    ports = json.loads(process.stdout.readline())
    assert sorted(ports) == ["gps", "relay"]
    assert all(os.path.exists(path) for path in ports.values())
    device = os.open(ports["gps"], os.O_RDONLY | os.O_NOCTTY)
    assert b"$" in os.read(device, 100)  # it serves
    process.send_signal(number)
    out, errors = process.communicate(timeout=20)
    assert (process.returncode, out, errors) == (0, "", "")
    assert select.select([device], [], [], 5.0)[0]  # the port has hung up
    os.close(device)


@pytest.mark.long
def test_without_json_the_ports_are_a_table_for_a_person() -> None:
    process = subprocess.Popen([*SPRAYER, "emulate", "--only", "gps"], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    until(lambda: bool(select.select([process.stdout], [], [], 0)[0]))
    process.terminate()
    out, _ = process.communicate(timeout=20)
    assert "gps" in out
    assert "/dev/pts/" in out
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--only", "lidar"], USAGE, ("lidar", "known are arm, relay")),
        (["--fault", "relay:melted@3s"], USAGE, ("unknown verb 'melted'", "known are ok, off")),
        (["--fault", "relay"], USAGE, ("device:verb@start+duration",)),
        (["--fault", "lidar:off"], USAGE, ("unknown device 'lidar'",)),
        (["--config", "demo.toml"], CONFIG, ("backend is 'mock'", "no emulator")),
        (["--config", "gone.toml"], CONFIG, ("gone.toml", "no such configuration")),
    ],
)
def test_what_cannot_be_emulated_is_refused(
    capsys: pytest.CaptureFixture[str], arguments: list[str], code: int, words: tuple[str, ...]
) -> None:
    assert run_command(["emulate", "--json", *arguments]) == code
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.count("\n") == 1
    for word in words:
        assert word in shown.err


# --- the arm, for a client that is not ours


def test_only_the_arm_is_eight_limp_servos_in_extended_position_mode() -> None:
    handler = PacketHandler(2.0)
    with emulator("--only", "arm") as rover:
        assert list(rover.ports) == ["arm"]
        port = PortHandler(rover.ports["arm"])
        assert port.setBaudRate(1_000_000)
        found, result = handler.broadcastPing(port)
        assert (result, sorted(found)) == (COMM_SUCCESS, list(range(1, 9)))
        for servo in found:
            assert handler.read1ByteTxRx(port, servo, TORQUE_ENABLE) == (0, COMM_SUCCESS, 0)
            assert handler.read1ByteTxRx(port, servo, OPERATING_MODE) == (EXTENDED_POSITION, COMM_SUCCESS, 0)
        before, _, _ = handler.read4ByteTxRx(port, 1, PRESENT_POSITION)
        assert handler.write1ByteTxRx(port, 1, TORQUE_ENABLE, 1) == (COMM_SUCCESS, 0)
        assert handler.write4ByteTxRx(port, 1, GOAL_POSITION, before + 200) == (COMM_SUCCESS, 0)

        def moved() -> bool:
            now, result, _ = handler.read4ByteTxRx(port, 1, PRESENT_POSITION)
            return bool(result == COMM_SUCCESS and abs(now - before - 200) < 20)

        until(moved)
        port.closePort()


@pytest.mark.long
def test_two_rovers_stand_side_by_side_and_know_nothing_of_each_other() -> None:
    handler = PacketHandler(2.0)
    with emulator("--only", "arm") as first, emulator("--only", "arm") as second:
        assert first.ports["arm"] != second.ports["arm"]
        torques = []
        for rover, torque in ((first, 1), (second, 0)):
            port = PortHandler(rover.ports["arm"])
            port.setBaudRate(1_000_000)
            if torque:
                assert handler.write1ByteTxRx(port, 3, TORQUE_ENABLE, 1) == (COMM_SUCCESS, 0)
            torques.append(handler.read1ByteTxRx(port, 3, TORQUE_ENABLE)[0])
            port.closePort()
        assert torques == [1, 0]


# --- plugs


@pytest.mark.parametrize(
    "fault", ["relay:unplugged@4s+1s", pytest.param("inputs:unplugged@4s+1s", marks=pytest.mark.long)]
)
def test_a_stable_name_goes_with_the_plug_and_comes_back_with_it(tmp_path: Path, fault: str) -> None:
    arguments = ["--only", "relay", "--only", "inputs", "--only", "gps", "--links", str(tmp_path), "--fault", fault]
    with emulator(*arguments) as rover:
        name, other = tmp_path / "relay", tmp_path / "gps"
        assert os.path.realpath(name) == rover.ports["relay"] == rover.ports["inputs"]
        device = os.open(name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        gone_s = back_s = 0.0
        until(lambda: not name.is_symlink())
        gone_s = time.monotonic()
        assert not os.path.exists(rover.ports["relay"])
        with pytest.raises(OSError, match="Input/output error"):
            os.write(device, b"x")
        os.close(device)
        until(name.exists)
        back_s = time.monotonic()
        assert other.exists()
        assert back_s - gone_s > 0.5
    assert not name.is_symlink()


# --- nothing is left behind


def family(process: int) -> set[int]:
    """All processes that descend from this one."""
    try:
        children = {int(word) for word in Path(f"/proc/{process}/task/{process}/children").read_text().split()}
    except OSError:
        return set()
    return children.union(*(family(child) for child in children))


def lives(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_killed_emulator_leaves_no_process_behind() -> None:
    rover = start_emulator("--only", "camera")
    helpers = family(rover.process.pid)
    assert len(helpers) >= 1
    assert rover.end(signal.SIGKILL) == -signal.SIGKILL
    until(lambda: not any(lives(helper) for helper in helpers))
    rover.process.communicate()


def test_the_keyboard_ends_the_emulator_and_its_helpers_without_a_word() -> None:
    command = [*SPRAYER, "emulate", "--json", "--only", "camera"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdout is not None
    assert "camera" in json.loads(process.stdout.readline())
    helpers = family(process.pid)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    out, errors = process.communicate(timeout=20)
    assert (process.returncode, out, errors) == (0, "", "")
    until(lambda: not any(lives(helper) for helper in helpers))


PULSES = """
import asyncio, sys
from pathlib import Path
from drivers.line import PortSettings
from drivers.modbus_master import ModbusMaster
from drivers.relay.modbus import ModbusRelay
from drivers.relay.modbus_settings import RelaySettings
from drivers.relay.values import Channel
from drivers.serial_port import SerialPort
from robot.clock import run_real
from robot.runtime.emulator_process import EmulatorOptions, emulator_process

async def main() -> None:
    clock = asyncio.get_running_loop().time
    options = EmulatorOptions(Path(sys.argv[1]), 1, asyncio.get_running_loop().zero_s, Path(sys.argv[2]))
    async with emulator_process(options) as ports:
        port = SerialPort(PortSettings(ports["relay"], "relay", 115200, "modbus"), clock)
        settings = RelaySettings("waveshare-8", 1, {Channel.VALVE: 1, Channel.PUMP: 2, Channel.CONTACTOR: 4})
        board = ModbusRelay(settings, ModbusMaster(port), clock)
        await board.open()
        await board.switch(Channel.CONTACTOR, True)  # valve and pump hang on it
        await board.pulse(Channel.PUMP, 5.0)
        await asyncio.sleep(1.5)
        await board.pulse(Channel.VALVE, 0.9)
        print("spraying", flush=True)
        await asyncio.sleep(60.0)

run_real(main())
"""


@pytest.mark.long
def test_a_robot_that_is_killed_is_outlived_by_its_machine_until_the_boards_timer_has_shut_the_valve(
    tmp_path: Path,
) -> None:
    truth = tmp_path / "truth.jsonl"
    robot = subprocess.Popen(
        [sys.executable, "-c", PULSES, str(EMULATED), str(truth)], stdout=subprocess.PIPE, text=True
    )
    assert robot.stdout is not None
    assert robot.stdout.readline() == "spraying\n"
    machine = family(robot.pid)
    assert len(machine) >= 1
    robot.kill()
    robot.wait(10)
    robot.stdout.close()
    killed_s = time.monotonic()
    until(lambda: '"valve_closed"' in truth.read_text(), 10.0)
    assert time.monotonic() - killed_s > 0.3  # by its timer, not by the kill
    assert any(lives(process) for process in machine)
    until(lambda: not any(lives(process) for process in machine), 30.0)
    after = run_on(truth)
    assert 0.8 < after.longest_opening_s < 1.0
    assert not after.coils[Channel.VALVE]
    assert not after.coils[Channel.PUMP]
    assert after.total_ml > 1.0
    assert after.after_ml == pytest.approx(0.0, abs=1e-9)
