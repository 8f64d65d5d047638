"""The command ``sprayer``: one program, many verbs. Each lives in ``robot.commands``."""

from __future__ import annotations

import signal
import sys

import typer

from robot.commands import order
from robot.commands.alloff_file import alloff_file
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
from robot.commands.exits import exit_code
from robot.commands.gps import app as gps
from robot.commands.home import home
from robot.commands.install import install
from robot.commands.jog import app as jog
from robot.commands.release import release
from robot.commands.report import report
from robot.commands.run import run
from robot.commands.soak import soak
from robot.commands.spray import spray
from robot.commands.status import status
from robot.commands.trace import trace
from robot.logs import set_up_logs
from robot.runtime.signals import STOPPING

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, help=__doc__)
app.command()(run)
app.command()(demo)
app.command()(doctor)
app.command()(emulate)
app.command()(detect)
app.command()(report)
app.command()(status)
order.add_to(app)
app.command()(release)
app.add_typer(arm, name="arm")
app.add_typer(calibrate, name="calibrate")
app.add_typer(config, name="config")
app.add_typer(gps, name="gps")
app.add_typer(jog, name="jog")
app.command()(soak)
app.command()(spray)
app.command()(trace)
app.command()(alloff_file)
app.command()(install)
arm.command("home")(home)
calibrate.command("check")(calibrate_check)
calibrate.command("flow")(calibrate_flow)
calibrate.command("hand-eye")(calibrate_hand_eye)


def main() -> None:
    """Run a command. Errors become one line on stderr and the exit code of their kind (docs/exit-codes.md)."""
    set_up_logs()
    code = exit_code(app, sys.argv[1:])
    for number in STOPPING:
        signal.signal(number, signal.SIG_IGN)  # all is done: a late signal does not change the outcome
    sys.exit(code)


def run_command(arguments: list[str]) -> int:
    """The exit code of a command line, for callers in the same process: signals are handled as before afterwards."""
    former = {number: signal.getsignal(number) for number in STOPPING}
    try:
        return exit_code(app, arguments)
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
