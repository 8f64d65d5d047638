"""The service manager hears what is said to it, and the watchdog is petted only while all is well."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robot.runtime.notify import Notifier, pet_watchdog

SOON_S = 2.0


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[socket.socket, str]]:
    """A manager's socket, and its address as the environment has it."""
    abstract = f"@sprayer-test-{os.getpid()}-{time.monotonic_ns()}"
    address = str(tmp_path / "notify") if request.param == "path" else abstract
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as link:
        link.bind(address.replace("@", "\0"))
        link.settimeout(SOON_S)
        yield link, address


def test_the_manager_hears_every_word(manager: tuple[socket.socket, str]) -> None:
    link, address = manager
    notifier = Notifier.from_environment({"NOTIFY_SOCKET": address})
    notifier.ready()
    notifier.status("auto:\nrow A")
    notifier.watchdog()
    notifier.stopping()
    heard = [link.recv(4096) for _ in range(4)]
    assert heard == [b"READY=1", b"STATUS=auto: row A", b"WATCHDOG=1", b"STOPPING=1"]


@pytest.mark.parametrize(
    ("environment", "period_s"),
    [
        ({}, None),
        ({"WATCHDOG_USEC": "5000000"}, 5.0),
        ({"WATCHDOG_USEC": "5000000", "WATCHDOG_PID": "42"}, 5.0),
        ({"WATCHDOG_USEC": "5000000", "WATCHDOG_PID": "41"}, None),  # of the process that started this one
        ({"WATCHDOG_USEC": "0"}, None),
        ({"WATCHDOG_USEC": "often"}, None),
    ],
)
def test_a_watchdog_that_waits_for_this_process_is_known(environment: dict[str, str], period_s: float | None) -> None:
    assert Notifier.from_environment(environment, process=42).watchdog_period_s == period_s


def test_without_a_manager_nothing_is_said_and_nothing_fails() -> None:
    notifier = Notifier.from_environment({})
    notifier.ready()
    asyncio.run(pet_watchdog(notifier, lambda: ""))  # and nobody is kept waiting


def test_a_manager_that_is_gone_is_told_of_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    notifier = Notifier.from_environment({"NOTIFY_SOCKET": str(tmp_path / "gone")})
    with caplog.at_level(logging.WARNING):
        notifier.ready()
        notifier.stopping()
    assert [record.getMessage().split(":")[0] for record in caplog.records] == [
        "the service manager was not told 'READY=1'"
    ]


def test_a_manager_that_does_not_read_does_not_hold_the_loop_up(manager: tuple[socket.socket, str]) -> None:
    _, address = manager
    notifier = Notifier.from_environment({"NOTIFY_SOCKET": address})
    began_s = time.monotonic()
    for _ in range(2000):
        notifier.watchdog()
    assert time.monotonic() - began_s < SOON_S


def test_the_watchdog_is_petted_in_time_and_no_more_once_a_reason_is_given(manager: tuple[socket.socket, str]) -> None:
    link, address = manager
    reasons = [""]

    async def main() -> list[bytes]:
        notifier = Notifier(address, watchdog_period_s=0.1)
        petting = asyncio.create_task(pet_watchdog(notifier, lambda: reasons[0]))
        loop = asyncio.get_running_loop()
        link.setblocking(False)
        heard = [await loop.sock_recv(link, 100) for _ in range(5)]
        reasons[0] = "camera: dead"
        while (word := await loop.sock_recv(link, 100)) == b"WATCHDOG=1":
            heard.append(word)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(loop.sock_recv(link, 100), 0.2)
        petting.cancel()
        return [*heard, word]

    heard = asyncio.run(main())
    assert heard[:-1] == [b"WATCHDOG=1"] * len(heard[:-1])
    assert heard[-1] == b"STATUS=not healthy: camera: dead"


def test_a_loop_that_stands_still_pets_nothing(manager: tuple[socket.socket, str]) -> None:
    link, address = manager

    async def main() -> None:
        petting = asyncio.create_task(pet_watchdog(Notifier(address, watchdog_period_s=0.1), lambda: ""))
        await asyncio.sleep(0.01)
        assert link.recv(100) == b"WATCHDOG=1"
        link.settimeout(0.3)
        with pytest.raises(TimeoutError):
            link.recv(100)  # this blocks the loop
        petting.cancel()

    asyncio.run(main())
