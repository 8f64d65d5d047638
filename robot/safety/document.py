"""The tables of docs/safety.md, from the catalogue and the modes: ``python -m robot.safety.document``."""

from __future__ import annotations

import sys

from robot.safety import timing
from robot.safety.catalogue import CATALOGUE, Action, FaultKind, Proof
from robot.safety.modes import MODE_CHANGES
from robot.safety.values import Mode

_PROOFS = {Proof.SIMULATED: "test", Proof.CARD: "card", Proof.FACES: "later"}
_UNITS = (("_m_s", "m/s"), ("_rad", "rad"), ("_s", "s"), ("_m", "m"))


def fault_table() -> str:
    """One row a fault, most severe action in words."""
    lines = [
        "| No. | Fault | Noticed by | Within | Action | Ends when | Not lost | Shown by |",
        "|---|---|---|---|---|---|---|---|",
    ]
    return "\n".join([*lines, *(_row(kind) for kind in CATALOGUE)])


def mode_table() -> str:
    """What each verb makes of each mode."""
    lines = ["| Mode | Verb | Mode after |", "|---|---|---|"]
    lines += [f"| {mode} | {verb} | {after} |" for (mode, verb), after in MODE_CHANGES.items()]
    lines += ["| every mode | estop | estop |", "| every mode but estop | stop | safe_stop |"]
    latched = " and ".join((str(Mode.SAFE_STOP), str(Mode.ESTOP)))
    return "\n".join([*lines, f"| every mode but {latched} | disarm | disarmed |"])


def timing_table() -> str:
    """Deadlines and thresholds of ``robot/safety/timing.py``."""
    lines = ["| Name | Value |", "|---|---|"]
    for name in sorted(name for name in vars(timing) if name.isupper()):
        value = getattr(timing, name)
        unit = next((unit for ending, unit in _UNITS if name.lower().endswith(ending)), "")
        lines.append(f"| `{name}` | {f'{value:.3g} {unit}'.strip()} |")
    return "\n".join(lines)


def _row(kind: FaultKind) -> str:
    action = Action(kind.action).name.lower().replace("_", " ")
    cells = (
        kind.id, kind.title, kind.detected_by, f"{kind.within_s:g} s", action, str(kind.clears), kind.kept,
        _PROOFS[kind.proof],
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


TABLES = {"faults": fault_table, "modes": mode_table, "timing": timing_table}


def filled(text: str) -> str:
    """A document with the part between each ``<!-- name -->`` and ``<!-- end -->`` written anew."""
    for name, table in TABLES.items():
        before, rest = text.split(f"<!-- {name} -->\n", 1)
        _, after = rest.split("<!-- end -->", 1)
        text = f"{before}<!-- {name} -->\n{table()}\n<!-- end -->{after}"
    return text


if __name__ == "__main__":
    sys.stdout.write(filled(sys.stdin.read()))
