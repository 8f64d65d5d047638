"""Who holds a port is known by name, and a dead holder holds nothing."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers import port_lock
from drivers.errors import DeviceBusy


@pytest.fixture
def terminal() -> Iterator[str]:
    master, slave = pty.openpty()
    path = os.ttyname(slave)
    yield path
    os.close(master)
    os.close(slave)
    port_lock.lock_file(path).unlink(missing_ok=True)


def opened(path: str) -> int:
    return os.open(path, os.O_RDWR | os.O_NOCTTY)


def test_a_stable_name_and_the_device_behind_it_share_one_lock_file(terminal: str, tmp_path: Path) -> None:
    link = tmp_path / "usb-relay"
    link.symlink_to(terminal)
    assert port_lock.lock_file(str(link)) == port_lock.lock_file(terminal)
    assert port_lock.lock_file(terminal).name == f"LCK..{terminal.removeprefix('/dev/').replace('/', '-')}"


def test_the_holder_stands_in_the_file_in_ten_columns_until_it_lets_go(terminal: str) -> None:
    descriptor = opened(terminal)
    port_lock.take(descriptor, "relay", terminal)
    assert port_lock.lock_file(terminal).read_text() == f"{os.getpid():10d}\n"
    assert port_lock.holder(terminal) == os.getpid()
    os.close(descriptor)
    port_lock.release(terminal)
    assert port_lock.holder(terminal) is None


def test_a_second_opening_is_told_who_holds_the_port(terminal: str) -> None:
    first, second = opened(terminal), opened(terminal)  # TIOCEXCL, which comes with the lock, would bar the second
    port_lock.take(first, "relay", terminal)
    with pytest.raises(DeviceBusy, match=rf"relay: .*found process {os.getpid()} \(.*\) holding it; stop that process"):
        port_lock.take(second, "relay", terminal)
    os.close(first)
    os.close(second)
    port_lock.release(terminal)


def test_a_killed_holder_leaves_a_file_that_names_nobody_and_the_port_is_free(terminal: str) -> None:
    code = (
        "import os, signal, sys; from drivers import port_lock;"
        "port_lock.take(os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY), 'relay', sys.argv[1]);"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    subprocess.run([sys.executable, "-c", code, terminal], check=False, timeout=30)
    assert port_lock.lock_file(terminal).exists()
    assert port_lock.holder(terminal) is None
    descriptor = opened(terminal)
    port_lock.take(descriptor, "relay", terminal)
    assert port_lock.holder(terminal) == os.getpid()
    os.close(descriptor)
    port_lock.release(terminal)


def test_another_processs_lock_file_is_not_taken_away(terminal: str) -> None:
    port_lock.lock_file(terminal).write_text(f"{1:10d}\n")
    port_lock.release(terminal)
    assert port_lock.holder(terminal) == 1


@pytest.mark.parametrize("content", ["", "nobody\n", "   \n", "99999999999\n"])
def test_a_lock_file_that_says_nothing_names_nobody(terminal: str, content: str) -> None:
    port_lock.lock_file(terminal).write_text(content)
    assert port_lock.holder(terminal) is None
