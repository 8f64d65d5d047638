"""Where the command ``sprayer`` begins: an order to a running robot is given at once, everything else loads first."""

from __future__ import annotations

import sys

QUICK = ("stop", "pause", "disarm")


def main() -> None:
    """``sprayer stop`` must not wait until cameras, networks and planners are loaded."""
    if sys.argv[1:2] and sys.argv[1] in QUICK:
        import typer

        from robot.commands import order
        from robot.commands.exits import exit_code

        app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        order.add_to(app)
        sys.exit(exit_code(app, sys.argv[1:]))
    from robot.cli import main as load_everything

    load_everything()
