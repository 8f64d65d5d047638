"""The row as discs to scale, and the doses as bars: plain figures for the template to draw as SVG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from drivers.twin.truth_record import TrueFruit
from robot.ledger import ShotRow, StopRow
from robot.report.score import Judgement
from robot.targets import Target

PIXELS_A_METRE = 240.0
_MARGIN_M = 0.12
_LEAST_LABEL_R_PX = 7.0
_LABEL_WIDTH_PX, _LABEL_HEIGHT_PX = 19.0, 9.0


@dataclass(frozen=True, slots=True)
class Disc:
    """A fruit in SVG units; ``fate`` is its style, ``label`` its dose in ml, ``title`` the tool tip."""

    cx: float
    cy: float
    r: float
    fate: str
    label: str
    title: str


@dataclass(frozen=True, slots=True)
class Tick:
    x: float
    label: str


@dataclass(frozen=True, slots=True)
class RowView:
    """One projection of the row, in SVG units (y down). ``ground_y`` is the lane's centre or the soil."""

    width: float
    height: float
    ground_y: float
    discs: tuple[Disc, ...]
    outlines: tuple[Disc, ...]
    stops: tuple[Tick, ...]
    metres: tuple[Tick, ...]


@dataclass(frozen=True, slots=True)
class Bar:
    """One pulse: heights in SVG units by kind (planned, commanded, booked, measured, delivered), None when unknown."""

    label: str
    heights: Mapping[str, float]
    title: str


@dataclass(frozen=True, slots=True)
class DoseChart:
    width: float
    height: float
    group_width: float
    bars: tuple[Bar, ...]
    kinds: tuple[str, ...]
    grid: tuple[Tick, ...]


def row_view(
    axis: int,
    targets: Sequence[Target],
    stops: Sequence[StopRow],
    booked_ml: Mapping[int, float],
    truth: Sequence[TrueFruit],
    judgement: Judgement | None,
) -> RowView:
    """The row seen from above (``axis`` 1: y) or from the lane (``axis`` 2: z). Fruits far behind come first."""
    along = [float(t.centre_m[0]) for t in targets] + [f.centre_m[0] for f in truth] + [s.record.x_m for s in stops]
    across = [float(t.centre_m[axis]) for t in targets] + [f.centre_m[axis] for f in truth] + [0.0]
    left_m, right_m = min([*along, 0.0]) - _MARGIN_M, max([*along, 1.0]) + _MARGIN_M
    low_m, high_m = min(across) - _MARGIN_M, max([*across, 0.5]) + _MARGIN_M

    def u(x_m: float) -> float:
        return round((x_m - left_m) * PIXELS_A_METRE, 1)

    def v(height_m: float) -> float:
        return round((high_m - height_m) * PIXELS_A_METRE, 1)

    def depth(target: Target) -> float:
        return -abs(float(target.centre_m[1])) if axis == 2 else float(target.centre_m[2])

    discs = tuple(
        _disc(target, u(float(target.centre_m[0])), v(float(target.centre_m[axis])), booked_ml.get(target.id, 0.0))
        for target in sorted(targets, key=depth)
    )
    discs = _without_clashing_labels(discs)
    found = set() if judgement is None else set(judgement.fruit_of.values())
    outlines = tuple(
        Disc(
            cx=u(fruit.centre_m[0]),
            cy=v(fruit.centre_m[axis]),
            r=_radius(fruit.diameter_m),
            fate="known" if fruit.id in found else "missed",
            label="",
            title=f"true fruit {fruit.id}: {1e3 * fruit.diameter_m:.0f} mm, {fruit.ripeness}"
            + ("" if judgement is None else f", {100 * judgement.visible.get(fruit.id, 0.0):.0f} % visible at best")
            + ("" if fruit.id in found else "; not found"),
        )
        for fruit in truth
    )
    return RowView(
        width=u(right_m),
        height=v(low_m),
        ground_y=v(0.0),
        discs=discs,
        outlines=outlines,
        stops=tuple(Tick(u(stop.record.x_m), str(stop.record.stop)) for stop in stops),
        metres=tuple(Tick(u(0.5 * n), f"{0.5 * n:.1f}") for n in range(int(right_m / 0.5) + 1)),
    )


def dose_chart(shots: Sequence[ShotRow], delivered_ml: Mapping[int, float]) -> DoseChart:
    """Bars of every pulse; the due dose stands at a target's first pulse."""
    values = [_doses(shot, delivered_ml) for shot in shots]
    kinds = tuple(
        kind for kind in ("due", "commanded", "booked", "measured", "delivered") if any(kind in v for v in values)
    )
    top_ml = max([1.0, *(ml for value in values for ml in value.values())])
    step_ml = next(step for step in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 1e4) if top_ml / step <= 6)
    height, group = 220.0, 12.0 * len(kinds) + 14.0
    bars = tuple(
        Bar(
            label=str(shot.intent.target_id),
            heights={kind: round(height * ml / top_ml, 1) for kind, ml in value.items()},
            title=f"target {shot.intent.target_id}: " + ", ".join(f"{kind} {ml:.2f} ml" for kind, ml in value.items()),
        )
        for shot, value in zip(shots, values, strict=True)
    )
    grid = tuple(
        Tick(round(height * (1.0 - n * step_ml / top_ml), 1), f"{n * step_ml:g}")
        for n in range(int(top_ml / step_ml) + 1)
    )
    return DoseChart(max(200.0, group * len(bars)), height, group, bars, kinds, grid)


def _doses(shot: ShotRow, delivered_ml: Mapping[int, float]) -> dict[str, float]:
    out = {"due": shot.intent.due_ml} if shot.intent.pulse <= 1 else {}
    out["commanded"] = shot.intent.dose_ml
    if shot.result is not None:
        out["booked"] = shot.result.booked_ml
        if shot.result.measured_ml is not None:
            out["measured"] = shot.result.measured_ml
    if shot.intent_id in delivered_ml:
        out["delivered"] = delivered_ml[shot.intent_id]
    return out


def _disc(target: Target, cx: float, cy: float, booked_ml: float) -> Disc:
    radius = _radius(target.diameter_m)
    title = (
        f"target {target.id}: {'' if target.measured else '~'}{1e3 * target.diameter_m:.0f} mm, "
        f"{target.ripeness.value}, {target.state.value}"
        + (f", {booked_ml:.1f} ml" if booked_ml else "")
        + (f" ({target.reason})" if target.reason else "")
    )
    label = f"{booked_ml:.1f}" if booked_ml and radius >= _LEAST_LABEL_R_PX else ""
    return Disc(cx, cy, radius, target.state.value, label, title)


def _without_clashing_labels(discs: Sequence[Disc]) -> tuple[Disc, ...]:
    """Front discs keep their label; those whose label would lie under it lose theirs (the tool tip still tells)."""
    kept: list[Disc] = []
    for disc in reversed(discs):
        clash = any(
            other.label and abs(other.cx - disc.cx) < _LABEL_WIDTH_PX and abs(other.cy - disc.cy) < _LABEL_HEIGHT_PX
            for other in kept
        )
        kept.append(replace(disc, label="") if clash else disc)
    return tuple(reversed(kept))


def _radius(diameter_m: float) -> float:
    return round(0.5 * diameter_m * PIXELS_A_METRE, 1)
