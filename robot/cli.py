"""The command ``sprayer``: one program, many verbs. Each lives in ``robot.commands``."""

from __future__ import annotations

import logging
import sys

import click
import typer

from drivers.errors import DeviceError
from robot.commands.calibrate import app as calibrate
from robot.commands.demo import demo
from robot.commands.detect import detect
from robot.commands.report import report
from robot.commands.run import run
from robot.errors import SprayerError, UnavailableError, UsageError

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, help=__doc__)
app.command()(run)
app.command()(demo)
app.command()(detect)
app.command()(report)
app.add_typer(calibrate, name="calibrate")


def main() -> None:
    """Run a command. Errors become one line on stderr and the exit code of their kind (docs/exit-codes.md)."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    sys.exit(run_command(sys.argv[1:]))


def run_command(arguments: list[str]) -> int:
    """The exit code of a command line."""
    try:
        outcome = app(arguments, standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        sys.stdout.write(error.format_message() + "\n")
        return UsageError.exit_code
    except click.ClickException as error:
        error.show()
        return UsageError.exit_code
    except click.exceptions.Abort:
        sys.stderr.write("sprayer: stopped by the keyboard\n")
        return 130
    except SprayerError as error:
        sys.stderr.write(f"sprayer: {error}\n")
        return error.exit_code
    except DeviceError as error:
        sys.stderr.write(f"sprayer: {error}\n")
        return UnavailableError.exit_code
    return outcome if isinstance(outcome, int) else 0
