"""A robot in a process of its own, on a short simulated row, to be stopped and killed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

DEMO = Path(__file__).parents[2] / "configs" / "demo.toml"
SPRAYER = (sys.executable, "-c", "from robot.cli import main; main()")
DEADLINE_S = 60.0


def short_row(folder: Path, stops_m: tuple[float, ...] = (0.45, 0.85), **replaced: str) -> Path:
    """A configuration like the demo's with a row of few stops."""
    text = DEMO.read_text().replace("routes/demo.toml", "routes/short.toml")
    for old, new in replaced.items():
        assert old in text, old
        text = text.replace(old, new)
    (folder / "routes").mkdir(parents=True, exist_ok=True)
    (folder / "routes" / "short.toml").write_text(
        f'name = "short"\n[[row]]\nname = "A"\nside = "left"\nlength_m = 1.6\nstops_m = {list(stops_m)}\n'
    )
    path = folder / "short.toml"
    path.write_text(text)
    return path


def command(config: Path, out: Path, *more: str) -> list[str]:
    truth = out / "truth.jsonl"
    return [*SPRAYER, "run", "--config", str(config), "--out", str(out), "--truth", str(truth), *more]


def begin(config: Path, out: Path, *more: str) -> subprocess.Popen[str]:
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "SPRAYER_VISION__DETECTOR": "paper", "COLUMNS": "200"}
    return subprocess.Popen(command(config, out, *more), stderr=subprocess.PIPE, text=True, env=environment)


def wait_for_line(process: subprocess.Popen[str], truth: Path, wanted: str, count: int = 1) -> None:
    """Until the truth file holds ``count`` lines with ``wanted``, or the process ends."""
    deadline = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline:
        if process.poll() is not None:
            return
        if truth.exists() and truth.read_text(errors="replace").count(wanted) >= count:
            return
        time.sleep(0.005)
    process.kill()
    raise AssertionError(f"no {wanted!r} in {truth} within {DEADLINE_S} s")


def wait_for_message(process: subprocess.Popen[str], wanted: str) -> str:
    """What the process said on stderr, up to the line with ``wanted``."""
    assert process.stderr is not None
    said = ""
    for line in process.stderr:
        said += line
        if wanted in line:
            return said
    raise AssertionError(f"the process ended without saying {wanted!r}: {said}")


def finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    """(exit code, stderr) when the process has ended."""
    _, errors = process.communicate(timeout=DEADLINE_S)
    return process.returncode, errors


def load(path: Path) -> dict[str, object]:
    content: dict[str, object] = json.loads(path.read_text())
    return content
