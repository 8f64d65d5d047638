"""Joint angles of single poses, one JSON object a line: ``{"id": "pose01", "joints_rad": [0.1, ...]}``."""

from __future__ import annotations

import json
import math
from pathlib import Path

from robot.errors import FileError

_FORM = 'expected {"id": "...", "joints_rad": [...]}'


def read_joint_angles(path: Path, joints: int) -> dict[str, tuple[float, ...]]:
    """Angles (radians) by id, in the order of the file. ``FileError`` names the line and what is wrong with it."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: not UTF-8 ({error}); {_FORM} a line") from error
    found: dict[str, tuple[float, ...]] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        where = f"{path}, line {number}"
        name, angles = _pose(line, joints, where)
        if name in found:
            raise FileError(f"{where}: '{name}' was there already; keep one of the two")
        found[name] = angles
    if not found:
        raise FileError(f"{path}: holds no joint angles; {_FORM} a line")
    return found


def _pose(line: str, joints: int, where: str) -> tuple[str, tuple[float, ...]]:
    try:
        content = json.loads(line)
    except json.JSONDecodeError as error:
        raise FileError(f"{where}: not JSON ({error}); {_FORM}") from error
    if not isinstance(content, dict) or set(content) != {"id", "joints_rad"}:
        raise FileError(f"{where}: found {line.strip()[:60]}; {_FORM}")
    name, angles = content["id"], content["joints_rad"]
    if not isinstance(name, str) or not name:
        raise FileError(f"{where}: 'id' must be the name of a pair without _left and _right, found {name!r}")
    plain = isinstance(angles, list) and all(isinstance(a, int | float) and not isinstance(a, bool) for a in angles)
    if not plain or len(angles) != joints:
        raise FileError(f"{where}: 'joints_rad' of '{name}' must be {joints} numbers (radians), found {angles!r}")
    if not all(math.isfinite(angle) and abs(angle) <= math.tau for angle in angles):
        raise FileError(
            f"{where}: 'joints_rad' of '{name}' must be finite and within one turn, found {angles}; "
            "are they degrees? give radians"
        )
    return name, tuple(float(angle) for angle in angles)
