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

__all__ = ["ModeChanged", "RunBegan", "RunOptions", "RunResult", "frames_folder", "ledger_path", "run_robot"]
