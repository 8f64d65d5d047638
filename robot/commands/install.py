"""``sprayer install``: the service, its all-off script, user, folders and port names, here or in an image."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from robot.atomic_file import atomic_file
from robot.commands.install_files import ALLOFF, ALLOFF_LINK, CONFIG, RULES, SHIPPED_PYTHON, UNITS, Item, items
from robot.errors import FileError, UnavailableError, UsageError

HIDDEN = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")  # what the unit's sandbox does not see
COMMAND_S = 60.0
RELOAD = (
    ("systemd-sysusers", "/etc/sysusers.d/sprayer.conf"),
    ("systemctl", "daemon-reload"),
    ("systemd-tmpfiles", "--create", "/etc/tmpfiles.d/sprayer.conf"),
)
RELOAD_RULES = ("udevadm", "control", "--reload")
UDEV = Path("/run/udev/control")  # there while udev runs
NEXT = f"""\
next: put your adapters in {RULES} and your machine in {CONFIG}; try them:
  sprayer config check {CONFIG} && sprayer doctor --config {CONFIG}
then, with water: systemctl enable --now sprayer
"""


def install(
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be done, change nothing.")] = False,
    uninstall: Annotated[bool, typer.Option("--uninstall", help="Take away what was not edited.")] = False,
    root: Annotated[Path, typer.Option("--root", help="Install into this folder: a staging root or an image.")] = Path(
        "/"
    ),
    program: Annotated[
        Path | None, typer.Option("--program", help="The sprayer that the service runs; default: this one.")
    ] = None,
    python: Annotated[
        Path, typer.Option("--python", help="The Python of the all-off script; any 3.9 or newer will do.")
    ] = Path(SHIPPED_PYTHON),
) -> int:
    """Install the service (as root). May be repeated; your configuration and port names are left as they are."""
    live = root.resolve() == Path("/")
    if live and not dry_run and os.geteuid() != 0:
        raise UsageError("installing needs root: sudo sprayer install (or --dry-run, or --root DIR for a staging root)")
    if not root.is_dir():
        raise FileError(f"{root}: no such folder; make it, or correct --root")
    chosen = _program(program, python, live and not uninstall)
    work = _Work(root, dry_run, live and Path("/run/systemd/system").is_dir())
    files = list(items(chosen, python))
    if uninstall:
        work.uninstall(files)
    else:
        work.install(files)
        sys.stdout.write(NEXT)
    return 0


def _program(program: Path | None, python: Path, live: bool) -> Path:
    """The program that the unit will start. ``UsageError`` when the service could not."""
    chosen = Path(sys.executable).parent / "sprayer" if program is None else program
    if not (chosen.is_absolute() and python.is_absolute()):
        raise UsageError(f"--program {chosen}, --python {python}: systemd needs whole paths, beginning with /")
    if any(sign.isspace() or sign in "%$\\\"'" for sign in f"{chosen}{python}"):
        raise UsageError(f"{chosen}: signs that mean something in a unit file; install the program at a plain path")
    if not live:
        return chosen
    for path in (chosen, python):
        if not os.access(path, os.X_OK):
            raise UsageError(f"{path}: no program there; install it, or name another with --program, --python")
    own = () if program is not None else (sys.prefix, sys.base_prefix)
    for place in (str(chosen), str(chosen.resolve()), *own):
        if hidden := next((folder for folder in HIDDEN if Path(place).is_relative_to(folder)), None):
            raise UsageError(
                f"{place}: the service is kept out of {hidden} and could not start it; install Python and the program "
                "where all can read them, like /opt/sprayer (docs/operations/service.md)"
            )
    return chosen


@dataclass(frozen=True, slots=True)
class _Work:
    """Does each thing, or with ``dry_run`` only says so. ``running``: systemd runs here and may be asked."""

    root: Path
    dry_run: bool
    running: bool

    def install(self, files: Iterable[Item]) -> None:
        for item in files:
            self._put(item)
        self._link()
        if self.running:
            for command in RELOAD:
                self._run(command)
            self._reload_rules()

    def uninstall(self, files: Iterable[Item]) -> None:
        """What is yours stays, and so do the user, the ledger and what else is in /var/lib/sprayer."""
        if self.running and self._at(Path("/etc/systemd/system") / UNITS[0]).exists():
            self._run(("systemctl", "disable", "--now", UNITS[0]))
        link = self._at(ALLOFF_LINK)
        if link.is_symlink() and os.readlink(link) == str(ALLOFF):
            self._do(f"remove {link}", link.unlink)
        for item in reversed(list(files)):
            self._take_away(item)
        if self.running:
            self._run(("systemctl", "daemon-reload"))
            self._reload_rules()

    def _reload_rules(self) -> None:
        if UDEV.exists():  # containers have none
            self._run(RELOAD_RULES)

    def _put(self, item: Item) -> None:
        place = self._at(item.path)
        found = place.read_bytes() if place.is_file() else None
        if found is not None and item.yours and found != item.content:
            self._say(f"keep {place} (yours; it differs from the one that came along)")
        elif found == item.content and place.stat().st_mode & 0o777 == item.mode:
            self._say(f"unchanged {place}")
        else:
            self._do(f"{'write' if found is None else 'update'} {place}", lambda: _write(place, item))

    def _take_away(self, item: Item) -> None:
        place = self._at(item.path)
        if not place.is_file():
            return
        if item.yours and place.read_bytes() != item.content:
            self._say(f"keep {place} (yours)")
            return
        self._do(f"remove {place}", place.unlink)

    def _link(self) -> None:
        """All-off by hand, from anywhere."""
        link = self._at(ALLOFF_LINK)
        if link.is_symlink() and os.readlink(link) == str(ALLOFF):
            self._say(f"unchanged {link}")
        elif link.is_symlink() or link.exists():
            self._say(f"keep {link} (not from here)")
        else:
            self._do(f"link {link} -> {ALLOFF}", lambda: _make_link(link))

    def _run(self, command: tuple[str, ...]) -> None:
        self._do(f"run {' '.join(command)}", lambda: _call(command))

    def _at(self, path: Path) -> Path:
        return self.root / path.relative_to("/")

    def _do(self, what: str, action: Callable[[], object]) -> None:
        self._say(f"would {what}" if self.dry_run else what)
        if not self.dry_run:
            action()

    def _say(self, what: str) -> None:
        sys.stdout.write(f"{what}\n")


def _write(place: Path, item: Item) -> None:
    place.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(place) as stream:
        stream.write(item.content)
    place.chmod(item.mode)


def _make_link(link: Path) -> None:
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to(ALLOFF)


def _call(command: tuple[str, ...]) -> None:
    """``UnavailableError`` says what the command said."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=COMMAND_S, check=False)
    except FileNotFoundError:
        raise UnavailableError(f"{command[0]}: not found; this computer lacks a part of systemd, install it") from None
    except subprocess.TimeoutExpired:
        raise UnavailableError(f"{' '.join(command)}: no end within {COMMAND_S:g} s; see systemctl status") from None
    if done.returncode != 0:
        said = " ".join(f"{done.stdout} {done.stderr}".split())[:300]
        raise UnavailableError(f"{' '.join(command)}: ended with {done.returncode} ({said}); mend that and repeat")
