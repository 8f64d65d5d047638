"""The machine as a process reaches it: when the process is killed, nothing that it still does gets through."""

from __future__ import annotations

from typing import Any, cast

from drivers.errors import DeviceLost
from drivers.twin.machine import Twin


class MachineLine:
    """Hands everything on to the twin until it is ``cut``."""

    def __init__(self, twin: Twin) -> None:
        self._twin = twin
        self.cut = False

    def as_twin(self) -> Twin:
        """For a process: it cannot tell the difference."""
        return cast(Twin, self)

    def close_truth(self) -> None:
        """The truth belongs to the soak."""

    def __getattr__(self, name: str) -> Any:
        if self.cut:
            raise DeviceLost("machine", "a living process", "a killed one", "nothing: it is not there any more")
        return getattr(self._twin, name)
