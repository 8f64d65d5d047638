"""The emulated servos, byte for byte: strict about what they hear, true to their control table."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.arm.control_tables import MODELS, TICK_RAD
from drivers.arm.emulator import DynamixelEmulator, viperx300_joints
from drivers.arm.joints import JointSettings, ServoSettings
from drivers.arm.protocol2 import BROADCAST, Instruction, Packet, PacketReader, StatusError, packet
from drivers.emulation.bad_line import BadLine
from drivers.twin import Twin
from drivers.twin import commands as c
from tests.drivers.twin import rig
from tests.drivers.twin.rig import STOW_RAD

BYTE_S = 1e-5


class Bench:
    """Servos without a wire: what is said to them and what they answer, on a clock that is set by hand."""

    def __init__(self, *faults: str, **options: object) -> None:
        self.now_s = 0.0
        self.twin: Twin = rig.twin(*faults)
        self.said: list[tuple[bytes, float]] = []
        self.emulator = DynamixelEmulator(self.twin, lambda: self.now_s, **options)  # type: ignore[arg-type]
        self.emulator.connect(BadLine("arm", self.twin, lambda: self.now_s, self._said, BYTE_S))

    def _said(self, data: bytes, delay_s: float) -> None:
        self.said.append((data, delay_s))

    def raw(self, data: bytes) -> list[Packet]:
        self.said.clear()
        self.emulator.receive(data)
        heard = PacketReader().feed(b"".join(answer for answer, _ in self.said))
        assert all(isinstance(item, Packet) for item in heard)
        return [item for item in heard if isinstance(item, Packet)]

    def ask(self, servo_id: int, instruction: int, data: bytes = b"") -> list[Packet]:
        return self.raw(packet(servo_id, instruction, data))

    def error(self, servo_id: int, instruction: int, data: bytes = b"") -> int:
        (answer,) = self.ask(servo_id, instruction, data)
        return answer.data[0]

    def write(self, servo_id: int, name: str, value: int) -> int:
        register = MODELS["XM540-W270"].register(name)
        data = register.address.to_bytes(2, "little") + register.encode(value)
        return self.error(servo_id, Instruction.WRITE, data)

    def read(self, servo_id: int, name: str) -> int:
        register = MODELS["XM540-W270"].register(name)
        data = register.address.to_bytes(2, "little") + register.size.to_bytes(2, "little")
        (answer,) = self.ask(servo_id, Instruction.READ, data)
        assert answer.data[0] & 0x7F == 0
        return register.decode(answer.data[1:])

    def wait(self, for_s: float) -> None:
        self.now_s += for_s
        self.twin.advance(self.now_s)


def word(*values: int) -> bytes:
    return b"".join(value.to_bytes(2, "little") for value in values)


def tick_of(angle_rad: float) -> int:
    return 2048 + round(angle_rad / TICK_RAD)


def test_a_ping_tells_model_and_firmware() -> None:
    (answer,) = Bench().ask(8, Instruction.PING)
    assert answer.data == b"\0" + word(1020) + bytes([46])


def test_a_broadcast_ping_is_answered_by_all_one_after_the_other() -> None:
    bench = Bench()
    answers = bench.ask(BROADCAST, Instruction.PING)
    assert [answer.servo_id for answer in answers] == list(range(1, 9))
    delays = [delay for _, delay in bench.said]
    assert all(b - a >= 0.0009 for a, b in pairwise(delays))


def test_an_unstuffed_body_is_not_obeyed() -> None:
    bench = Bench()
    assert bench.raw(bytes.fromhex("fffffd000109000374 00fffffdffcb05")) == []
    assert bench.read(1, "goal_position") == tick_of(STOW_RAD[0])


def test_a_stuffed_goal_is_written_and_read_back_with_torque_off() -> None:
    bench = Bench(cold=True)
    assert bench.raw(bytes.fromhex("fffffd00010a00037400fffffdfdff23e5"))[0].data == b"\0"
    assert bench.read(1, "goal_position") == -131_073


def test_a_wrong_checksum_is_answered_with_its_error() -> None:
    bench = Bench()
    data = bytearray(packet(1, Instruction.PING))
    data[-1] ^= 1
    (answer,) = bench.raw(bytes(data))
    assert answer.data[0] == StatusError.CRC


@pytest.mark.parametrize(
    ("instruction", "data", "error"),
    [
        (Instruction.WRITE, word(132) + bytes(4), StatusError.ACCESS),  # present position
        (Instruction.WRITE, word(11) + b"\3", StatusError.ACCESS),  # EEPROM under torque
        (Instruction.WRITE, word(68) + b"\7", StatusError.DATA_RANGE),
        (Instruction.WRITE, word(116) + (2_000_000).to_bytes(4, "little"), StatusError.DATA_RANGE),
        (Instruction.WRITE, word(104) + (1000).to_bytes(4, "little"), StatusError.DATA_LIMIT),
        (Instruction.WRITE, word(116) + b"\0\0", StatusError.DATA_LENGTH),
        (Instruction.WRITE, word(116), StatusError.DATA_LENGTH),
        (Instruction.WRITE, word(66) + b"\0", StatusError.ACCESS),  # no register
        (Instruction.READ, word(140, 100), StatusError.ACCESS),
        (Instruction.READ, word(140), StatusError.DATA_LENGTH),
        (0x77, b"", StatusError.INSTRUCTION),
    ],
)
def test_what_cannot_be_done_is_answered_with_its_error(instruction: int, data: bytes, error: StatusError) -> None:
    assert Bench().error(1, instruction, data) == error


def test_a_hardware_error_raises_the_alert_bit_and_takes_torque() -> None:
    bench = Bench()
    bench.twin.apply(0.0, c.WorldServoError(joint=2, error=0x20))
    bench.read(4, "present_position")
    assert bench.error(4, Instruction.PING) == 0x80
    assert bench.read(4, "hardware_error_status") == 0x20
    assert bench.read(4, "torque_enable") == 0
    assert bench.write(4, "torque_enable", 1) == 0x80 | StatusError.ACCESS
    assert bench.error(6, Instruction.PING) == 0


def test_goals_beyond_the_limits_are_refused_in_position_mode() -> None:
    bench = Bench(cold=True)
    assert bench.write(1, "operating_mode", 3) == 0
    assert bench.write(1, "min_position_limit", 1000) == 0
    assert bench.write(1, "goal_position", 999) == StatusError.DATA_LIMIT
    assert bench.write(1, "goal_position", 1000) == 0


def test_a_goal_moves_the_joint_and_its_shadow_shows_it_mirrored() -> None:
    bench = Bench()
    bench.write(2, "goal_position", tick_of(0.2))
    bench.wait(4.0)
    assert abs(bench.twin.joints_rad[1] - 0.2) < 0.002
    assert abs(bench.read(2, "present_position") + bench.read(3, "present_position") - 4096) <= 1


def test_a_profile_bounds_the_speed() -> None:
    bench = Bench()
    bench.write(1, "profile_velocity", 10)  # 0.24 rad/s
    bench.write(1, "goal_position", tick_of(0.8))
    bench.wait(1.5)
    assert abs(abs(bench.read(1, "present_velocity")) - 10) <= 1
    assert bench.read(1, "moving") == 0  # at the moving threshold, not above it
    assert 0.2 < bench.twin.joints_rad[0] < 0.4


def test_torque_on_goes_to_the_goal_that_was_written_before() -> None:
    bench = Bench(cold=True)
    bench.write(1, "goal_position", tick_of(0.3))
    bench.wait(2.0)
    assert abs(bench.twin.joints_rad[0]) < 1e-6
    bench.write(1, "torque_enable", 1)
    bench.wait(2.0)
    assert abs(bench.twin.joints_rad[0] - 0.3) < 0.002


def test_a_registered_write_waits_for_the_action() -> None:
    bench = Bench()
    goal = word(116) + tick_of(0.3).to_bytes(4, "little")
    assert bench.error(1, Instruction.REG_WRITE, goal) == 0
    assert bench.read(1, "registered_instruction") == 1
    bench.wait(1.0)
    assert abs(bench.twin.joints_rad[0]) < 1e-6
    assert bench.ask(BROADCAST, Instruction.ACTION) == []
    bench.wait(2.0)
    assert abs(bench.twin.joints_rad[0] - 0.3) < 0.002
    assert bench.read(1, "registered_instruction") == 0


def test_a_sync_read_is_answered_in_its_order() -> None:
    bench = Bench()
    answers = bench.ask(BROADCAST, Instruction.SYNC_READ, word(132, 4) + bytes([8, 1, 2]))
    assert [answer.servo_id for answer in answers] == [8, 1, 2]
    assert abs(int.from_bytes(answers[2].data[1:], "little", signed=True) - tick_of(STOW_RAD[1])) <= 2


def test_behind_a_silent_servo_nobody_answers_a_sync_read() -> None:
    bench = Bench()
    bench.emulator.servo(2).dead = True
    answers = bench.ask(BROADCAST, Instruction.SYNC_READ, word(132, 4) + bytes([1, 2, 3]))
    assert [answer.servo_id for answer in answers] == [1]


def test_a_fast_sync_read_is_answered_in_one_packet() -> None:
    bench = Bench()
    (answer,) = bench.ask(BROADCAST, Instruction.FAST_SYNC_READ, word(132, 4) + bytes([1, 6]))
    assert answer.servo_id == BROADCAST
    assert answer.data[1] == 1
    assert answer.data[9] == 6


def test_bulk_reads_and_writes_take_different_registers() -> None:
    bench = Bench()
    data = bytes([1]) + word(108, 4) + (20).to_bytes(4, "little") + bytes([2]) + word(65, 1) + b"\1"
    assert bench.ask(BROADCAST, Instruction.BULK_WRITE, data) == []
    assert (bench.read(1, "profile_acceleration"), bench.read(2, "led")) == (20, 1)
    asked = bytes([1]) + word(108, 4) + bytes([2]) + word(65, 1)
    answers = bench.ask(BROADCAST, Instruction.BULK_READ, asked)
    assert [answer.data for answer in answers] == [b"\0" + (20).to_bytes(4, "little"), b"\0\1"]
    (fast,) = bench.ask(BROADCAST, Instruction.FAST_BULK_READ, asked)
    assert fast.data[:6] == b"\0\1" + (20).to_bytes(4, "little")


def test_a_servo_answers_as_late_as_its_return_delay_says() -> None:
    bench = Bench(cold=True)
    bench.write(1, "return_delay_time", 100)
    bench.ask(1, Instruction.PING)
    assert bench.said[0][1] == pytest.approx(200e-6)
    bench.write(2, "return_delay_time", 50)
    bench.ask(BROADCAST, Instruction.SYNC_READ, word(132, 4) + bytes([1, 2]))
    assert bench.said[0][1] == pytest.approx(300e-6)


def test_the_status_return_level_silences_answers() -> None:
    bench = Bench()
    assert bench.write(1, "status_return_level", 1) == 0
    assert bench.ask(1, Instruction.WRITE, word(65) + b"\1") == []
    assert bench.read(1, "led") == 1
    assert bench.ask(1, Instruction.WRITE, word(68) + b"\0") == []
    assert bench.ask(1, Instruction.READ, word(65, 1)) == []
    assert len(bench.ask(1, Instruction.PING)) == 1


def test_a_reboot_loses_ram_and_torque_and_keeps_eeprom() -> None:
    bench = Bench()
    bench.write(1, "bus_watchdog", 20)
    bench.write(1, "profile_velocity", 30)
    bench.wait(5.0)
    assert bench.error(1, Instruction.REBOOT) == 0
    assert bench.ask(1, Instruction.PING) == []
    bench.wait(0.5)
    assert bench.read(1, "realtime_tick") < 600
    assert [bench.read(1, name) for name in ("torque_enable", "bus_watchdog", "profile_velocity")] == [0, 0, 0]
    assert bench.read(1, "operating_mode") == 4


def test_the_realtime_tick_counts_milliseconds_and_begins_anew() -> None:
    bench = Bench()
    bench.wait(30.0)
    assert bench.read(1, "realtime_tick") == 30_000
    bench.wait(3.0)
    assert bench.read(1, "realtime_tick") == 33_000 - 32_768


def test_a_factory_reset_is_refused_under_torque_and_to_all() -> None:
    bench = Bench()
    assert bench.error(1, Instruction.FACTORY_RESET, b"\1") == StatusError.ACCESS
    assert bench.ask(BROADCAST, Instruction.FACTORY_RESET, b"\xff") == []
    assert bench.read(1, "operating_mode") == 4
    cold = Bench(cold=True)
    assert cold.error(1, Instruction.FACTORY_RESET, b"\1") == 0
    cold.wait(0.5)
    assert cold.read(1, "operating_mode") == 3
    assert cold.read(1, "baud_rate") == 1


def test_clear_multi_turn_wants_its_five_bytes() -> None:
    bench = Bench()
    assert bench.error(1, Instruction.CLEAR, bytes.fromhex("0144584c22")) == 0
    assert bench.error(1, Instruction.CLEAR, b"\1") == StatusError.DATA_RANGE


def test_goals_are_read_only_after_the_watchdog_has_tripped() -> None:
    bench = Bench()
    bench.write(1, "bus_watchdog", 10)
    bench.wait(0.5)
    assert bench.write(1, "goal_position", tick_of(0.5)) == StatusError.DATA_RANGE
    assert bench.read(1, "bus_watchdog") == -1
    bench.wait(1.0)
    assert abs(bench.twin.joints_rad[0]) < 1e-6
    assert bench.write(1, "bus_watchdog", 0) == 0
    assert bench.write(1, "goal_position", tick_of(0.5)) == 0


def test_words_to_one_servo_do_not_feed_anothers_watchdog() -> None:
    bench = Bench()
    bench.write(1, "bus_watchdog", 10)
    for _ in range(10):
        bench.wait(0.05)
        bench.ask(6, Instruction.PING)
    assert bench.read(1, "bus_watchdog") == -1


def test_other_models_have_their_own_registers() -> None:
    joints = tuple(
        JointSettings(joint.name, (ServoSettings(k, "XL430-W250" if k == 1 else "XM430-W210"),), -1.0, 1.0)
        for k, joint in enumerate(viperx300_joints(rig.twin()), start=1)
    )
    bench = Bench(joints=joints)
    assert bench.error(1, Instruction.WRITE, word(102) + b"\0\0") == StatusError.ACCESS  # an XL430 has no goal current
    assert bench.error(2, Instruction.WRITE, word(102) + b"\0\0") == 0


def test_a_wrong_arm_shows_its_first_joint_off() -> None:
    bench = Bench("arm:wrong@0s")
    assert abs(bench.read(1, "present_position") - tick_of(0.05)) <= 2


def test_a_stuck_arm_repeats_itself() -> None:
    bench = Bench("arm:stuck@1s")
    bench.wait(1.5)
    before = bench.read(1, "present_position")
    bench.write(1, "goal_position", tick_of(1.0))
    bench.wait(2.0)
    assert bench.read(1, "present_position") == before
    assert math.isclose(bench.twin.joints_rad[0], 0.0, abs_tol=1e-9)


@given(data=st.binary(max_size=120), servo=st.integers(0, 12), kind=st.sampled_from([int(i) for i in Instruction]))
@settings(max_examples=200, deadline=None)
def test_no_packet_upsets_the_servos(data: bytes, servo: int, kind: int) -> None:
    bench = Bench(cold=True)
    bench.emulator.receive(packet(servo if servo < 12 else BROADCAST, kind, data))
    bench.emulator.receive(data)
    bench.wait(1.0)
    assert bench.ask(9, Instruction.PING) == []
