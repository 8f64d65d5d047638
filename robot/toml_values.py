"""Changing numbers, and lists of them, of a TOML file and nothing else.

Comments, order, spaces and line ends stay as they are.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

from robot.atomic_file import atomic_file
from robot.errors import ConfigError, FileError

Numbers = float | Sequence[float]

_NUMBER = r"[+-]?[\d._eE+-]+"
_LIST = rf"\[\s*{_NUMBER}(?:\s*,\s*{_NUMBER})*\s*,?\s*\]"
_HEADER = re.compile(r"^\s*\[(?P<name>[^\[\]]+)\]\s*(#.*)?$")


def read_toml_text(path: Path) -> str:
    """The file's text with its line ends as they are. ``FileError`` when it cannot be read."""
    try:
        return path.read_bytes().decode("utf-8")
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not UTF-8 ({error}); mend the file") from error


def with_numbers(text: str, section: str, numbers: Mapping[str, Numbers], source: str) -> str:
    """The text with these keys of ``[section]`` at new values, a number or a list of numbers each.

    ``ConfigError`` when one is not written there as ``key = value`` of that kind on a line of its own, or when
    anything else would change.
    """
    lines = text.splitlines(keepends=True)
    for key, number in numbers.items():
        kind, shown, pattern = "number", repr(number), _NUMBER
        if not isinstance(number, (int, float)):
            kind, shown, pattern = "[numbers]", repr(list(number)), _LIST
        place = _line_of(lines, section, key, pattern)
        if place is None:
            raise ConfigError(f"{source}: [{section}] has no line '{key} = {kind}'; put it in by hand: {key} = {shown}")
        number_at = re.match(rf"(\s*[\w\"'-]+\s*=\s*){pattern}", lines[place])
        assert number_at is not None  # _line_of found it by a stricter pattern
        lines[place] = f"{number_at[1]}{shown}{lines[place][number_at.end():]}"
    changed = "".join(lines)
    _check(text, changed, section, numbers, source)
    return changed


def difference(before: str, after: str, name: str) -> str:
    """What changes, as a unified diff without context."""
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), name, name, n=0, lineterm="")
    return "\n".join(lines)


def write_toml_text(path: Path, text: str) -> None:
    """Whole or not at all, with the file's own permissions."""
    place = path.resolve()
    with atomic_file(place) as stream:
        mode = place.stat().st_mode if place.exists() else None
        stream.write(text.encode("utf-8"))
    if mode is not None:
        place.chmod(mode & 0o7777)


def _line_of(lines: list[str], section: str, key: str, value: str) -> int | None:
    """Where ``key`` of ``[section]`` stands with a value of this pattern."""
    inside = False
    pattern = re.compile(rf"^\s*(?P<quote>[\"']?){re.escape(key)}(?P=quote)\s*=\s*{value}\s*(#.*)?\r?\n?$")
    for number, line in enumerate(lines):
        if (header := _HEADER.match(line)) is not None or line.lstrip().startswith("[["):
            inside = header is not None and header["name"].strip() == section
        elif inside and pattern.match(line):
            return number
    return None


def _check(before: str, after: str, section: str, numbers: Mapping[str, Numbers], source: str) -> None:
    """The new text says what the old one said but for the numbers: a pattern is no parser."""
    wanted, found = tomllib.loads(before), tomllib.loads(after)
    for key, value in numbers.items():
        wanted[section][key] = list(value) if isinstance(value, Sequence) else value
    if wanted != found:
        raise ConfigError(f"{source}: cannot be changed without changing more; put the values in by hand")
