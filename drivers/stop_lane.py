"""How a device is made safe from any thread, while the event loop that commands it stands still."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future

from drivers.errors import DeviceRefused


class StopLane:
    """One device's stop, for whoever cannot await it.

    ``post`` puts the stop before all that waits for the owner of the device's port and returns at once. From then on
    the device refuses whatever moves or opens, until ``release``: what the loop asks for when it comes back was
    decided before the stop. ``force`` writes the stop beside an owner that hangs; without ``beside`` the device needs
    none, since it stops by itself when it hears nothing.
    """

    def __init__(
        self, device: str, post: Callable[[], Future[None]], beside: Callable[[], None] | None = None
    ) -> None:
        self.device = device
        self._post, self._beside = post, beside
        self._stopped_because = ""

    def post(self, because: str) -> Future[None]:
        """From any thread. The future ends as the stop does, or in ``DeviceLost`` at once when there is no device."""
        self._stopped_because = because
        return self._post()

    def force(self) -> bool:
        """From any thread; whether something was written. ``DeviceError`` when the device takes nothing."""
        if self._beside is None:
            return False
        self._beside()
        return True

    def release(self) -> None:
        """The machine's stop is latched: the device obeys its commands again."""
        self._stopped_because = ""

    def require_released(self) -> None:
        """``DeviceRefused`` between ``post`` and ``release``."""
        if self._stopped_because:
            raise DeviceRefused(
                self.device, "no stop under way", f"one, because {self._stopped_because}", "ask again once it is over"
            )
