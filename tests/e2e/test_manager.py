"""What a service manager hears from ``sprayer run``, and what it finds when the run has ended, however it did."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from .emulated import EMULATED
from .rover_process import DEADLINE_S, SPRAYER, short_row

WATCHDOG_S = 1.0
UNAVAILABLE = 69
ONE_CORE = {"OPENBLAS_NUM_THREADS": "1"}


class Manager:
    """Stands where systemd does: a notify socket and a runtime directory."""

    def __init__(self, folder: Path) -> None:
        self.runtime = folder / "run"
        self.runtime.mkdir()
        self._address = folder / "notify"
        self._link = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._link.bind(str(self._address))
        self._link.settimeout(DEADLINE_S)

    def environment(self) -> dict[str, str]:
        return {
            "NOTIFY_SOCKET": str(self._address), "WATCHDOG_USEC": str(round(1e6 * WATCHDOG_S)),
            "RUNTIME_DIRECTORY": str(self.runtime),
        }  # fmt: skip

    def hear(self, wanted: str) -> list[str]:
        """All words up to the wanted one."""
        heard = []
        while not heard or heard[-1] != wanted:
            heard.append(self._link.recv(4096).decode())
        return heard

    def silent_for(self, period_s: float) -> bool:
        """Whether nothing comes for so long, what came before apart."""
        self._link.setblocking(False)
        try:
            while True:
                self._link.recv(4096)
        except BlockingIOError:
            self._link.settimeout(period_s)
        try:
            self._link.recv(4096)
        except TimeoutError:
            return True
        finally:
            self._link.settimeout(DEADLINE_S)
        return False

    def close(self) -> None:
        self._link.close()


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[Manager]:
    manager = Manager(tmp_path)
    yield manager
    manager.close()


@contextmanager
def running(config: Path, out: Path, env: Mapping[str, str]) -> Iterator[subprocess.Popen[str]]:
    command = [*SPRAYER, "run", "--config", str(config), "--out", str(out)]
    process = subprocess.Popen(command, env=os.environ | ONE_CORE | dict(env), stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def test_the_manager_hears_ready_then_pets_then_stopping(manager: Manager, tmp_path: Path) -> None:
    with running(short_row(tmp_path), tmp_path / "out", manager.environment()) as process:
        assert "STATUS=disarmed" in manager.hear("READY=1")
        manager.hear("WATCHDOG=1")
        for place in (manager.runtime, tmp_path / "out"):  # for now, and for the time after a boot
            text = (place / "alloff.conf").read_text()
            assert f"socket {manager.runtime / 'control.sock'}\nsimulated relay\n" in text
        process.send_signal(signal.SIGTERM)
        manager.hear("STOPPING=1")
        assert process.wait(DEADLINE_S) == 0


def test_a_process_that_stands_still_pets_nobody(manager: Manager, tmp_path: Path) -> None:
    with running(short_row(tmp_path), tmp_path / "out", manager.environment()) as process:
        manager.hear("READY=1")
        manager.hear("WATCHDOG=1")
        process.send_signal(signal.SIGSTOP)
        assert manager.silent_for(WATCHDOG_S)
        process.send_signal(signal.SIGCONT)
        manager.hear("WATCHDOG=1")


def test_the_all_off_file_is_there_before_any_port_is_opened(manager: Manager, tmp_path: Path) -> None:
    ports = {f"SPRAYER_{device}__PORT": f"/dev/sprayer-no-{device.lower()}" for device in ("RELAY", "WHEELS")}
    with running(EMULATED, tmp_path / "out", manager.environment() | ports) as process:
        assert process.wait(DEADLINE_S) == UNAVAILABLE
    text = (manager.runtime / "alloff.conf").read_text()
    assert "port /dev/sprayer-no-relay\n" in text
    assert "port /dev/sprayer-no-wheels\n" in text
