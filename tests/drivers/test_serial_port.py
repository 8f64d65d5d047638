"""The owner thread of a port, over real ptys."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from drivers.byte_trace import ByteTrace, TraceHead, read_trace
from drivers.emulation.wire import PtyWire
from drivers.errors import DeviceBusy, DeviceFault, DeviceLost, DeviceMissing, DeviceTimeout
from drivers.line import Line, PortSettings
from drivers.port_lock import lock_file
from drivers.serial_port import SerialPort

BAUD = 1_000_000


class Echo:
    """A device that answers every chunk with itself, and counts."""

    def __init__(self, link: Path) -> None:
        self.heard = b""
        self.wire = PtyWire(BAUD, self._receive, link)
        self.wire.plug()

    def _receive(self, data: bytes) -> None:
        self.heard += data
        self.wire.send(data)


def settings(path: Path | str) -> PortSettings:
    return PortSettings(str(path), "echo", BAUD, "raw")


def ask(line: Line, data: bytes = b"ping") -> bytes:
    line.write(data)
    return line.read(len(data), 0.5)


def nothing(line: Line) -> None:
    """A greeting that says nothing."""


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "echo"


def port_at(path: Path | str, **more: object) -> SerialPort:
    return SerialPort(settings(path), asyncio.get_running_loop().time, **more)  # type: ignore[arg-type]


async def until(condition: object, longest_s: float = 5.0) -> None:
    end_s = time.monotonic() + longest_s
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end_s, "waited in vain"
        await asyncio.sleep(0.005)


def test_a_job_writes_and_reads_in_the_owners_thread(link: Path) -> None:
    async def main() -> None:
        Echo(link)
        port = port_at(link)
        await port.attach("echo", nothing)
        names: list[str] = []

        def job(line: Line) -> bytes:
            names.append(threading.current_thread().name)
            return ask(line)

        assert await port.run(job) == b"ping"
        assert names == ["echo port"]
        await port.detach("echo")

    asyncio.run(main())


def test_stop_overtakes_what_waits(link: Path) -> None:
    async def main() -> None:
        Echo(link)
        port = port_at(link)
        await port.attach("echo", nothing)
        order: list[str] = []
        gate = threading.Event()
        first = asyncio.ensure_future(port.run(lambda line: gate.wait(2.0)))
        waiting = [asyncio.ensure_future(port.run(lambda line: order.append("queue"))) for _ in range(3)]
        await asyncio.sleep(0.02)
        stopping = asyncio.ensure_future(port.stop(lambda line: order.append("stop")))
        await asyncio.sleep(0.02)
        gate.set()
        await asyncio.gather(first, stopping, *waiting)
        assert order == ["stop", "queue", "queue", "queue"]
        await port.detach("echo")

    asyncio.run(main())


def test_a_cancelled_caller_does_not_undo_its_job(link: Path) -> None:
    async def main() -> None:
        echo = Echo(link)
        port = port_at(link)
        await port.attach("echo", nothing)
        gate = threading.Event()
        first = asyncio.ensure_future(port.run(lambda line: gate.wait(2.0)))
        second = asyncio.ensure_future(port.run(lambda line: line.write(b"sent")))
        await asyncio.sleep(0.02)
        second.cancel()
        gate.set()
        await first
        await until(lambda: echo.heard == b"sent")
        await port.detach("echo")

    asyncio.run(main())


def test_a_missing_port_says_which_and_what_to_do(tmp_path: Path) -> None:
    async def main() -> None:
        port = port_at(tmp_path / "nowhere")
        with pytest.raises(DeviceMissing, match=r"echo: expected a serial device at .*nowhere, found nothing there"):
            await port.attach("echo", nothing)
        with pytest.raises(DeviceLost, match="closed"):
            await port.run(ask)

    asyncio.run(main())


def test_a_second_process_is_told_who_holds_the_port(link: Path) -> None:
    other = (
        "import asyncio, sys\n"
        "from drivers.line import Line, PortSettings\n"
        "from drivers.errors import DeviceBusy\n"
        "try:\n"
        "    Line(PortSettings(sys.argv[1], 'echo', 9600, 'raw'), lambda *a: None)\n"
        "except DeviceBusy as error:\n"
        "    print(error)\n"
    )

    async def main() -> None:
        Echo(link)
        port = port_at(link)
        await port.attach("echo", nothing)
        assert lock_file(str(link)).read_text().strip() == str(os.getpid())
        done = await asyncio.to_thread(
            subprocess.run, [sys.executable, "-c", other, str(link)], capture_output=True, text=True, check=True
        )
        assert f"process {os.getpid()} (" in done.stdout
        assert "stop that process first" in done.stdout
        await port.detach("echo")
        assert not lock_file(str(link)).exists()

    asyncio.run(main())


def test_two_owners_in_one_process_are_refused_too(link: Path) -> None:
    async def main() -> None:
        Echo(link)
        first, second = port_at(link), port_at(link)
        await first.attach("echo", nothing)
        with pytest.raises(DeviceBusy):
            await second.attach("echo", nothing)
        await first.detach("echo")

    asyncio.run(main())


def test_an_unplugged_port_is_lost_and_comes_back_greeted(link: Path) -> None:
    async def main() -> None:
        echo = Echo(link)
        port = port_at(link)
        await port.attach("echo", lambda line: line.write(b"hello "))
        await until(lambda: echo.heard == b"hello ")
        echo.wire.unplug()
        with pytest.raises(DeviceLost):
            await port.run(ask)
        with pytest.raises(DeviceLost, match="plug it in again"):
            await port.run(ask)
        echo.wire.plug()
        await until(lambda: port.connected)
        assert await port.run(lambda line: (line.drain(0.05), ask(line))[1]) == b"ping"
        assert echo.heard == b"hello hello ping"
        assert port.statistics.losses == 1
        await port.detach("echo")

    asyncio.run(main())


def test_waiting_jobs_are_lost_with_the_device_and_not_sent_later(link: Path) -> None:
    async def main() -> None:
        echo = Echo(link)
        port = port_at(link)
        await port.attach("echo", nothing)
        gate = threading.Event()

        def blocked(line: Line) -> bytes:
            gate.wait(2.0)
            return line.read(1, 1.0)

        first = asyncio.ensure_future(port.run(blocked))
        second = asyncio.ensure_future(port.run(lambda line: line.write(b"move")))
        await asyncio.sleep(0.02)
        echo.wire.unplug()
        gate.set()
        for job in (first, second):
            with pytest.raises(DeviceLost):
                await job
        echo.wire.plug()
        await until(lambda: port.connected)
        await asyncio.sleep(0.05)
        assert echo.heard == b""
        await port.detach("echo")

    asyncio.run(main())


def test_two_users_share_a_port_and_the_last_closes_it(link: Path) -> None:
    async def main() -> None:
        Echo(link)
        port = port_at(link)
        await port.attach("one", nothing)
        await port.attach("two", nothing)
        await port.detach("one")
        assert await port.run(ask) == b"ping"
        await port.detach("two")
        with pytest.raises(DeviceLost):
            await port.run(ask)

    asyncio.run(main())


def test_a_timer_runs_in_its_time_between_the_jobs(link: Path) -> None:
    async def main() -> None:
        Echo(link)
        port = port_at(link)
        await port.attach("echo", nothing)
        ran: list[float] = []
        clock = asyncio.get_running_loop().time
        due_s = clock() + 0.05
        port.at(due_s, lambda line: ran.append(clock()))
        port.at(due_s, lambda line: ran.append(0.0)).cancelled = True
        while not ran:
            await port.run(ask)
        assert ran[0] >= due_s
        assert not port.busy or len(ran) == 1
        await port.detach("echo")

    asyncio.run(main())


def test_bytes_that_nobody_asked_for_go_to_the_listener(link: Path) -> None:
    async def main() -> None:
        echo = Echo(link)
        heard: list[bytes] = []
        port = port_at(link, on_bytes=heard.append)
        await port.attach("echo", nothing)
        echo.wire.send(b"$GPGGA")
        await until(lambda: b"".join(heard) == b"$GPGGA")
        await port.detach("echo")

    asyncio.run(main())


def test_a_host_that_is_not_read_ends_in_a_timeout(tmp_path: Path) -> None:
    master, slave = os.openpty()

    async def main() -> None:
        port = port_at(os.ttyname(slave))
        await port.attach("echo", nothing)
        with pytest.raises(DeviceTimeout, match="bytes to be taken"):
            await port.run(lambda line: line.write(bytes(100_000), timeout_s=0.1))
        await port.detach("echo")

    asyncio.run(main())
    os.close(master)
    os.close(slave)


def test_the_trace_holds_every_byte_both_ways(link: Path, tmp_path: Path) -> None:
    async def main() -> None:
        Echo(link)
        trace = ByteTrace(tmp_path / "trace.jsonl", TraceHead("echo", "raw", str(link), BAUD))
        port = port_at(link, trace=trace)
        await port.attach("echo", nothing)
        await port.run(ask)
        await port.detach("echo")
        trace.close()

    asyncio.run(main())
    head, chunks = read_trace(tmp_path / "trace.jsonl")
    assert head.device == "echo"
    told = list(chunks)
    assert told[0].direction == "out"
    assert b"".join(chunk.data for chunk in told if chunk.direction == "out") == b"ping"
    assert b"".join(chunk.data for chunk in told if chunk.direction == "in") == b"ping"
    assert told[0].stamp_s <= told[-1].stamp_s


def test_what_goes_wrong_by_the_clock_is_told_to_the_next_who_asks(link: Path) -> None:
    async def main() -> None:
        echo = Echo(link)
        port = port_at(link)
        await port.attach("echo", nothing)

        def broken(line: Line) -> None:
            raise KeyError("lease")

        port.at(asyncio.get_running_loop().time(), broken)
        await until(lambda: not port.busy)
        assert await port.stop(ask) == b"ping"  # a stop goes through all the same
        with pytest.raises(DeviceFault, match=r"KeyError: 'lease'"):
            await port.run(ask)
        assert await port.run(ask) == b"ping"
        assert echo.heard == b"pingping"
        await port.detach("echo")

    asyncio.run(main())


def test_a_disk_that_takes_no_trace_does_not_cost_the_device(link: Path, caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        Echo(link)
        trace = ByteTrace(Path("/dev/null"), TraceHead("echo", "raw", str(link), BAUD))
        full = os.open("/dev/full", os.O_WRONLY)
        assert trace._file is not None
        os.dup2(full, trace._file.fileno())
        os.close(full)
        port = port_at(link, trace=trace)
        await port.attach("echo", nothing)
        assert [await port.run(ask) for _ in range(3)] == [b"ping"] * 3
        assert port.statistics.losses == 0
        await port.detach("echo")
        trace.close()

    asyncio.run(main())
    assert "the byte trace ends here: No space left on device" in caplog.text
