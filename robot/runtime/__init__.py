"""The composition root: configuration in, a living robot out. Nothing else knows concrete back ends."""

from robot.runtime.emulator_process import EmulatorOptions, emulator_process
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
    "EmulatorOptions",
    "ModeChanged",
    "RunBegan",
    "RunOptions",
    "RunResult",
    "StopSignals",
    "emulator_process",
    "frames_folder",
    "ledger_path",
    "run_robot",
]
