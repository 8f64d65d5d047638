"""A small row for the tests: a ledger, and the truth of what its shots did."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from drivers.twin.truth import FORMAT
from robot.ledger import Intent, Ledger, Outcome, Result
from robot.targets import TargetState
from tests.robot.ledger.rows import NOON, STOP, TASK, target

FRUITS = [  # id, x, diameter, visible
    (1, 0.30, 0.080, 0.9),
    (2, 0.60, 0.070, 0.8),
    (3, 0.90, 0.060, 0.7),
    (4, 1.50, 0.090, 0.3),
]


@dataclass(frozen=True)
class Sprayed:
    """One opening: for which target, what was commanded, and where the millilitres truly went."""

    target_id: int
    dose_ml: float
    fruit_ml: dict[int, float]
    leaf_ml: float = 0.0

    @property
    def ml(self) -> float:
        return sum(self.fruit_ml.values()) + self.leaf_ml


# Target 1 hits fruit 1; target 2 hits fruit 2; target 3 hits leaves only: a phantom.
USUAL = (Sprayed(1, 5.0, {1: 4.9, 2: 0.2}), Sprayed(2, 4.0, {2: 4.0}, 0.4), Sprayed(3, 2.0, {3: 0.1}, 1.9))


def write_ledger(path: Path, shots: tuple[Sprayed, ...] = USUAL, restart_after: int | None = None) -> None:
    """Targets 1 to 3 at the fruits 1 to 3 (5 mm off), and target 4 unreachable with nothing there."""
    with Ledger.open(path, utc=lambda: NOON) as ledger:
        ledger.begin_run("boot-0", NOON)  # a run of an earlier day
        ledger.begin_run("boot-1", NOON)
        task_id = ledger.begin_task(TASK)
        ledger.upsert_targets(
            task_id,
            [
                replace(target(n, TargetState.SPRAYED, x_m=x_m + 0.005), diameter_m=diameter_m)
                for n, x_m, diameter_m, _ in FRUITS[:3]
            ]
            + [replace(target(4, TargetState.UNREACHABLE, x_m=2.5), reason="out of the arm's reach by 31 mm")],
        )
        ledger.record_stop(task_id, replace(STOP, stop=1, stamp_s=5.0, frame_file="stop_001.jpg"))
        ledger.record_event("mode", "auto", 0.5)
        clock_s = 10.0
        for number, shot in enumerate(shots):
            if number == restart_after:
                ledger.begin_run("boot-2", NOON)
                clock_s = 4.0
            intent = Intent(shot.target_id, 1, 1, shot.dose_ml, shot.dose_ml, 0.4, 0.5, 8.0, clock_s)
            result = Result(Outcome.SPRAYED, shot.dose_ml, 0.4, shot.ml, "", clock_s + 0.6)
            ledger.write_result(ledger.write_intent(task_id, intent), result)
            clock_s += 4.0


def write_truth(path: Path, shots: tuple[Sprayed, ...] = USUAL, restart_after: int | None = None) -> None:
    world = {
        "kind": "world",
        "format": FORMAT,
        "t": 0.0,
        "fruits": [
            {"id": n, "centre_m": [x_m, 0.6, 0.9], "diameter_m": d_m, "ripeness": "red"} for n, x_m, d_m, _ in FRUITS
        ],
    }
    view = {
        "kind": "view",
        "t": 5.0,
        "sequence": 1,
        "base": [0.2, 0.0, 0.0],
        "fruits": [
            {"id": n, "visible": [share, share + 0.05], "in_image": [1.0, 1.0], "centre": [0.0, 0.0, 0.5]}
            for n, _, _, share in FRUITS
        ],
    }
    lines: list[dict[str, object]] = [world, view]
    clock_s = 10.0
    for number, shot in enumerate(shots):
        if number == restart_after:
            lines.append(world)
            clock_s = 4.0
        lines.append(
            {
                "kind": "event",
                "t": clock_s + 0.5,
                "what": "delivered",
                "open_s": 0.4,
                "ml": shot.ml,
                "fruit_ml": shot.fruit_ml,
                "leaf_ml": shot.leaf_ml,
                "stem_ml": 0.0,
                "soil_ml": 0.0,
                "air_ml": 0.0,
                "nozzle_m": [0.3, 0.3, 0.9],
                "axis": [0.0, 1.0, 0.0],
            }
        )
        clock_s += 4.0
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def write_frame(folder: Path) -> None:
    folder.mkdir()
    picture = np.full((48, 64, 3), (60, 140, 60), np.uint8)
    cv2.circle(picture, (30, 24), 10, (40, 40, 200), -1)
    cv2.imwrite(str(folder / "stop_001.jpg"), picture)
