"""Asks the modem how it is, and tells when nobody can be reached by it."""

from __future__ import annotations

from collections.abc import Callable

from drivers.modem.interface import Modem
from drivers.modem.values import ModemStatus
from robot.events import Bus


class ModemPoll:
    """Publishes every ``ModemStatus``; ``tell`` is for a person, when the network goes and when it is back."""

    def __init__(self, modem: Modem, bus: Bus, tell: Callable[[str], None]) -> None:
        self._modem, self._bus, self._tell = modem, bus, tell
        self._reachable = True

    async def step(self) -> None:
        """``DeviceError`` when the modem does not answer."""
        status = await self._modem.status()
        self._bus.publish(status)
        self._judge(status)

    def _judge(self, status: ModemStatus) -> None:
        reachable = status.sim_ready and status.registered
        if reachable is self._reachable:
            return
        self._reachable = reachable
        if reachable:
            self._tell("modem: in its network again")
        else:
            missing = "a network; check antenna and coverage" if status.sim_ready else "a ready SIM; check its PIN"
            self._tell(f"modem: found without {missing}; messages wait [F70a]")
