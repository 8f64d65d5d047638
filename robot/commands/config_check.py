"""``sprayer config check``: loads all that a run would load, touches no device, and shows what is configured."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from robot.config import Config, load_config
from robot.errors import ConfigError
from robot.package_files import config_file
from robot.runtime.checking import Loaded, check_loadable
from robot.runtime.settings import dose_rules
from robot.vision.values import Ripeness

app = typer.Typer(help="Look after configuration files.", no_args_is_help=True)

DEVICES = ("camera", "arm", "relay", "inputs", "gps", "modem", "wheels")
_PLACES = ("port", "device", "device_id", "source")
_SIZES_MM = (40.0, 50.0, 60.0, 70.0, 80.0, 100.0, 120.0)
_HIDDEN = {
    "skip": "not sprayed",
    "minimum": "the minimum, {:g} ml",
    "estimate": "the dose of the estimated diameter less one sigma",
}
_TOLD = (
    "baud", "parity", "unit", "profile", "servos", "urdf", "calibration", "image_size_px", "rate_hz", "right_device",
    "channels", "ntrip", "storage", "radius_m", "track_m", "counts_per_turn",
)  # fmt: skip


@app.callback()
def config() -> None:
    """Look after configuration files."""


@app.command("check")
def config_check(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Configuration, or the name of one that came along.")],
) -> int:
    """Check a configuration and the files that it names. No device is opened."""
    settings = load_config(file)
    loaded, problems = check_loadable(settings, config_file(file))
    console = Console()
    console.print(_device_table(settings))
    console.print(_dose_table(settings))
    for line in _lines(settings, loaded):
        console.print(Text(line), soft_wrap=True)
    if problems:
        raise ConfigError("\n".join(problems))
    console.print(Text(f"{file}: sound"))
    return 0


def _device_table(settings: Config) -> Table:
    table = Table("device", "back end", "place", "settings", title=settings.robot.name)
    for name in DEVICES:
        section = getattr(settings, name)
        values = section.model_dump()
        place = next((str(values[key]) for key in _PLACES if values.get(key)), "")
        told = "; ".join(f"{key} {_shown(key, values[key])}" for key in _TOLD if values.get(key) is not None)
        table.add_row(name, section.backend, Text(place), Text(told))
    return table


def _dose_table(settings: Config) -> Table:
    """What fruit of each ripeness get, by size."""
    rules, targets = dose_rules(settings), settings.targets
    table = Table("fruit", title="millilitres a fruit")
    low_mm, high_mm = 1e3 * targets.min_diameter_m, 1e3 * targets.max_diameter_m
    sizes_mm = [mm for mm in _SIZES_MM if low_mm <= mm <= high_mm] or [0.5 * (low_mm + high_mm)]
    for size_mm in sizes_mm:
        table.add_column(f"{size_mm:g} mm", justify="right")
    for ripeness in Ripeness:
        if ripeness not in rules.factors.treated:
            table.add_row(f"{ripeness.value}, not treated", *("–" for _ in sizes_mm))
            continue
        doses = (rules.dose_ml(1e-3 * size_mm, ripeness) for size_mm in sizes_mm)
        table.add_row(f"{ripeness.value}, factor {rules.factors.of(ripeness):g}", *(f"{ml:.2f}" for ml in doses))
    return table


def _shown(key: str, value: Any) -> str:
    """A value in a word or two; of a caster only its address, never its password."""
    if key == "servos":
        return ", ".join(f"{joint} {'+'.join(map(str, servo['ids']))}" for joint, servo in value.items())
    if key == "channels":
        return ", ".join(f"{channel} {number}" for channel, number in value.items() if number is not None)
    if key == "ntrip":
        return f"{value['host']}:{value['port']}/{value['mountpoint']}"
    if key == "image_size_px":
        return f"{value[0]}x{value[1]}"
    return str(value)


def _lines(settings: Config, loaded: Loaded) -> list[str]:
    """What the files hold, and the caps; a file that could not be loaded has no line."""
    lines: list[str] = []
    if (arm := loaded.arm) is not None:
        lines.append(f"arm: {len(arm.joints)} joints: {', '.join(arm.joint_names)}")
    if (rig := loaded.rig) is not None:
        lines.append(f"camera: baseline {1000 * rig.baseline_m:.1f} mm")
    if (row := loaded.row) is not None:
        lines.append(f"row {row.name}: {len(row.stops)} stops, {row.length_m:g} m, {row.side}")
    safety, dosing, targets = settings.safety, settings.dosing, settings.targets
    return [
        *lines,
        f"liquid: {settings.task.product}; a dose {dosing.min_ml:g} to {dosing.max_ml:g} ml, a shot at most "
        f"{safety.max_shot_ml:g}, a target {safety.max_target_ml:g}, a minute {safety.max_minute_ml:g}, "
        f"a task {settings.task.label_cap_ml:g} ml",
        f"ripeness: turning from a score of {targets.turning_from:g}, red from {targets.red_from:g} (0 green, 1 red)",
        f"too hidden to measure: {_HIDDEN[dosing.hidden].format(dosing.min_ml)}",
        f"values: {settings.content_hash()}",
    ]
