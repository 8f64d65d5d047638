"""Runs mutmut over ``robot/safety`` and compares what its tests let live with docs/mutants.md."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

EXPLAINED = Path("docs/mutants.md")
MUTMUT = [sys.executable, "-m", "mutmut"]
SEPARATOR = "__mutmut_"


def main() -> int:
    """0 when every mutant that lives is explained."""
    shutil.rmtree("mutants", ignore_errors=True)
    subprocess.run([*MUTMUT, "run"], check=True)
    results = subprocess.run([*MUTMUT, "results", "--all", "true"], check=True, capture_output=True, text=True).stdout
    fates = dict(re.findall(r"^\s*(\S+): (.+)$", results, re.MULTILINE))
    if not fates:
        sys.stderr.write(f"mutmut told of no mutants; it said:\n{results}\n")
        return 1
    explained = EXPLAINED.read_text(encoding="utf-8")
    living = [name for name, fate in fates.items() if fate != "killed"]
    unexplained = [line for name in living if (line := told(name, fates[name])) and f"`{line}`" not in explained]
    for line in unexplained:
        sys.stdout.write(f"not explained: `{line}`\n")
    sys.stdout.write(
        f"{len(fates)} mutants, {len(fates) - len(living)} killed, {len(living) - len(unexplained)} explained, "
        f"{len(unexplained)} not explained\n"
    )
    return 1 if unexplained else 0


def told(name: str, fate: str) -> str:
    """The function and the line that was changed: what docs/mutants.md must name."""
    shown = subprocess.run([*MUTMUT, "show", name], check=True, capture_output=True, text=True).stdout
    added = [line[1:].strip() for line in shown.splitlines() if line.startswith("+") and not line.startswith("+++")]
    where = name.partition(SEPARATOR)[0].removeprefix("robot.safety.").replace(".x_", ".")
    return f"{where}: {' '.join(added)}" + ("" if fate == "survived" else f" ({fate})")


if __name__ == "__main__":
    sys.exit(main())
