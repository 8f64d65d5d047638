"""The report as one HTML file that asks for nothing from outside."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib.resources import files
from pathlib import Path

import jinja2

from drivers.twin.truth_record import TrueFruit, TruthRecord
from robot.report.drawing import dose_chart, row_view
from robot.report.evidence import Evidence
from robot.report.score import Judgement
from robot.report.table import Row, figure, kind_rows, ledger_rows, light_rows, light_words, score_rows
from robot.targets import Target, TargetState

_MIME = {b"\xff\xd8": "image/jpeg", b"\x89P": "image/png"}
FATES = (
    ("sprayed", "sprayed"),
    ("uncertain", "uncertain: booked in full, never sprayed again"),
    ("unreachable", "unreachable"),
    ("doubtful", "doubtful"),
    ("not_wanted", "not wanted"),
    ("open", "open: not treated yet"),
)


@dataclass(frozen=True, slots=True)
class Picture:
    stop: int
    caption: str
    data_uri: str


@dataclass(frozen=True, slots=True)
class Missed:
    """A fruit or target that got nothing, and why."""

    who: str
    size: str
    ripeness: str
    where: str
    why: str


def render(evidence: Evidence, truth: TruthRecord | None, judgement: Judgement | None, frames: Path | None) -> str:
    """The page as text. ``frames`` is the folder with the stops' frames; a frame that is not there is left out."""
    fruits = () if truth is None else truth.fruits
    booked_ml: dict[int, float] = {}
    for shot in evidence.shots:
        ml = shot.result.booked_ml if shot.result is not None else shot.intent.full_ml
        booked_ml[shot.intent.target_id] = booked_ml.get(shot.intent.target_id, 0.0) + ml
    delivered_ml = {} if judgement is None else dict(judgement.delivered_by_intent_ml)
    views = [row_view(axis, evidence.targets, evidence.stops, booked_ml, fruits, judgement) for axis in (1, 2)]
    return _template().render(
        task=evidence.task,
        task_rows=task_rows(evidence),
        result=_result(evidence, judgement),
        kinds=kind_rows(evidence),
        above=views[0],
        front=views[1],
        fates=[(key, text) for key, text in FATES if any(t.state.value == key for t in evidence.targets)],
        has_truth=truth is not None,
        chart=dose_chart(evidence.shots, delivered_ml) if evidence.shots else None,
        pictures=_pictures(evidence, frames),
        shots=evidence.shots,
        target_of={target.id: target for target in evidence.targets},
        size_text=size_text,
        ripeness_text=ripeness_text,
        delivered_ml=delivered_ml,
        fruit_of={} if judgement is None else {dose.target_id: dose.fruit_id for dose in judgement.doses},
        totals=evidence.totals,
        missed=_missed(evidence.targets, fruits, judgement),
        stops=evidence.stops,
        events=evidence.events,
        figure=figure,
    )


def task_rows(evidence: Evidence) -> tuple[Row, ...]:
    """Who applied what."""
    task = evidence.task
    begun = min((stop.utc for stop in evidence.stops), default=None)
    ended = max((shot.utc for shot in evidence.shots), default=None)
    return (
        ("Product", task.product + (" (water only: a test)" if task.water else "")),
        ("Registration number", task.registration_number or "–"),
        ("Dilution", f"{task.dilution_percent:g} %"),
        ("Operator", task.operator),
        ("Label cap", f"{task.label_cap_ml:.0f} ml"),
        ("Tank fill", f"{task.tank_fill_ml:.0f} ml"),
        ("Route", task.route),
        ("Begun (UTC)", _minute(begun)),
        ("Last shot (UTC)", _minute(ended)),
        ("Configuration", task.config_hash),
        ("Seed", "–" if task.seed is None else str(task.seed)),
    )


def _result(evidence: Evidence, judgement: Judgement | None) -> tuple[Row, ...]:
    rows = ledger_rows(evidence) if judgement is None else score_rows(judgement.score)
    return (*rows, *light_rows(evidence))


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(files("robot.report").joinpath("page.html.j2").read_text(encoding="utf-8"))


def _pictures(evidence: Evidence, frames: Path | None) -> tuple[Picture, ...]:
    if frames is None:
        return ()
    newest = {stop.record.stop: stop.record for stop in evidence.stops if stop.record.frame_file}
    pictures = []
    for number, record in sorted(newest.items()):
        path = frames / Path(record.frame_file).name
        if not path.is_file():
            continue
        data = path.read_bytes()
        mime = _MIME.get(data[:2])
        if mime is not None:
            uri = f"data:{mime};base64,{base64.b64encode(data).decode('ascii')}"
            caption = f"Stop {number}, x = {record.x_m:.2f} m: {record.fruits_seen} fruits seen"
            if record.light is not None:
                caption += f"; light {light_words(record.light)}"
            pictures.append(Picture(number, caption, uri))
    return tuple(pictures)


def _missed(targets: Sequence[Target], fruits: Sequence[TrueFruit], judgement: Judgement | None) -> tuple[Missed, ...]:
    left = [
        Missed(
            who=f"target {target.id}",
            size=size_text(target),
            ripeness=target.ripeness.value,
            where=_place(*target.centre_m.tolist()),
            why=target.state.value.replace("_", " ") + (f": {target.reason}" if target.reason else ""),
        )
        for target in targets
        if target.state not in (TargetState.SPRAYED, TargetState.UNCERTAIN)
    ]
    if judgement is None:
        return tuple(left)
    found = set(judgement.fruit_of.values()) | {dose.fruit_id for dose in judgement.doses}
    unseen = [
        Missed(
            who=f"true fruit {fruit.id}",
            size=f"{1e3 * fruit.diameter_m:.0f}",
            ripeness=fruit.ripeness,
            where=_place(*fruit.centre_m),
            why=f"never found; at best {100 * judgement.visible.get(fruit.id, 0.0):.0f} % visible",
        )
        for fruit in fruits
        if fruit.id not in found
    ]
    return tuple(left + unseen)


def size_text(target: Target) -> str:
    """Millimetres, after ~ when no look could measure them; a dose by hand has no fruit."""
    if target.confidence <= 0.0:
        return "–"
    return f"{'' if target.measured else '~'}{1e3 * target.diameter_m:.0f}"


def ripeness_text(target: Target) -> str:
    """Class and score; a dose by hand has neither."""
    return "–" if target.confidence <= 0.0 else f"{target.ripeness.value} {target.ripeness_score:.2f}"


def _place(x_m: float, y_m: float, z_m: float) -> str:
    return f"{x_m:.2f}, {y_m:.2f}, {z_m:.2f}"


def _minute(utc: datetime | None) -> str:
    return "–" if utc is None else utc.strftime("%Y-%m-%d %H:%M")
