"""The composition root: configuration in, a living robot out. Nothing else knows concrete back ends."""

from robot.runtime.lifecycle import (
    ModeChanged,
    RunBegan,
    RunOptions,
    RunResult,
    frames_folder,
    ledger_path,
    run_robot,
)
from robot.runtime.signals import StopSignals

__all__ = [
    "ModeChanged",
    "RunBegan",
    "RunOptions",
    "RunResult",
    "StopSignals",
    "frames_folder",
    "ledger_path",
    "run_robot",
]
