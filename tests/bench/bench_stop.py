"""From a STOP at the control API to the last OFF frame on the relay board's wire, idle and under load.

``python -m tests.bench.bench_stop``: a service over the emulated rover, which runs in a process of its own and whose
truth tells when each frame had arrived at the board. The load: the camera streams, another client asks for the status
50 times a second, and the receiver's port carries 1 MB of garbage a second beside its sentences.
"""

from __future__ import annotations

import http.client
import json
import os
import random
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from drivers.twin.commands import RelaySwitch
from drivers.twin.truth_record import read_truth
from tests.bench.lines import Say, say
from tests.e2e.emulated import EMULATED, emulator, variables
from tests.e2e.rover_process import SPRAYER

STOPS = 200
UP_S = DOWN_S = 40.0
STATUS_HZ = 50.0
GARBAGE_BYTES_S = 1_000_000
GARBAGE_STEP_S = 0.01
GOALS_MS = {"idle": 50, "load": 100}
OFFS_A_STOP = 2  # valve and pump


class _Connection(http.client.HTTPConnection):
    def __init__(self, path: Path) -> None:
        super().__init__("localhost", timeout=DOWN_S)
        self._path = path

    def connect(self) -> None:
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(DOWN_S)
        self.sock.connect(str(self._path))


def ask(path: Path, method: str, place: str, body: str | None = None) -> bytes:
    """One request over the control socket; its answer's body, which is one of success."""
    connection = _Connection(path)
    try:
        connection.request(method, place, body, {"Content-Type": "application/json"} if body else {})
        response = connection.getresponse()
        content = response.read()
    finally:
        connection.close()
    assert response.status == 200, (response.status, content)
    return content


@contextmanager
def service(folder: Path, ports: dict[str, str]) -> Iterator[Path]:
    """A robot that waits disarmed; gives its control socket."""
    environment = os.environ | variables(ports) | {"SPRAYER_ROBOT__RUN_DIRECTORY": str(folder)}
    command = [*SPRAYER, "run", "--config", str(EMULATED), "--out", str(folder)]
    with (folder / "said").open("w+") as said, subprocess.Popen(command, stderr=said, env=environment) as process:
        control = folder / "control.sock"
        try:
            end_s = time.monotonic() + UP_S
            while not _answers(control):
                assert process.poll() is None, (folder / "said").read_text()
                assert time.monotonic() < end_s, "the control API does not answer"
                time.sleep(0.1)
            yield control
        finally:
            process.terminate()
            process.wait(DOWN_S)


def _answers(control: Path) -> bool:
    try:
        ask(control, "GET", "/v1/status")
    except OSError:
        return False
    return True


@contextmanager
def beside(step: threading.Event, work: threading.Thread) -> Iterator[None]:
    """A thread that works until the block is over."""
    work.start()
    try:
        yield
    finally:
        step.set()
        work.join(DOWN_S)


class StatusClients:
    """Ask for the status again and again, from two threads, so that one slow answer delays no more than itself."""

    def __init__(self, control: Path) -> None:
        self.answers = 0
        self._control, self._end = control, threading.Event()

    @contextmanager
    def asking(self) -> Iterator[None]:
        with ExitStack() as stack:
            for _ in range(2):
                stack.enter_context(beside(self._end, threading.Thread(target=self._work, daemon=True)))
            yield

    def _work(self) -> None:
        due_s = time.monotonic()
        while not self._end.wait(max(0.0, due_s - time.monotonic())):
            with suppress(ConnectionError):  # too many at once: the oldest is let go
                ask(self._control, "GET", "/v1/status")
                self.answers += 1
            due_s = max(due_s + 2.0 / STATUS_HZ, time.monotonic() - 1.0)


