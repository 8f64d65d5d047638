"""What has changed from one bench.json to another."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_SAME = 1e-9
_SAME_SPEED = 0.1  # of a time or a speed: the machine is never quite the same
_SPEEDS = ("milliseconds", "sprayer_detect")


@dataclass(frozen=True, slots=True)
class Difference:
    """``before`` or ``after`` is None for a number that is not there."""

    path: str
    before: float | None
    after: float | None

    def __str__(self) -> str:
        before, after = ("none" if value is None else f"{value:.4g}" for value in (self.before, self.after))
        by = "" if self.before is None or self.after is None else f"  ({self.after - self.before:+.3g})"
        return f"{self.path}: {before} -> {after}{by}"


def read_numbers(path: Path) -> dict[str, Any]:
    """A bench.json. ``ValueError`` says what is wrong with one that cannot be read."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        leaves = dict(_leaves(content))
    except (OSError, ValueError, AttributeError) as error:
        raise ValueError(f"{path}: expected bench.json of an earlier run, found {error}; give another file") from error
    if not leaves:
        raise ValueError(f"{path}: expected the numbers of an earlier run, found none; give another file")
    return dict(content)


def differences(before: dict[str, Any], after: dict[str, Any]) -> tuple[Difference, ...]:
    """Every number that is not the same; times and speeds when they differ by a tenth."""
    old, new = dict(_leaves(before)), dict(_leaves(after))
    found = (Difference(path, old.get(path), new.get(path)) for path in sorted(old.keys() | new.keys()))
    return tuple(difference for difference in found if _differs(difference))


def _differs(difference: Difference) -> bool:
    before, after = difference.before, difference.after
    if before is None or after is None:
        return before is not after
    bound = _SAME_SPEED * abs(before) if difference.path.startswith(_SPEEDS) else _SAME
    return abs(after - before) > bound


def _leaves(content: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, float | None]]:
    for key, value in content.items():
        path = f"{prefix} > {key}" if prefix else str(key)
        if isinstance(value, dict):
            yield from _leaves(value, path)
        elif value is None or (isinstance(value, (int, float)) and not isinstance(value, bool)):
            yield path, value
