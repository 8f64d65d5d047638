"""``sprayer-alloff``: a board of any kind with anything on ends off in truth, or the exit code says that it may not."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import pytest

from drivers.relay.profiles import PROFILES
from robot.cli import run_command

from .alloff import EMULATED, SCRIPT, Machine, Service, call, machine, until
from .emulated import held

OFF, USAGE, UNAVAILABLE, IO, HELD, CONFIG = 0, 64, 69, 74, 75, 78
BEGINS_S = 0.3  # when a fault does: before, everything could be switched on
STOPPED = {"parts": [{"part": "valve", "error": ""}, {"part": "base", "error": ""}]}


def go(main: Coroutine[Any, Any, None]) -> None:
    asyncio.run(main)


# --- boards


@pytest.mark.parametrize("profile", PROFILES)
def test_every_board_with_everything_on_is_off_afterwards(profile: str, tmp_path: Path) -> None:
    async def main() -> None:
        async with machine(profile) as m:
            m.switch_all_on()
            called = await call("--file", str(m.write_file(tmp_path / "alloff.conf")), "--verify")
            assert (called.code, m.on) == (OFF, []), called.said
            assert "relay: off, read back" in called.said
            await until(lambda: not m.valve_open)

    go(main())


@pytest.mark.parametrize("scheme", ["tcp", "rtu+tcp"])
def test_a_board_behind_tcp_is_off_afterwards(scheme: str, tmp_path: Path) -> None:
    async def main() -> None:
        async with machine("waveshare-poe-8", scheme=scheme) as m:
            m.switch_all_on()
            called = await call("--file", str(m.write_file(tmp_path / "alloff.conf")))
            assert (called.code, m.on) == (OFF, []), called.said

    go(main())


@pytest.mark.parametrize("baud", [9600, 250_000])  # a rate with a name, and one without
def test_other_rates_do_as_well(baud: int, tmp_path: Path) -> None:
    async def main() -> None:
        async with machine("lc-8", baud=baud) as m:
            m.switch_all_on()
            called = await call("--file", str(m.write_file(tmp_path / "alloff.conf")))
            assert (called.code, m.on) == (OFF, []), called.said

    go(main())


def test_a_rolling_base_on_the_boards_own_bus_is_halted_too(tmp_path: Path) -> None:
    async def main() -> None:
        async with machine(wheels=True) as m:
            m.switch_all_on()
            m.roll()
            await until(lambda: m.speed_m_s > 0.1)
            called = await call("--file", str(m.write_file(tmp_path / "alloff.conf")))
            assert (called.code, m.on) == (OFF, []), called.said
            assert "wheels: off, read back (ZLAC8015D" in called.said
            await until(lambda: m.speed_m_s == 0.0)

    go(main())


def test_a_line_with_noise_on_it_is_said_three_times(tmp_path: Path) -> None:
    async def main() -> None:
        async with machine("waveshare-8", "relay:intermittent@0s") as m:
            m.switch_all_on()
            called = await call("--file", str(m.write_file(tmp_path / "alloff.conf")))
            assert m.on == [], called.said

    go(main())


def test_without_read_back_the_acknowledgement_counts(tmp_path: Path) -> None:
    async def main() -> None:
        async with machine() as m:
            m.switch_all_on()
            called = await call("--no-verify", "--file", str(m.write_file(tmp_path / "alloff.conf")))
            assert (called.code, m.on) == (OFF, []), called.said
            assert "acknowledged" in called.said

    go(main())


def test_a_dry_run_says_what_it_would_send_and_switches_nothing(tmp_path: Path) -> None:
    async def main() -> None:
        async with machine() as m:
            m.switch_all_on()
            before = m.on
            called = await call("--dry-run", "--file", str(m.write_file(tmp_path / "alloff.conf")))
            assert (called.code, m.on) == (OFF, before)
            assert "would send 07 0f 00 00 00 08 01 00" in called.said

    go(main())


# --- what can be wrong


@pytest.mark.parametrize(
    ("fault", "code", "words"),
    [
        ("relay:off@0.3s", UNAVAILABLE, "silence at"),
        ("relay:stuck@0.3s", IO, "NOT OFF at"),
        ("relay:garbage@0.3s", IO, ""),
    ],
)
def test_a_board_that_is_not_known_to_be_off_is_an_error(fault: str, code: int, words: str, tmp_path: Path) -> None:
    async def main() -> None:
        async with machine("waveshare-8", fault) as m:
            m.switch_all_on()
            file = m.write_file(tmp_path / "alloff.conf")
            await until(lambda: m.clock() > BEGINS_S)
            called = await call("--file", str(file))
            assert called.code == code, called.said
            assert words in called.said

    go(main())


def test_a_port_that_is_not_there_is_named(tmp_path: Path) -> None:
    async def main() -> None:
        async with machine() as m:
            file = m.write_file(tmp_path / "alloff.conf")
            file.write_text(file.read_text().replace(m.wire.path, "/dev/sprayer-nowhere"))
            called = await call("--file", str(file))
            assert called.code == UNAVAILABLE
            assert "nothing at /dev/sprayer-nowhere" in called.said

    go(main())


def test_a_dead_device_keeps_nothing_from_being_done_to_the_next(tmp_path: Path) -> None:
    async def main() -> None:
        async with machine(wheels=True) as m:
            m.switch_all_on()
            file = m.write_file(tmp_path / "alloff.conf")
            file.write_text(file.read_text().replace(f"port {m.wire.path}", "port /dev/sprayer-nowhere", 1))
            called = await call("--file", str(file))
            assert called.code == UNAVAILABLE
            assert "wheels: off, read back" in called.said

    go(main())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "cannot be read"),
        ("", "expected 'sprayer-alloff 1'"),
        ("sprayer-alloff 2\nend\n", "expected 'sprayer-alloff 1'"),
        ("sprayer-alloff 1\nsimulated relay\n", "not whole"),
        ("sprayer-alloff 1\nend\n", "not whole"),
        ("sprayer-alloff 1\nport /dev/x\nend\n", "line 2 is wrong"),
        ("sprayer-alloff 1\ndevice relay x\noff 0xyz 00\nend\n", "line 3 is wrong"),
        ("sprayer-alloff 1\ndevice relay x\nport /dev/x\nline 9600 N 1\noff 00 00\nend\n", "lacks port, line, off"),
        ("sprayer-alloff 1\ndevice relay x\nvolume 11\nend\n", "unknown word"),
    ],
)
def test_a_file_that_is_wrong_is_refused_with_the_line(text: str | None, words: str, tmp_path: Path) -> None:
    file = tmp_path / "alloff.conf"
    if text is not None:
        file.write_text(text)

    async def main() -> None:
        called = await call("--file", str(file))
        assert called.code == CONFIG
        assert words in called.said
        assert "sprayer alloff-file" in called.said or "make it anew" in called.said

    go(main())


def test_before_the_first_start_a_missing_file_is_no_error_when_that_is_said(tmp_path: Path) -> None:
    async def main() -> None:
        called = await call("--if-present", env={"RUNTIME_DIRECTORY": str(tmp_path)})
        assert called.code == OFF
        assert f"no {tmp_path}/alloff.conf yet" in called.said

    go(main())


def test_the_first_file_that_is_there_counts(tmp_path: Path) -> None:
    async def main() -> None:
        (tmp_path / "second.conf").write_text("sprayer-alloff 1\nsimulated relay\nend\n")
        called = await call("--file", str(tmp_path / "first.conf"), "--file", str(tmp_path / "second.conf"))
        assert (called.code, called.said) == (OFF, "sprayer-alloff: relay: simulated, nothing to switch\n")

    go(main())


@pytest.mark.parametrize("words", [("--fiel", "x"), ("--file",), ("on",), ("--verify=no",)])
def test_what_it_does_not_understand_it_says(words: tuple[str, ...]) -> None:
    async def main() -> None:
        assert (await call(*words)).code == USAGE

    go(main())


def test_the_journal_gets_priorities(tmp_path: Path) -> None:
    (tmp_path / "log").touch()
    with (tmp_path / "log").open("r+b") as log:
        status = os.fstat(log.fileno())

        async def main() -> None:
            process = await asyncio.create_subprocess_exec(
                str(SCRIPT), "--file", "/nowhere", "--reason", "watchdog", stderr=log,
                env={"JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino}"},
            )  # fmt: skip
            assert await process.wait() == CONFIG

        go(main())
    lines = (tmp_path / "log").read_text().splitlines()
    assert lines[0] == "<6>called because of: watchdog"
    assert lines[1].startswith("<3>/nowhere: cannot be read")


# --- a port that another process holds


def with_service(tmp_path: Path, service: Service | None, test: Any, scheme: str = "") -> None:
    """``test(machine, file, holder)`` while another process holds the machine's port, and ``service`` answers."""

    async def main() -> None:
        async with machine(scheme=scheme) as m:
            m.switch_all_on()
            file = m.write_file(tmp_path / "alloff.conf", tmp_path / "control.sock")
            with held(m.wire.path) as holder:
                if service is None:
                    await test(m, file, holder)
                else:
                    async with service.serving():
                        await test(m, file, holder)

    go(main())