class NoisyPort:
    """A terminal that passes a receiver's bytes on, with 1 MB/s of garbage between them once ``noisy`` is set."""

    def __init__(self, receiver: str) -> None:
        self.noisy = threading.Event()
        self.end = threading.Event()
        self._receiver = os.open(receiver, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self.garbage_bytes = 0
        self.lost_bytes = 0

    def work(self) -> None:
        dice = random.Random(1)
        while not self.end.wait(GARBAGE_STEP_S):
            data = b""
            with suppress(BlockingIOError):
                data = os.read(self._receiver, 4096)
            if self.noisy.is_set():
                noise = _garbage(dice, round(GARBAGE_BYTES_S * GARBAGE_STEP_S))
                self.garbage_bytes += len(noise)
                data += noise
            for start in range(0, len(data), 1024):
                self._pass_on(data[start : start + 1024])

    def _pass_on(self, data: bytes) -> None:
        try:
            written = os.write(self._master, data)
        except BlockingIOError:  # the host reads no faster: lost, as on a wire
            written = 0
        self.lost_bytes += len(data) - written


def _garbage(dice: random.Random, size: int) -> bytes:
    """Half random bytes, half sentences with a wrong checksum."""
    sentence = b"$GNGGA,120000.00,5200.0000,N,00500.0000,E,4,12,0.5,10.0,M,0.0,M,,*00\r\n"
    return dice.randbytes(size // 2) + sentence * (size // 2 // len(sentence))


def measured(load: bool, stops: int = STOPS) -> tuple[list[float], str]:
    """Seconds from each STOP to its last OFF frame, and how heavy the load was."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="stop-")))
        truth, zero_s = folder / "truth.jsonl", time.monotonic()
        rover = stack.enter_context(emulator("--truth", str(truth), "--zero", repr(zero_s)))
        receiver = NoisyPort(rover.ports["gps"])
        stack.enter_context(beside(receiver.end, threading.Thread(target=receiver.work, daemon=True)))
        control = stack.enter_context(service(folder, rover.ports | {"gps": receiver.path}))
        clients = StatusClients(control)
        if load:
            receiver.noisy.set()
            stack.enter_context(clients.asking())
        began_s, dice = time.monotonic(), random.Random(2)
        asked_s = []
        for _ in range(stops):
            time.sleep(dice.uniform(0.05, 0.25))  # any moment of the polls
            asked_s.append(time.monotonic() - zero_s)
            parts = json.loads(ask(control, "POST", "/v1/stop", '{"cause": "bench"}'))["parts"]
            assert all(not part["error"] for part in parts), parts
        for_s = time.monotonic() - began_s
        rate_mb_s, asked_hz = receiver.garbage_bytes / for_s / 1e6, clients.answers / for_s
        unread = receiver.lost_bytes / max(1, receiver.garbage_bytes)
        time.sleep(0.2)  # the emulator writes its last lines
        took = took_s(truth, asked_s)
    told = f"   garbage {rate_mb_s:.2f} MB/s ({unread:.0%} unread), {asked_hz:.0f} status/s"
    return took, told if load else ""


def took_s(truth: Path, asked_s: list[float]) -> list[float]:
    off_s = [
        timed.command.at_s
        for timed in read_truth(truth).processes[-1].commands
        if isinstance(timed.command, RelaySwitch) and not timed.command.on
    ]
    took = []
    for asked, following in zip(asked_s, [*asked_s[1:], float("inf")], strict=True):
        offs = [at_s for at_s in off_s if asked <= at_s < following][:OFFS_A_STOP]
        assert len(offs) == OFFS_A_STOP, f"a stop at {asked:.3f} s with the OFF frames {offs}"
        took.append(offs[-1] - asked)
    return took


def bench(line: Say) -> None:
    """One line a figure, through ``line(name, figures, goal)``."""
    for name, load in (("idle", False), ("load", True)):
        stops_s, load_text = measured(load)
        p50_ms, p99_ms = (1e3 * statistics.quantiles(stops_s, n=100, method="inclusive")[k] for k in (49, 98))
        figures = f"p50 {p50_ms:.1f} ms   p99 {p99_ms:.1f} ms   worst {1e3 * max(stops_s):.1f} ms   n {len(stops_s)}"
        line(f"STOP from API to last OFF frame, {name}", figures + load_text, f"p99 <= {GOALS_MS[name]} ms")


if __name__ == "__main__":
    bench(say)
    sys.exit()
