"""An emulated port is as free for the next host as a real one is when its last one is gone."""

from __future__ import annotations

import asyncio
import os
import subprocess

import pytest

from drivers import port_lock
from drivers.emulation.wire import PtyWire


@pytest.mark.skipif(os.geteuid() != 0, reason="TIOCEXCL is told from another user's open, which takes root to try")
def test_exclusive_use_ends_with_the_host() -> None:
    async def main() -> tuple[bool, bool]:
        wire = PtyWire(9600, lambda data: None)
        wire.plug()
        try:
            host = os.open(wire.path, os.O_RDWR | os.O_NOCTTY)
            port_lock.take(host, "relay", wire.path)
            wire.forget_dead_host()
            while_held = opens_as_another(wire.path)
            os.close(host)  # killed: nothing is let go in order
            wire.forget_dead_host()
            return while_held, opens_as_another(wire.path)
        finally:
            port_lock.release(wire.path)
            wire.unplug()

    assert asyncio.run(main()) == (False, True)


def opens_as_another(path: str) -> bool:
    """Whether a user without privileges can open the terminal."""
    os.chmod(path, 0o666)
    return subprocess.run(["sh", "-c", f": <>{path}"], user="nobody", capture_output=True, check=False).returncode == 0
