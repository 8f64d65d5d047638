"""The command ``sprayer``: one program, many verbs. Each lives in ``robot.commands``."""

from __future__ import annotations

import logging
import signal
import sys

import typer

from drivers.errors import DeviceBusy, DeviceError
from robot.commands.arm import app as arm
from robot.commands.calibrate import app as calibrate
from robot.commands.calibrate_check import calibrate_check
from robot.commands.calibrate_flow import calibrate_flow
from robot.commands.calibrate_hand_eye import calibrate_hand_eye
from robot.commands.config_check import app as config
from robot.commands.demo import demo
from robot.commands.detect import detect
from robot.commands.doctor import doctor
from robot.commands.emulate import emulate
from robot.commands.gps import app as gps
from robot.commands.home import home
from robot.commands.jog import app as jog
from robot.commands.report import report
from robot.commands.run import run
from robot.commands.soak import soak
from robot.commands.spray import spray
from robot.commands.trace import trace
from robot.errors import BusyError, FileError, SprayerError, UnavailableError, UsageError
from robot.runtime.signals import STOPPING

_FILE = FileError.exit_code

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, help=__doc__)
app.command()(run)
app.command()(demo)
app.command()(doctor)
app.command()(emulate)
app.command()(detect)
app.command()(report)
app.add_typer(arm, name="arm")
app.add_typer(calibrate, name="calibrate")
app.add_typer(config, name="config")
app.add_typer(gps, name="gps")
app.add_typer(jog, name="jog")
app.command()(soak)
app.command()(spray)
app.command()(trace)
arm.command("home")(home)
calibrate.command("check")(calibrate_check)
calibrate.command("flow")(calibrate_flow)
calibrate.command("hand-eye")(calibrate_hand_eye)


def main() -> None:
    """Run a command. Errors become one line on stderr and the exit code of their kind (docs/exit-codes.md)."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    code = _exit_code(sys.argv[1:])
    for number in STOPPING:
        signal.signal(number, signal.SIG_IGN)  # all is done: a late signal does not change the outcome
    sys.exit(code)


def run_command(arguments: list[str]) -> int:
    """The exit code of a command line, for callers in the same process: signals are handled as before afterwards."""
    former = {number: signal.getsignal(number) for number in STOPPING}
    try:
        return _exit_code(arguments)
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


def _exit_code(arguments: list[str]) -> int:
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
