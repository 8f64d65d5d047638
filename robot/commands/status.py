"""``sprayer status``: how the robot on this machine is, for a person or as JSON."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping
from typing import Annotated, Any

import typer
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from robot.client import ask
from robot.commands.order import ConfigOption, NotDone, SocketOption, socket_of

EVERY_S = 1.0
_STYLES = {"ready": "green", "starting": "yellow", "degraded": "yellow", "failed": "red", "stopped": "dim"}
_MODES = {"safe_stop": "bold red", "estop": "bold red", "paused": "bold yellow", "auto": "bold green"}


def status(
    socket: SocketOption = None,
    config: ConfigOption = None,
    watch: Annotated[bool, typer.Option("--watch", help="Show it anew every second, until Ctrl-C.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="As the robot answers it, in JSON.")] = False,
) -> int:
    """Mode, causes, faults, mission, tank, and every task with its owner, rate, state and last error."""
    place = socket_of(socket, config)

    def answer() -> Mapping[str, Any]:
        answered = ask(place, "GET", "/v1/status")
        if not answered.ok:
            raise NotDone(f"status: {answered.error}")
        return answered.body

    console = Console()
    if watch and not as_json and console.is_terminal:
        with Live(page(answer()), console=console, refresh_per_second=4) as live:
            while True:
                time.sleep(EVERY_S)
                live.update(page(answer()))
    while True:
        now = answer()
        if as_json:
            sys.stdout.write(json.dumps(now, indent=None if watch else 2) + "\n")
        else:
            console.print(page(now), soft_wrap=True)
        if not watch:
            return 0
        sys.stdout.flush()
        time.sleep(EVERY_S)


def page(now: Mapping[str, Any]) -> RenderableType:
    """Everything on one screen."""
    now_s = float(now["now_s"])
    head = Table.grid(padding=(0, 2))
    mode = str(now["mode"])
    since = f"for {_ago(now_s, now['mode_since_s'])}"
    head.add_row(Text(str(now["robot"])), _text(mode.upper(), _MODES.get(mode, "bold")), since)
    lines: list[RenderableType] = [head]
    lines += [_text(f"cause: {cause}", "red") for cause in now["causes"]]
    for fault in now["faults"]:
        lines.append(_text(f"fault {fault['fault']}: {fault['text']} (for {_ago(now_s, fault['since_s'])})", "yellow"))
    lines += [_text(line) for line in (_mission(now["mission"], now_s), *_liquid(now))]
    if now["unhealthy"]:
        lines.append(_text(f"unhealthy: {now['unhealthy']}", "red"))
    return Group(*lines, _tree(now["tasks"], now_s))


def _mission(mission: Mapping[str, Any], now_s: float) -> str:
    fates = ", ".join(f"{count} {fate}" for fate, count in mission["targets"].items()) or "none yet"
    return (
        f"mission: {mission['state']} for {_ago(now_s, mission['since_s'])} ({mission['reason']}), "
        f"stop {mission['stop']} of {mission['stops']}; targets: {fates}"
    )


def _liquid(now: Mapping[str, Any]) -> tuple[str, ...]:
    ledger = now["ledger"]
    if ledger is None:
        return ("no task yet",)
    pending = f", {ledger['pending_ml']:.1f} ml under way" if ledger["pending_ml"] else ""
    tank = "" if now["tank_left_ml"] is None else f", {now['tank_left_ml']:.0f} ml left in the tank"
    return (f"task {ledger['task']}: {ledger['shots']} shots, {ledger['booked_ml']:.1f} ml booked{pending}{tank}",)


def _tree(tasks: list[Mapping[str, Any]], now_s: float) -> Table:
    """Tasks by owner."""
    table = Table(box=None, pad_edge=False, header_style="dim")
    for title in ("owner", "task", "state", "for", "rate", "expected", "last error"):
        table.add_column(title, overflow="fold")
    owners = list(dict.fromkeys(task["owner"] for task in tasks))
    for owner in owners:
        shown = owner
        for task in (each for each in tasks if each["owner"] == owner):
            error = f"{task['last_error']} ({_ago(now_s, task['error_s'])} ago)" if task["last_error"] else ""
            table.add_row(
                shown, task["name"], _text(task["state"], _STYLES.get(task["state"], "")),
                _ago(now_s, task["since_s"]), _hertz(task["measured_hz"]), _hertz(task["expected_hz"]), Text(error),
            )  # fmt: skip
            shown = ""
    return table


def _hertz(value: float) -> str:
    return f"{value:.1f}/s" if value else "-"


def _ago(now_s: float, then_s: float) -> str:
    seconds = max(0.0, now_s - then_s)
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    return f"{seconds / 60.0:.1f} min" if seconds < 3600.0 else f"{seconds / 3600.0:.1f} h"


def _text(text: str, style: str = "") -> Text:
    return Text(text, style=style)
