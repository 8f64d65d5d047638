"""What the service manager is told: the protocol of sd_notify, and the watchdog that is petted while all is well."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress

PETS_A_PERIOD = 5
LONGEST_STATUS = 200

_log = logging.getLogger(__name__)


class Notifier:
    """Datagrams to the socket that ``NOTIFY_SOCKET`` names (a path, or "@name" for an abstract one): sd_notify(3).

    Without a socket every call does nothing. A message that cannot be sent is logged, once until one can again: the
    robot does not stop because its manager does not listen.
    """

    def __init__(self, address: str = "", watchdog_period_s: float | None = None) -> None:
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._watchdog_period_s = watchdog_period_s
        self._failing = False

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] = os.environ, process: int | None = None) -> Notifier:
        """As systemd set the environment of this process; ``process`` stands in for its number."""
        address = environment.get("NOTIFY_SOCKET", "")
        if not address.startswith(("/", "@")):
            address = ""  # vsock addresses are for virtual machines
        return cls(address, _watchdog_period_s(environment, os.getpid() if process is None else process))

    @property
    def watchdog_period_s(self) -> float | None:
        """Within which ``watchdog`` must be called again; None when nobody waits for it."""
        return self._watchdog_period_s

    def ready(self) -> None:
        """Start-up is over."""
        self._send("READY=1")

    def watchdog(self) -> None:
        """All is well."""
        self._send("WATCHDOG=1")

    def stopping(self) -> None:
        """Shutdown begins."""
        self._send("STOPPING=1")

    def status(self, text: str) -> None:
        """A line for ``systemctl status``."""
        self._send("STATUS=" + " ".join(text.split())[:LONGEST_STATUS])

    def _send(self, message: str) -> None:
        if not self._address:
            return
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as link:
                link.setblocking(False)  # a manager whose queue is full does not hold up the event loop
                link.sendto(message.encode("utf-8"), self._address)
        except OSError as error:
            if not self._failing:
                _log.warning("the service manager was not told %r: %s", message, error)
            self._failing = True
            return
        self._failing = False


def _watchdog_period_s(environment: Mapping[str, str], process: int) -> float | None:
    """None unless a watchdog waits for this very process."""
    if environment.get("WATCHDOG_PID", str(process)) != str(process):
        return None
    with suppress(ValueError):
        period_us = int(environment.get("WATCHDOG_USEC", ""))
        return 1e-6 * period_us if period_us > 0 else None
    return None


@asynccontextmanager
async def managed(notifier: Notifier, healthy: Callable[[], str], status: str) -> AsyncIterator[None]:
    """Ready when the block begins, the watchdog petted while it lasts, stopping when it ends. ``status``: at first."""
    async with asyncio.TaskGroup() as group:
        petting = group.create_task(pet_watchdog(notifier, healthy), name="watchdog")
        notifier.status(status)
        notifier.ready()
        try:
            yield
        finally:
            notifier.stopping()
            petting.cancel()


async def pet_watchdog(notifier: Notifier, healthy: Callable[[], str]) -> None:
    """Tell the manager's watchdog that all is well, several times within its period, while ``healthy`` says so.

    ``healthy`` gives a reason, or "". It runs on the event loop, so that a loop that stands still tells nothing: then,
    as with a reason that stays, the manager ends the process. Returns at once when nobody waits.
    """
    if notifier.watchdog_period_s is None:
        return
    told = ""
    while True:
        reason = healthy()
        if not reason:
            notifier.watchdog()
        elif reason != told:
            _log.critical("the watchdog is not petted: %s", reason)
            notifier.status(f"not healthy: {reason}")
        told = reason
        await asyncio.sleep(notifier.watchdog_period_s / PETS_A_PERIOD)
