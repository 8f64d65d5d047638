"""Orders to the robot that runs on this machine: ``sprayer stop``, ``arm``, ``start`` and the others."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from robot.client import Answer, ask, find_socket, socket_path
from robot.commands.terminal import Answers
from robot.errors import SprayerError, UsageError

SERVICE_SOCKET = Path("/run/sprayer/control.sock")

SocketOption = Annotated[
    Path | None, typer.Option("--socket", help="The robot's control socket, where it is not the service's.")
]
ConfigOption = Annotated[
    Path | None, typer.Option("--config", help="The robot's configuration, to find its socket in its run directory.")
]


class NotDone(SprayerError):
    """The robot answered, and does not do it now."""


def socket_of(socket: Path | None, config: Path | None) -> Path:
    """Where the robot answers: at the socket that is named, or else in its run directory, or as the service."""
    if socket is not None:
        return find_socket((socket,))
    places = []
    if config is not None:
        from robot.config import load_config  # takes longer to load than a stop may take

        places.append(socket_path(load_config(config).robot.run_directory, {}))
    if os.environ.get("RUNTIME_DIRECTORY"):
        places.append(socket_path(Path(), os.environ))
    return find_socket((*places, SERVICE_SOCKET))


def order(place: Path, verb: str, **values: str | float) -> Answer:
    """Give one order. ``NotDone`` with the robot's reasons when it does not do it."""
    answer = ask(place, "POST", f"/v1/{verb}", values)
    if not answer.ok:
        raise NotDone(f"{verb}: {answer.error}")
    return answer


def stop(socket: SocketOption = None, config: ConfigOption = None) -> int:
    """Stop the robot at once, in whatever mode it is. It stays stopped until somebody acknowledges."""
    answer = order(socket_of(socket, config), "stop", cause="STOP at the command line")
    parts: list[dict[str, Any]] = answer.body["parts"]
    for part in parts:
        sys.stdout.write(f"{part['part']}: {part['error'] or 'stopped'}\n")
    return 1 if any(part["error"] for part in parts) else 0


def start(
    socket: SocketOption = None,
    config: ConfigOption = None,
    new: Annotated[bool, typer.Option("--new", help="A new task, though one is unfinished.")] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the unfinished task, or fail.")] = False,
    confirm: Annotated[str, typer.Option("--confirm", help="The token of a plan that was shown before.")] = "",
) -> int:
    """Show what a start would do, and do it after a yes; without a terminal, with --confirm in a second call."""
    if new + resume + bool(confirm) > 1:
        raise UsageError("--new, --resume and --confirm exclude each other; give one of them, or none")
    place = socket_of(socket, config)
    if not confirm:
        planned = order(place, "start", task="new" if new else "resume" if resume else "auto").body
        sys.stdout.write(f"{planned['plan']['summary']}\n")
        answers = Answers()
        if not answers.from_terminal:
            sys.stdout.write(f"to start it, within {planned['expires_s']:.0f} s: --confirm {planned['token']}\n")
            return 0
        if answers.ask_at_once("Type 'spray' to start: ") != "spray":
            raise UsageError("not confirmed; nothing was started")
        confirm = planned["token"]
    started = order(place, "start", confirm=confirm, cause="start at the command line").body
    sys.stdout.write(f"task {started['task']} started\n")
    return 0


def refill(
    tank_ml: Annotated[float, typer.Argument(metavar="ML", help="What the tank holds now, in millilitres.")],
    socket: SocketOption = None,
    config: ConfigOption = None,
) -> int:
    """The tank was filled: a pause because it ran low ends by itself, and the row goes on."""
    body = order(socket_of(socket, config), "refill", tank_ml=tank_ml, cause="refill at the command line").body
    sys.stdout.write(f"{body['tank_ml']:g} ml in the tank, {body['mode']}\n")
    return 0


def verb(name: str, help_text: str) -> Callable[..., int]:
    """A command that gives one order and says the mode that followed."""

    def give(socket: SocketOption = None, config: ConfigOption = None) -> int:
        body = order(socket_of(socket, config), name, cause=f"{name} at the command line").body
        sys.stdout.write(f"{body['mode']}\n")
        return 0

    give.__doc__ = help_text
    return give


VERBS = {
    "pause": "Valve shut, base halted, arm held, until somebody resumes.",
    "resume": "Go on after a pause.",
    "acknowledge": "The cause of a stop was seen to: disarmed again.",
    "reset": "After an emergency stop, with the button released: disarmed again.",
    "disarm": "Halt, every output off.",
}


def add_to(app: typer.Typer) -> None:
    """Every order but ``arm``, which the servos' commands hold, and ``status``."""
    app.command()(stop)
    app.command()(start)
    app.command()(refill)
    for name, help_text in VERBS.items():
        app.command(name)(verb(name, help_text))