def test_a_living_service_is_told_to_stop_and_its_word_counts(tmp_path: Path) -> None:
    service = Service(tmp_path / "control.sock", body=STOPPED)

    async def test(m: Machine, file: Path, holder: int) -> None:
        before = m.on
        called = await call("--file", str(file), "--reason", 'he said "stop"')
        assert called.code == OFF, called.said
        assert f"stopped by the service (process {holder})" in called.said
        assert service.heard == [("POST /v1/stop HTTP/1.1", {"cause": 'sprayer-alloff: he said "stop"'})]
        assert m.on == before  # the port is the service's: nothing was written past it

    with_service(tmp_path, service, test)


@pytest.mark.parametrize(
    ("status", "body", "silent", "code", "words"),
    [
        (200, {"parts": [{"part": "valve", "error": "silence"}]}, False, IO, "valve: silence"),
        (200, {"parts": []}, False, IO, "names no parts"),
        (200, ["?"], False, IO, "names no parts"),
        (503, {}, False, HELD, "answered the stop with 503"),
        (200, {}, True, HELD, "no answer within 2 s"),
    ],
)
def test_a_service_that_did_not_stop_is_an_error(
    status: int, body: object, silent: bool, code: int, words: str, tmp_path: Path
) -> None:
    service = Service(tmp_path / "control.sock", status, body, silent)

    async def test(_m: Machine, file: Path, holder: int) -> None:
        called = await call("--file", str(file))
        assert called.code == code, called.said
        assert words in called.said
        assert f"process {holder} holds" in called.said

    with_service(tmp_path, service, test)


