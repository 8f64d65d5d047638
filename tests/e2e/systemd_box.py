"""A real systemd in namespaces of its own, with this program in it: what CI has in the place of a rover's computer.

It needs root, overlayfs and a writable cgroup2 tree; ``refusal`` says what is missing. Nothing outside changes: files
go into an overlay that is thrown away, processes end with the box.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import cv2

REPOSITORY = Path(__file__).parents[2]
SCRIPT = Path(__file__).with_name("systemd_box.sh")
SYSTEMD = Path("/lib/systemd/systemd")
NAMESPACES = ("--mount", "--pid", "--fork", "--cgroup", "--net", "--uts", "--ipc", "--propagation", "private")
UP_S = 30.0
PROGRAM = "/opt/sprayer/bin/sprayer"
SITE_PACKAGES = Path(cv2.__file__).parents[1]
_PLACES = {
    REPOSITORY: "/opt/sprayer/src",
    SITE_PACKAGES: "/opt/sprayer/site",
    Path(sys.base_prefix): "/opt/sprayer/python",
}
LIBRARIES = "LD_LIBRARY_PATH=/opt/sprayer/python/lib"  # of a Python that was built where the service cannot look
_PYTHON = f"/opt/sprayer/python/bin/python{sys.version_info.major}.{sys.version_info.minor}"


def refusal() -> str:
    """Why there can be no box here; "" when there can."""
    if os.geteuid() != 0:
        return "not root"
    if not SYSTEMD.exists():
        return f"{SYSTEMD} is not installed (apt-get install systemd)"
    missing = [tool for tool in ("unshare", "nsenter", "setpriv", "pivot_root", "ip") if shutil.which(tool) is None]
    if missing:
        return f"not installed: {', '.join(missing)}"
    if (tree := _cgroups()) is None or not os.access(tree, os.W_OK):
        return "no writable cgroup2 tree"
    command = ["unshare", *NAMESPACES, "mount", "-t", "tmpfs", "tmpfs", "/mnt"]
    tried = subprocess.run(command, capture_output=True, text=True, check=False)
    return f"namespaces are refused ({tried.stderr.strip()})" if tried.returncode else ""


def _cgroups() -> Path | None:
    mounts = (line.split() for line in Path("/proc/mounts").read_text().splitlines())
    return next((Path(words[1]) for words in mounts if words[2] == "cgroup2"), None)


@dataclass(frozen=True)
class Box:
    """``init`` is its systemd's process as seen from outside, ``shared`` the folder that is /box inside."""

    init: int
    shared: Path

    def command(self, *words: str) -> list[str]:
        return ["nsenter", "--target", str(self.init), "--all", *words]

    def run(self, *words: str, ok: Sequence[int] = (0,)) -> str:
        """What a command inside said; it must end with one of ``ok``."""
        done = subprocess.run(self.command(*words), capture_output=True, text=True, timeout=120, check=False)
        if done.returncode not in ok:
            told = self.said(words[-1]) if words[0] == "systemctl" else ""
            raise AssertionError(f"{' '.join(words)}: {done.returncode}: {done.stdout}{done.stderr}{told[-6000:]}")
        return done.stdout + done.stderr

    def put(self, path: str, text: str, mode: int = 0o644) -> None:
        """A file inside."""
        (self.shared / "put").write_text(text)
        self.run("install", "-D", "-m", f"{mode:o}", "/box/put", path)

    def show(self, unit: str, *names: str) -> dict[str, str]:
        """Properties of a unit."""
        lines = self.run("systemctl", "show", unit, *(f"--property={name}" for name in names)).splitlines()
        return dict(line.split("=", 1) for line in lines if "=" in line)

    def journal(self, unit: str) -> list[dict[str, str]]:
        """The journal's entries of a unit and of systemd about it, oldest first."""
        text = self.run("journalctl", "--unit", unit, "--output", "json", "--no-pager", ok=(0, 1))
        return [json.loads(line) for line in text.splitlines() if line.startswith("{")]

    def said(self, unit: str) -> str:
        return "\n".join(str(entry["MESSAGE"]) for entry in self.journal(unit))

    def until(self, what: str, condition: Callable[[], bool], longest_s: float = 60.0) -> None:
        end_s = time.monotonic() + longest_s
        while not condition():
            assert time.monotonic() < end_s, f"waited in vain: {what}\n{self.said('sprayer.service')[-6000:]}"
            time.sleep(0.05)


@contextmanager
def systemd_box(shared: Path) -> Iterator[Box]:
    """A running box with the program at ``PROGRAM``; it ends with the block."""
    tree = _cgroups()
    assert tree is not None
    group = tree / f"sprayer-box-{os.getpid()}"
    group.mkdir()
    places = [f"{folder}={place}" for folder, place in _PLACES.items()]
    guarded = f"setpriv --pdeathsig KILL unshare {' '.join(NAMESPACES)} --kill-child"  # it ends with this process
    join = f'echo $$ > {group}/cgroup.procs && exec {guarded} "$@"'
    process = subprocess.Popen(
        ["bash", "-c", join, "box", "bash", str(SCRIPT), str(shared), *places],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    try:
        box = Box(_init_of(process), shared)
        box.until("systemd is up", lambda: _is_up(box), UP_S)
        box.put(PROGRAM, _program(), 0o755)
        yield box
    finally:
        process.kill()
        process.wait(30)
        _remove(group)


def _program() -> str:
    paths = [_PLACES[REPOSITORY], _PLACES[SITE_PACKAGES]]
    text = f"#!{_PYTHON} -s\nimport sys\nsys.path[:0] = {paths}\nfrom robot.cli import main\n"
    return text + "if __name__ == '__main__':\n    main()\n"


def _init_of(process: subprocess.Popen[bytes]) -> int:
    """The child of unshare, once it is systemd."""
    end_s = time.monotonic() + UP_S
    while time.monotonic() < end_s and process.poll() is None:
        with suppress(OSError):
            for child in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split():
                if Path(f"/proc/{child}/comm").read_text().strip() == "systemd":
                    return int(child)
        time.sleep(0.02)
    raise AssertionError("the box did not come up")


def _is_up(box: Box) -> bool:
    command = box.command("systemctl", "is-active", "box.target")
    tried = subprocess.run(command, capture_output=True, text=True, check=False)
    return tried.stdout.strip() == "active"


def _remove(group: Path) -> None:
    """The box's cgroups, the innermost first, when the kernel has done with its processes."""
    end_s = time.monotonic() + 10.0
    while group.exists() and time.monotonic() < end_s:
        for folder in sorted((path for path in group.rglob("*") if path.is_dir()), reverse=True):
            with suppress(OSError):
                folder.rmdir()
        with suppress(OSError):
            group.rmdir()
        time.sleep(0.05)
