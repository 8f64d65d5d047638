"""Where a robot's control socket lies, and whether a robot answers there."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterable, Mapping
from pathlib import Path

from robot.errors import FileError, UnavailableError

NAME = "control.sock"
KNOCK_S = 0.5


def socket_path(run_directory: Path, environment: Mapping[str, str]) -> Path:
    """``$RUNTIME_DIRECTORY/control.sock`` where a service manager made that folder, else in the run directory."""
    folders = environment.get("RUNTIME_DIRECTORY", "").split(":")
    return Path(folders[0] or run_directory) / NAME


def answers(path: Path) -> bool:
    """Whether a process listens at a socket file. ``OSError`` when that cannot be told."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as knocking:
        knocking.settimeout(KNOCK_S)
        try:
            knocking.connect(os.fspath(path))
        except ConnectionRefusedError:
            return False
        except (TimeoutError, BlockingIOError):
            return True  # its queue is full: it lives
        return True


def find_socket(candidates: Iterable[Path]) -> Path:
    """The first at which a robot answers. ``UnavailableError`` names all that were tried."""
    tried = list(dict.fromkeys(candidates))
    for path in tried:
        try:
            if answers(path):
                return path
        except (FileNotFoundError, NotADirectoryError):
            continue
        except PermissionError as error:
            raise FileError(
                f"{path}: you may not talk to this robot; become a member of its socket's group, or use sudo"
            ) from error
        except OSError:  # no socket at all, or a path too long for one
            continue
    raise UnavailableError(
        f"no robot answers at {' or '.join(map(str, tried))}; start one with 'sprayer run', or give its --socket"
    )