def test_a_holder_without_a_control_socket_is_named(tmp_path: Path) -> None:
    async def test(_m: Machine, file: Path, holder: int) -> None:
        called = await call("--file", str(file))
        assert called.code == HELD
        assert f"process {holder} holds" in called.said
        assert "no control socket" in called.said

    with_service(tmp_path, None, test)


def test_a_port_that_is_let_go_in_time_is_waited_for(tmp_path: Path) -> None:
    async def main() -> None:
        async with machine() as m:
            m.switch_all_on()
            file = m.write_file(tmp_path / "alloff.conf")
            with held(m.wire.path):
                calling = asyncio.create_task(call("--file", str(file)))
                await asyncio.sleep(0.3)
            called = await calling
            assert (called.code, m.on) == (OFF, []), called.said

    go(main())


def test_a_service_behind_tcp_is_asked_first(tmp_path: Path) -> None:
    async def main() -> None:
        async with machine(scheme="tcp") as m:
            m.switch_all_on()
            file = m.write_file(tmp_path / "alloff.conf", tmp_path / "control.sock")
            async with Service(tmp_path / "control.sock", body=STOPPED).serving():
                called = await call("--file", str(file))
            assert (called.code, len(m.on)) == (OFF, 8), called.said
            assert "stopped by the service" in called.said

    go(main())


def test_a_service_behind_tcp_that_cannot_stop_is_passed_by(tmp_path: Path) -> None:
    async def main() -> None:
        async with machine(scheme="tcp") as m:
            m.switch_all_on()
            file = m.write_file(tmp_path / "alloff.conf", tmp_path / "control.sock")
            async with Service(tmp_path / "control.sock", status=500, body={}).serving():
                called = await call("--file", str(file))
            assert (called.code, m.on) == (OFF, []), called.said

    go(main())


# --- the file by hand


def test_the_file_of_a_configuration_is_made_by_hand(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "alloff.conf"
    assert run_command(["alloff-file", "--config", str(EMULATED), "--out", str(out)]) == 0
    assert out.read_text().splitlines()[0] == "sprayer-alloff 1"
    assert str(out) in capsys.readouterr().out


def test_a_simulated_machine_has_no_port_to_switch(tmp_path: Path) -> None:
    out = tmp_path / "alloff.conf"
    assert run_command(["alloff-file", "--config", "demo.toml", "--out", str(out)]) == 0

    async def main() -> None:
        called = await call("--file", str(out))
        assert called.code == OFF
        assert "relay: simulated" in called.said

    go(main())


def test_a_path_that_would_break_the_file_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SPRAYER_RELAY__PORT", "/dev/x\nport /dev/y")
    assert run_command(["alloff-file", "--config", str(EMULATED), "--out", str(tmp_path / "a.conf")]) == CONFIG
    assert "does not go into the all-off file" in capsys.readouterr().err
    assert not (tmp_path / "a.conf").exists()
