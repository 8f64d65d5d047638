"""Files that appear whole or not at all."""

from __future__ import annotations

import io
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from robot.errors import FileError


@contextmanager
def atomic_file(path: Path) -> Iterator[io.BytesIO]:
    """A buffer whose content takes the place of ``path`` when the block ends well, and is forgotten when it does not.

    Raises ``FileError`` at once when the folder is missing or may not be written, at the end when the disk is full.
    """
    if path.is_dir():
        raise FileError(f"{path}: is a folder; give the name of a file to write")
    if not path.parent.is_dir():
        raise _unwritable(path, "no such folder")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise _unwritable(path, "permission denied")
    content = io.BytesIO()
    yield content
    partial = path.with_name(f".{path.name}.{secrets.token_hex(6)}.part")
    try:
        with partial.open("xb") as stream:
            stream.write(content.getbuffer())
            stream.flush()
            os.fsync(stream.fileno())
        partial.replace(path)
    except OSError as error:
        raise _unwritable(path, error.strerror or str(error)) from error
    finally:
        with suppress(OSError):
            partial.unlink()


def _unwritable(path: Path, why: str) -> FileError:
    return FileError(f"{path}: cannot be written ({why}); check that its folder exists, may be written and has room")
