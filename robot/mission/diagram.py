"""The state diagram of docs/mission.md, drawn from the transition table: ``python -m robot.mission.diagram``."""

from __future__ import annotations

import sys

from robot.mission.transitions import TRANSITIONS, Event, State


def mermaid() -> str:
    """The table as a Mermaid state diagram; HALTED leads every working state to IDLE and is drawn once."""
    lines = ["stateDiagram-v2", f"    [*] --> {State.IDLE}"]
    lines += [
        f"    {source} --> {target}: {event}"
        for (source, event), target in TRANSITIONS.items()
        if event is not Event.HALTED
    ]
    halted = ", ".join(str(source) for source, event in TRANSITIONS if event is Event.HALTED)
    lines += [f"    {State.DONE} --> [*]", f"    note right of {State.IDLE}: halted leads here from {halted}"]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.stdout.write(mermaid() + "\n")
