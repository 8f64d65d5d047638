"""The emulated controller keeps to its manual, whoever speaks to it."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import pytest

from drivers.emulation.modbus_slave import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE, ModbusException
from drivers.twin.commands import WorldEstop
from drivers.wheels import zlac_registers as r
from drivers.wheels.drive_geometry import speed_of
from drivers.wheels.emulator import Zlac8015dEmulator
from tests.drivers.twin import rig

RADIUS_M = 0.1


class Host:
    """Asks the controller in a time that the test lets pass."""

    def __init__(self, *faults: str) -> None:
        self.now_s = 0.0
        self.twin = rig.twin(*faults)
        self.controller = Zlac8015dEmulator(self.twin, lambda: self.now_s)

    def wait(self, seconds: float) -> None:
        self.now_s += seconds
        self.twin.advance(self.now_s)

    def read(self, address: int, count: int = 1) -> list[int]:
        answer = self.controller.answer(3, struct.pack(">HH", address, count))
        assert answer is not None
        assert answer[0] == 2 * count
        return list(struct.unpack(f">{count}H", answer[1:]))

    def write(self, register: r.Register, value: int) -> None:
        data = struct.pack(">HH", register.address, value & 0xFFFF)
        assert self.controller.answer(6, data) == data

    def write_more(self, first: r.Register, values: Sequence[int]) -> None:
        words = struct.pack(f">{len(values)}H", *(value & 0xFFFF for value in values))
        head = struct.pack(">HH", first.address, len(values))
        assert self.controller.answer(16, head + bytes([len(words)]) + words) == head

    def enable(self) -> None:
        self.write(r.MODE, r.VELOCITY_MODE)
        self.write(r.CONTROL, r.Control.ENABLE)

    def turn(self, left_rpm: int, right_rpm: int, seconds: float = 0.0) -> None:
        """Wanted speeds, renewed at 20 Hz."""
        for _ in range(max(1, round(seconds / 0.05))):
            self.write_more(r.LEFT_TARGET, (left_rpm, right_rpm))
            self.wait(0.05)

    @property
    def speed_m_s(self) -> float:
        return self.twin.physics.drive.speeds_m_s[0]


@pytest.fixture
def host() -> Host:
    return Host()


def test_it_turns_only_when_enabled(host: Host) -> None:
    host.write(r.MODE, r.VELOCITY_MODE)
    host.turn(20, -20, 1.0)
    assert host.speed_m_s == 0.0
    host.write(r.CONTROL, r.Control.ENABLE)
    host.turn(20, -20, 1.0)
    assert host.speed_m_s == pytest.approx(speed_of(20, RADIUS_M))


def test_it_turns_only_in_velocity_mode(host: Host) -> None:
    host.write(r.CONTROL, r.Control.ENABLE)
    host.turn(20, -20, 1.0)
    assert host.speed_m_s == 0.0


def test_wanted_speeds_that_stood_there_count_when_it_is_enabled(host: Host) -> None:
    host.turn(20, -20)
    host.enable()
    host.wait(1.0)
    assert host.speed_m_s > 0.0


def test_as_bought_it_never_times_out(host: Host) -> None:
    host.enable()
    host.turn(20, -20, 1.0)
    host.wait(60.0)
    assert host.speed_m_s == pytest.approx(speed_of(20, RADIUS_M))


def test_after_the_offline_time_it_stops_and_forgets_the_wanted_speed(host: Host) -> None:
    host.write(r.OFFLINE_TIME, 300)
    host.enable()
    host.turn(20, -20, 1.0)
    host.wait(0.2)
    assert host.speed_m_s == pytest.approx(speed_of(20, RADIUS_M))
    host.wait(1.0)
    assert host.speed_m_s == 0.0
    assert host.read(r.LEFT_TARGET.address, 2) == [0, 0]
    host.wait(1.0)
    assert host.speed_m_s == 0.0
    assert host.read(r.STATUS.address) == [r.Status.LOCKED << 8 | r.Status.LOCKED]


def test_any_frame_holds_the_offline_time_off(host: Host) -> None:
    host.write(r.OFFLINE_TIME, 300)
    host.enable()
    host.turn(20, -20, 1.0)
    for _ in range(20):
        host.read(r.LEFT_FAULTS.address, 2)
        host.wait(0.1)
    assert host.speed_m_s == pytest.approx(speed_of(20, RADIUS_M))


def test_speeds_rise_and_fall_in_the_times_set(host: Host) -> None:
    host.write(r.MAX_SPEED, 50)
    host.write_more(r.LEFT_RISE, (2000, 2000, 500, 500))
    host.enable()
    host.turn(40, -40, 1.0)
    assert host.speed_m_s == pytest.approx(speed_of(25, RADIUS_M), rel=0.02)
    host.turn(40, -40, 1.0)
    host.turn(0, 0, 0.1)
    assert host.speed_m_s == pytest.approx(speed_of(30, RADIUS_M), rel=0.02)


def test_it_does_not_turn_faster_than_the_highest_speed_set(host: Host) -> None:
    host.write(r.MAX_SPEED, 15)
    host.enable()
    host.turn(40, -40, 2.0)
    assert host.speed_m_s == pytest.approx(speed_of(15, RADIUS_M))


@pytest.mark.parametrize("word", [r.Control.EMERGENCY_STOP, r.Control.DISABLE])
def test_stopped_by_the_control_word_it_takes_no_command_until_enabled(host: Host, word: r.Control) -> None:
    host.enable()
    host.turn(20, -20, 1.0)
    host.write(r.CONTROL, word)
    host.wait(1.0)
    host.turn(20, -20, 1.0)
    assert host.speed_m_s == 0.0
    host.write(r.CONTROL, r.Control.ENABLE)
    host.turn(20, -20, 1.0)
    assert host.speed_m_s > 0.0


def test_an_alarm_stops_it_and_only_clearing_ends_it(host: Host) -> None:
    host.enable()
    host.turn(20, -20, 1.0)
    host.controller.raise_alarm(left=0x0004)
    host.write(r.CONTROL, r.Control.ENABLE)
    host.turn(20, -20, 1.0)
    assert host.speed_m_s == 0.0
    assert host.read(r.STATUS.address) == [0xC0C0]
    assert host.read(r.LEFT_FAULTS.address, 2) == [0x0004, 0]
    host.write(r.CONTROL, r.Control.CLEAR_ALARM)
    assert host.read(r.LEFT_FAULTS.address, 2) == [0, 0]
    assert host.read(r.STATUS.address) == [0]


def test_the_opened_e_stop_chain_holds_it_until_it_is_enabled_anew(host: Host) -> None:
    host.enable()
    host.turn(20, -20, 1.0)
    host.twin.apply(host.now_s, WorldEstop(True))
    host.turn(20, -20, 1.0)
    assert host.read(r.STATUS.address) == [0x8080]
    host.twin.apply(host.now_s, WorldEstop(False))
    host.turn(20, -20, 1.0)
    assert host.speed_m_s == 0.0
    host.write(r.CONTROL, r.Control.ENABLE)
    host.turn(20, -20, 1.0)
    assert host.speed_m_s > 0.0


def test_it_counts_and_tells_speeds_with_the_right_motor_mirrored(host: Host) -> None:
    host.enable()
    host.turn(30, -30, 3.0)
    words = host.read(r.FIRST_ODOMETRY, r.ODOMETRY_WORDS)
    left, right = r.signed_32(words[2], words[3]), r.signed_32(words[4], words[5])
    turns = host.twin.physics.drive.counters_m[0] / (6.283185307 * RADIUS_M)
    assert left == pytest.approx(4096 * turns, abs=4)
    assert right == pytest.approx(-4096 * turns, abs=4)
    assert r.signed_16(words[6]) == pytest.approx(300, abs=6)
    assert r.signed_16(words[7]) == pytest.approx(-300, abs=6)


def test_high_and_low_word_of_a_reading_belong_together(host: Host) -> None:
    host.enable()
    host.controller.preset_counters(0xFFF0, 0)
    seen = []
    for _ in range(60):
        host.turn(5, -5)
        words = host.read(r.FIRST_ODOMETRY, r.ODOMETRY_WORDS)
        seen.append(r.signed_32(words[2], words[3]))
    assert all(abs(later - earlier) < 200 for earlier, later in zip(seen[1:], seen[:-1], strict=True))
    assert seen[-1] > 0x10000


def test_off_and_on_it_has_forgotten_settings_and_counters(host: Host) -> None:
    host.write(r.OFFLINE_TIME, 300)
    host.enable()
    host.turn(20, -20, 1.0)
    host.controller.power_cycle()
    assert host.read(r.OFFLINE_TIME.address) == [0]
    assert host.read(r.MODE.address) == [0]
    words = host.read(r.FIRST_ODOMETRY, r.ODOMETRY_WORDS)
    assert abs(r.signed_32(words[2], words[3])) < 4
    host.wait(2.0)
    assert host.speed_m_s == 0.0


def test_motors_at_work_get_warm(host: Host) -> None:
    host.enable()
    cold = host.read(r.MOTOR_TEMPERATURES.address)[0]
    host.turn(45, -45, 300.0)
    assert host.read(r.MOTOR_TEMPERATURES.address)[0] & 0xFF > cold & 0xFF


@pytest.mark.parametrize(
    ("function", "data", "code"),
    [
        (3, struct.pack(">HH", 0x20B1, 1), ILLEGAL_ADDRESS),
        (3, struct.pack(">HH", 0x20A0, 18), ILLEGAL_ADDRESS),
        (3, struct.pack(">HH", 0, 1), ILLEGAL_ADDRESS),
        (6, struct.pack(">HH", 0x20A5, 0), ILLEGAL_ADDRESS),
        (6, struct.pack(">HH", 0x2000, 0x8000), ILLEGAL_VALUE),
        (6, struct.pack(">HH", 0x200D, 5), ILLEGAL_VALUE),
        (6, struct.pack(">HH", 0x200E, 9), ILLEGAL_VALUE),
        (6, struct.pack(">HH", 0x2008, 0), ILLEGAL_VALUE),
        (6, struct.pack(">HH", 0x2088, 4000), ILLEGAL_VALUE),
        (16, struct.pack(">HHBHH", 0x2083, 2, 4, 1, 1), ILLEGAL_ADDRESS),
        (4, struct.pack(">HH", 0x20A0, 1), ILLEGAL_FUNCTION),
        (5, struct.pack(">HH", 0x2000, 0xFF00), ILLEGAL_FUNCTION),
    ],
)
def test_what_it_does_not_know_it_answers_with_an_exception(host: Host, function: int, data: bytes, code: int) -> None:
    with pytest.raises(ModbusException) as caught:
        host.controller.answer(function, data)
    assert caught.value.code == code


def test_a_refused_write_changes_nothing(host: Host) -> None:
    with pytest.raises(ModbusException):
        host.write_more(r.LEFT_FALL, (700, 700, 700))
    assert host.read(r.LEFT_FALL.address, 2) == [500, 500]


def test_stuck_it_repeats_itself() -> None:
    host = Host("wheels:stuck@1s")
    host.enable()
    host.turn(20, -20, 2.0)
    first = host.read(r.FIRST_ODOMETRY, r.ODOMETRY_WORDS)
    host.wait(1.0)
    assert host.read(r.FIRST_ODOMETRY, r.ODOMETRY_WORDS) == first


def test_wrong_it_counts_too_much() -> None:
    host = Host("wheels:wrong@0s")
    host.enable()
    host.turn(20, -20, 3.0)
    words = host.read(r.FIRST_ODOMETRY, r.ODOMETRY_WORDS)
    turns = host.twin.physics.drive.counters_m[0] / (6.283185307 * RADIUS_M)
    assert r.signed_32(words[2], words[3]) == pytest.approx(1.05 * 4096 * turns, rel=0.01)
