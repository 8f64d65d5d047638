"""What ``sprayer install`` puts where: files from the program's own folders, with this computer's paths in them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from robot.package_files import packaged

SHIPPED_PROGRAM = "/usr/bin/sprayer"
SHIPPED_PYTHON = "/usr/bin/python3"
UNITS = ("sprayer.service", "sprayer-failed.service")
CONFIG = Path("/etc/sprayer/rover.toml")
RULES = Path("/etc/udev/rules.d/60-sprayer-ports.rules")
ALLOFF = Path("/usr/lib/sprayer/sprayer-alloff")
ALLOFF_LINK = Path("/usr/local/bin/sprayer-alloff")


@dataclass(frozen=True, slots=True)
class Item:
    """A file for ``path`` (absolute, as the installed system sees it). ``yours``: it is meant to be edited, and is
    never written over or taken away once it has been.
    """

    path: Path
    content: bytes
    mode: int = 0o644
    yours: bool = False


def items(program: Path, python: Path) -> Iterator[Item]:
    """Every file, the script before the units that call it. ``program`` is ``sprayer``, ``python`` the script's."""
    source = packaged("systemd")
    script = (source / "sprayer-alloff").read_text(encoding="utf-8")
    yield Item(ALLOFF, _with(script, SHIPPED_PYTHON, python), 0o755)
    yield Item(Path("/etc/sysusers.d/sprayer.conf"), (source / "sysusers.d" / "sprayer.conf").read_bytes())
    yield Item(Path("/etc/tmpfiles.d/sprayer.conf"), (source / "tmpfiles.d" / "sprayer.conf").read_bytes())
    yield Item(RULES, (source / RULES.name).read_bytes(), yours=True)
    config = (packaged("configs") / "rover.toml").read_text(encoding="utf-8")
    yield Item(CONFIG, _with(config, 'run_directory = "out"', 'run_directory = "/var/lib/sprayer"'), yours=True)
    for unit in UNITS:
        text = (source / unit).read_text(encoding="utf-8")
        placed = text.replace(SHIPPED_PROGRAM, str(program))
        yield Item(Path("/etc/systemd/system") / unit, placed.encode("utf-8"))


def _with(text: str, old: str, new: Path | str) -> bytes:
    """The first ``old`` replaced, which must be there."""
    before, found, after = text.partition(old)
    assert found, old
    return f"{before}{new}{after}".encode()
