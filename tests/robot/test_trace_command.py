"""``sprayer trace``: what went over a port, in words."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from drivers.arm import protocol2
from drivers.byte_trace import ByteTrace, Direction, TraceHead
from drivers.modbus_frames import with_crc
from robot.cli import run_command

FILE, USAGE = 74, 64
SPRAYER = (sys.executable, "-c", "from robot.cli import main; main()")
RMC = b"$GNRMC,171926.00,A,4404.14063,N,12118.85478,W,0.117,,180315,,,A*76\r\n"
PULSE = bytes.fromhex("01 05 02 00 00 07 8d b0")
REFUSED = with_crc(b"\x01\x83\x02")


def trace(path: Path, protocol: str, *chunks: tuple[float, Direction, bytes], port: str = "/dev/ttyUSB0") -> Path:
    kept = ByteTrace(path, TraceHead("device", protocol, port, 9600))
    for chunk in chunks:
        kept.keep(*chunk)
    kept.close()
    return path


@pytest.fixture
def bus(tmp_path: Path) -> Path:
    """A pulse whose echo comes in two pieces, a refused reading, a garbled answer, half a frame."""
    read = with_crc(b"\x01\x03\x00\x64\x00\x01")
    return trace(
        tmp_path / "bus", "modbus",
        (1.0, "out", PULSE), (1.015, "in", PULSE[:5]), (1.0175, "in", PULSE[5:]),
        (2.0, "out", read), (2.02, "in", REFUSED),
        (3.0, "out", read), (3.02, "in", b"\x01\x03\x02\x00\x00\x00\x00"),
        (4.0, "out", PULSE[:3]),
    )  # fmt: skip


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> list[str]:
    assert run_command(["trace", *map(str, arguments)]) == 0
    return capsys.readouterr().out.splitlines()


def test_each_frame_is_a_line_with_its_time_and_direction(bus: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert told(capsys, bus) == [
        "# device at /dev/ttyUSB0, modbus, 9600 baud",
        "     1.000000 > unit 1 write coil 0x0200 = 0x0007",
        "     1.017500 < unit 1 write coil 0x0200 = 0x0007",
        "     2.000000 > unit 1 read holding 0x0064 count 1",
        "     2.020000 < unit 1 read holding: exception 2 (illegal data address)",
        "     3.000000 > unit 1 read holding 0x0064 count 1",
        "     4.000000 > CRC error in an answer: 01 03 02 00 00 00 00",
        "                CRC error in a request: 01 05 02",
    ]


def test_errors_alone_can_be_asked_for(bus: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = told(capsys, bus, "--errors")[1:]
    assert [line[15:].strip().split()[0] for line in lines] == ["unit", "CRC", "CRC"]


def test_a_span_of_time_can_be_asked_for(bus: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = told(capsys, bus, "--from", 1.016, "--to", 2.01)[1:]
    assert [line.split()[0] for line in lines] == ["1.017500", "2.000000"]


def test_the_bytes_can_be_shown_as_they_came(bus: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = told(capsys, bus, "--raw", "--to", 1.5)[1:]
    assert lines == [
        "     1.000000 > 01 05 02 00 00 07 8d b0",
        "     1.015000 < 01 05 02 00 00",
        "     1.017500 < 07 8d b0",
    ]


def test_a_receivers_sentences_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = trace(tmp_path / "gps", "nmea", (0.5, "in", RMC[:20]), (0.6, "in", RMC[20:] + b"\xff\xff"))
    lines = told(capsys, path)
    assert lines[1].startswith("     0.600000 < GNRMC day_s=62366 date=2015-03-18 ")
    assert told(capsys, path, "--errors")[1:] == ["     0.600000 < 2 bytes that are no sentence: ff ff"]


def test_servos_and_what_they_refuse_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    read = protocol2.packet(3, protocol2.Instruction.READ, b"\x84\0\x04\0")
    path = trace(
        tmp_path / "arm", "dynamixel",
        (0.5, "out", read), (0.501, "in", protocol2.status(3, 0, b"\x00\x08\0\0")),
        (0.6, "out", read), (0.601, "in", protocol2.status(3, protocol2.StatusError.ACCESS)),
        (0.7, "out", read[:5]),
    )  # fmt: skip
    assert told(capsys, path)[1:3] == [
        "     0.500000 > servo 3 read present_position",
        "     0.501000 < servo 3 present_position=2048",
    ]
    assert told(capsys, path, "--errors")[1:] == [
        "     0.601000 < servo 3 ERROR no access",
        "                incomplete: ff ff fd 00 03",
    ]


def test_commands_to_a_modem_and_its_errors_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = trace(
        tmp_path / "modem", "at",
        (0.5, "out", b"AT+CSQ\r"), (0.51, "in", b"\r\n+CSQ: 18,99\r\n\r\nOK\r\n"),
        (0.6, "out", b"AT+COPS?\r"), (0.7, "in", b"\r\n+CME ERROR: 30\r\n"),
    )  # fmt: skip
    assert [line[13:] for line in told(capsys, path)[1:4]] == [" > AT+CSQ", " < +CSQ: 18,99", " < OK"]
    (error,) = told(capsys, path, "--errors")[1:]
    assert "no network service" in error


def test_modbus_over_tcp_is_told_by_its_address(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    request = bytes.fromhex("00 01 00 00 00 06 01 06 00 01 06 00")
    path = trace(tmp_path / "tcp", "modbus", (0.5, "out", request), port="tcp://10.0.0.5:502")
    assert told(capsys, path)[1] == "     0.500000 > #1 unit 1 write register 0x0001 = 0x0600"


# --- what is no trace


def refused(capsys: pytest.CaptureFixture[str], code: int, *arguments: object) -> str:
    assert run_command(["trace", *map(str, arguments)]) == code
    error = capsys.readouterr().err
    assert error.startswith("sprayer: ")
    assert error.count("\n") == 1
    return error


def test_another_kind_of_file_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "photo").write_bytes(b"\x89PNG\r\n\x1a\n\0\0")
    assert "photo: expected a byte trace" in refused(capsys, FILE, tmp_path / "photo")
    (tmp_path / "empty").write_bytes(b"")
    assert "empty: expected a byte trace" in refused(capsys, FILE, tmp_path / "empty")
    assert "gone: No such file" in refused(capsys, FILE, tmp_path / "gone")
    assert "Is a directory" in refused(capsys, FILE, tmp_path)


def test_a_trace_that_grew_too_long_says_that_it_ends_before_its_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "gps.trace.jsonl"
    kept = ByteTrace(file, TraceHead("gps", "nmea", "/dev/ttyGPS", 9600), longest_bytes=400)
    for second in range(20):
        kept.keep(float(second), "in", b"$GPGGA,,,,,,0,,,,,,,,*66\r\n")
    kept.close()
    assert run_command(["trace", str(file)]) == 74
    shown = capsys.readouterr()
    assert 1 < len(shown.out.splitlines()) < 20
    assert "ends before its run" in shown.err


def test_a_torn_trace_is_shown_up_to_the_tear_and_named(bus: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bus.write_bytes(bus.read_bytes()[:-4])
    assert run_command(["trace", str(bus)]) == FILE
    shown = capsys.readouterr()
    assert "     4.000000 >" not in shown.out
    assert "     3.000000 > unit 1 read holding" in shown.out
    assert "its last line is torn" in shown.err


def test_a_trace_that_was_changed_is_named_with_the_line(bus: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bus.write_text(bus.read_text().replace('"dir":"in"', '"dir":"up"', 1))
    assert "line 3 is not of a byte trace" in refused(capsys, FILE, bus)


def test_an_unknown_protocol_is_named_and_can_be_seen_raw(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = trace(tmp_path / "odd", "morse", (0.5, "in", b"sos"))
    error = refused(capsys, FILE, path)
    assert "found 'morse'" in error
    assert "--raw" in error
    assert told(capsys, path, "--raw")[1] == "     0.500000 < 73 6f 73"


@pytest.mark.parametrize("wrong", [("--raw", "--errors"), ("--from", "nan"), ("--from", "noon"), ("--sideways",)])
def test_a_wrong_question_is_refused(bus: Path, capsys: pytest.CaptureFixture[str], wrong: tuple[str, ...]) -> None:
    refused(capsys, USAGE, bus, *wrong)


def test_a_reader_that_has_seen_enough_ends_it_without_a_word(tmp_path: Path) -> None:
    path = trace(tmp_path / "long", "nmea", *((0.1 * k, "in", RMC) for k in range(20_000)))
    process = subprocess.Popen([*SPRAYER, "trace", str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stderr is not None
    assert process.stdout.readline().startswith(b"# device")
    process.stdout.close()
    assert process.wait(60) == 0
    assert process.stderr.read() == b""
    process.stderr.close()
