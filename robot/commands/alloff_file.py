"""``sprayer alloff-file``: the flat file of the all-off script, by hand; a run writes it by itself."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from robot.commands.run import ConfigOption
from robot.config import load_config
from robot.runtime.alloff_file import FILE_NAME, SOCKET_NAME, runtime_directory, write_alloff_file


def alloff_file(
    config: ConfigOption,
    out: Annotated[
        Path | None, typer.Option("--out", help="File to write; default: where a run of this configuration writes it.")
    ] = None,
) -> int:
    """Write the file from which sprayer-alloff switches everything off without the program."""
    settings = load_config(config)
    folder = runtime_directory(settings.robot.run_directory)
    path = out or folder / FILE_NAME
    write_alloff_file(settings, path, folder / SOCKET_NAME)
    sys.stdout.write(f"{path}: written; try it: sprayer-alloff --dry-run --file {path}\n")
    return 0
