"""How a command ends: what it returned, or one line and the code of the error's kind."""

from __future__ import annotations

import sys

import typer

from drivers.errors import DeviceBusy, DeviceError
from robot.errors import BusyError, FileError, SprayerError, UnavailableError, UsageError

_FILE = FileError.exit_code


def exit_code(app: typer.Typer, arguments: list[str]) -> int:
    """Run a command line; an error becomes one line on standard error and the code of its kind (docs/exit-codes.md)."""
    try:
        outcome = app(arguments, standalone_mode=False)
    except typer.Abort:
        return _fail("stopped by the keyboard", 130)
    except typer.Exit as ended:
        return ended.exit_code
    except SprayerError as error:
        return _fail(str(error), error.exit_code)
    except DeviceBusy as error:
        return _fail(str(error), BusyError.exit_code)
    except DeviceError as error:
        return _fail(str(error), UnavailableError.exit_code)
    except OSError as error:
        name = error.filename or "a file of this run"
        return _fail(f"{name}: {error.strerror or error}; check the path, its permissions and the free space", _FILE)
    except Exception as error:
        if not isinstance(error, _wrong_usage()):
            raise
        message = str(error.format_message()).strip()  # type: ignore[attr-defined]
        return _fail(f"{message}; see sprayer --help", UsageError.exit_code) if message else UsageError.exit_code
    return outcome if isinstance(outcome, int) else 0


def _wrong_usage() -> type[Exception]:
    """The base of all usage errors. Typer carries its own click, which it does not export."""
    return next(base for base in typer.BadParameter.__mro__ if base.__name__ == "ClickException")


def _fail(text: str, code: int) -> int:
    line = "; ".join(part.strip() for part in text.splitlines() if part.strip())
    sys.stderr.write(f"sprayer: {line}\n")
    return code
