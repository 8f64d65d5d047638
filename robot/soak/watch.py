"""Between the twin and its truth file: what is told goes to the monitors, and on to the file when there is one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from drivers.twin.truth import TruthLog
from robot.events import Bus
from robot.runtime import ModeChanged
from robot.soak.monitors import Bench
from robot.soak.values import Line


class Watch(TruthLog):
    """Keeps nothing itself. ``origin_s`` is when the present process began, in the soak's clock."""

    def __init__(self, bench: Bench, file: TruthLog | None = None) -> None:
        super().__init__(None)
        self.origin_s = 0.0
        self.listeners: list[Callable[[Line], None]] = []
        self._bench, self._file = bench, file

    @property
    def keeps(self) -> bool:
        return True

    def append(self, line: Mapping[str, Any]) -> None:
        if self._file is not None:
            self._file.append(line)
        kind = str(line["kind"])
        if kind == "world":
            return
        if kind == "command":
            seen = Line(self.origin_s + line["t"], kind, f"{line['device']} {line['verb']}", line["args"])
        else:
            seen = Line(self.origin_s + line["t"], kind, str(line.get("what", "")), line)
        self._bench.line(seen)
        for listener in self.listeners:
            listener(seen)

    def close(self) -> None:
        """A process lets go of the truth; the soak does not."""


class WatchedBus(Bus):
    """A bus whose mode changes the monitors hear at once, as long as ``alive`` says that the process lives."""

    def __init__(self, bench: Bench, origin_s: float, alive: Callable[[], bool]) -> None:
        super().__init__()
        self._bench, self._origin_s, self._alive = bench, origin_s, alive

    def publish(self, event: object) -> None:
        if isinstance(event, ModeChanged) and self._alive():
            self._bench.mode_changed(event.mode, event.causes, self._origin_s + event.stamp_s)
        super().publish(event)
