"""Files that travel with the program: configurations, arm descriptions, calibrations, routes, units."""

from __future__ import annotations

from pathlib import Path

from robot.errors import ConfigError


def packaged(folder: str) -> Path:
    """The folder ``configs`` or ``systemd`` as it came with the program (installed wheel, else source tree)."""
    here = Path(__file__).resolve().parent
    installed = here / "package_data" / folder
    return installed if installed.is_dir() else here.parent / folder


def config_file(path: Path) -> Path:
    """The configuration a person means: a path as given, else the name of one that came with the program."""
    if path.exists():
        return path
    shipped = packaged("configs")
    parts = path.parts[1:] if path.parts[:1] == ("configs",) else path.parts
    candidate = shipped.joinpath(*parts)
    if not path.is_absolute() and candidate.exists():
        return candidate
    names = ", ".join(sorted(item.name for item in shipped.glob("*.toml")))
    raise ConfigError(f"{path}: no such configuration file; give a path, or one that came with the program: {names}")


def named_file(name: str, config_path: Path) -> Path:
    """A file that a configuration names: beside the configuration, else among those that came with the program."""
    beside = config_path.resolve().parent / name
    if beside.exists():
        return beside
    shipped = packaged("configs") / name
    if not Path(name).is_absolute() and shipped.exists():
        return shipped
    raise ConfigError(
        f"{config_path}: names '{name}', which is neither at {beside} nor among the files that came with the program"
    )
