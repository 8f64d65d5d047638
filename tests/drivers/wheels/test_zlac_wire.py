"""The frames that the driver writes and reads, byte by byte. Those of the maker's manual are named so."""

from __future__ import annotations

from drivers.modbus_frames import FrameFinder, request_size
from drivers.wheels.drive_geometry import Mounting, speed_of
from tests.contract.rigs.wheels import WheelsRig
from tests.drivers.wheels.bench import drive, run, speed_m_s

READ_FUNCTION = 3


def frames(heard: bytes | bytearray) -> list[bytes]:
    return [found.data for found in FrameFinder(request_size).feed(bytes(heard))]


def frame(text: str) -> bytes:
    return bytes.fromhex(text)


VELOCITY_MODE = frame("01 06 20 0D 00 03 53 C8")  # manual
BOTH_100_RPM = frame("01 10 20 88 00 02 04 00 64 00 64 23 9C")  # manual
BOTH_0_RPM = frame("01 10 20 88 00 02 04 00 00 00 00 63 A8")
ENABLE = frame("01 06 20 0E 00 08 E2 0F")
READ_ODOMETRY = frame("01 03 20 A5 00 08 5F EF")
OFFLINE_500_MS = frame("01 06 20 00 01 F4 82 1D")

MAX_48_RPM = frame("01 06 20 08 00 30 03 DC")
UP_IN_1006_DOWN_IN_503_MS = frame("01 10 20 80 00 04 08 03 EE 03 EE 01 F7 01 F7 9D 43")
FORWARD_40_RPM = frame("01 10 20 88 00 02 04 00 28 FF D8 A2 0A")
EMERGENCY_STOP = frame("01 06 20 0E 00 05 23 CA")
RELEASE = frame("01 06 20 0E 00 07 A2 0B")
READ_SPEEDS = frame("01 03 20 AB 00 02 BE 2B")  # manual


def test_opening_reads_first_then_commands_zero_and_enables_last() -> None:
    async def test(bench: WheelsRig) -> None:
        said = frames(bench.heard)
        first_write = next(k for k, sent in enumerate(said) if sent[1] != READ_FUNCTION)
        assert first_write >= 3
        assert said[first_write] == BOTH_0_RPM
        assert said[-1] == ENABLE
        assert said.count(ENABLE) == 1

    run(test)


def test_opening_sets_velocity_mode_time_out_and_limits() -> None:
    async def test(bench: WheelsRig) -> None:
        said = frames(bench.heard)
        assert VELOCITY_MODE in said
        assert OFFLINE_500_MS in said
        assert MAX_48_RPM in said  # 0.5 m/s
        assert UP_IN_1006_DOWN_IN_503_MS in said

    run(test)


def test_what_was_set_is_read_back() -> None:
    async def test(bench: WheelsRig) -> None:
        said = frames(bench.heard)
        for written, read in ((VELOCITY_MODE, "01 03 20 0D 00 01"), (OFFLINE_500_MS, "01 03 20 00 00 01")):
            assert said[said.index(written) + 1].startswith(frame(read))

    run(test)


def test_a_speed_goes_out_as_one_frame_for_both_wheels() -> None:
    async def test(bench: WheelsRig) -> None:
        bench.heard.clear()
        await bench.device.drive(speed_of(100.0, 0.1), 0.0)
        assert frames(bench.heard)[-1] == BOTH_100_RPM

    run(test, max_speed_m_s=1.1, mounting=Mounting(right_mirrored=False), right_mirrored=False)


def test_forward_turns_the_mirrored_right_motor_backwards() -> None:
    async def test(bench: WheelsRig) -> None:
        bench.heard.clear()
        await bench.device.drive(speed_of(40.0, 0.1), 0.0)
        assert frames(bench.heard)[-1] == FORWARD_40_RPM

    run(test)


def test_odometry_is_one_read() -> None:
    async def test(bench: WheelsRig) -> None:
        bench.heard.clear()
        await bench.device.odometry()
        assert bytes(bench.heard) == READ_ODOMETRY

    run(test)


def test_a_renewed_command_is_one_frame() -> None:
    async def test(bench: WheelsRig) -> None:
        await bench.device.drive(0.2, 0.0)
        bench.heard.clear()
        await bench.device.drive(0.2, 0.0)
        assert len(bench.heard) == len(BOTH_0_RPM)

    run(test)


def test_stop_is_one_frame() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 0.5, 0.2)
        bench.heard.clear()
        await bench.device.stop()
        assert bytes(bench.heard) == BOTH_0_RPM

    run(test)


def test_the_emergency_stop_is_control_word_5() -> None:
    async def test(bench: WheelsRig) -> None:
        bench.heard.clear()
        await bench.device.emergency_stop()
        assert bytes(bench.heard) == EMERGENCY_STOP

    run(test)


def test_closing_releases_the_motors_once_they_stand() -> None:
    async def test(bench: WheelsRig) -> None:
        await drive(bench, 0.5, 0.2)
        bench.heard.clear()
        await bench.device.close()
        said = frames(bench.heard)
        assert said[0] == BOTH_0_RPM
        assert said[1:-1] == [READ_SPEEDS] * (len(said) - 2)
        assert len(said) > 3  # it looked more than once
        assert said[-1] == RELEASE
        assert speed_m_s(bench) == 0.0

    run(test)
