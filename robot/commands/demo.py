"""``sprayer demo``: one simulated row from the first command to a report to look at."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

