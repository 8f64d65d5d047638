"""The result as rows of label and value, for the terminal and the page."""

from __future__ import annotations

from robot.ledger import StopLight
from robot.report.evidence import Evidence
from robot.report.kinds import Kind, kinds
from robot.report.score import Score, seconds_a_target, skipped_by_reason
from robot.targets import TargetState
from robot.vision.light import trusted

Row = tuple[str, str]


def score_rows(score: Score) -> tuple[Row, ...]:
    """The result of a simulated row."""
    rows = [
        ("Fruits in the row", str(score.fruits)),
        ("clearly visible from a stop", str(score.visible)),
    ]
    if score.reachable is not None:
        rows.append(("reachable from a stop", str(score.reachable)))
    partly = score.treated is not None and score.treated < score.fruits
    if partly:
        rows.append(("of a ripeness that is treated", str(score.treated)))
    wanted = "visible" if score.reachable is None else "visible and reachable"
    wanted += ", to be treated" if partly else ""
    rows += [
        ("seen", str(score.seen)),
        ("sprayed", str(score.sprayed)),
        (f"sprayed of those {wanted}", f"{score.sprayed_of_wanted} of {score.wanted}" + _in(score.wanted_percent)),
        *((("sprayed though not to be treated", str(score.sprayed_untreated)),) if partly else ()),
        ("sprayed twice", str(score.sprayed_twice)),
        ("Phantoms", f"{score.phantoms} of {score.targets_sprayed} targets sprayed"),
        *((f"skipped, {reason}", str(count)) for reason, count in score.skipped.items()),
        ("Liquid on the fruit", figure(score.on_fruit_percent, "%")),
        ("Seconds a target", figure(score.seconds_a_target, "s")),
        ("Delivered against commanded, median", figure(score.delivered_vs_commanded_median_percent, "%")),
        ("Delivered against commanded, 95th percentile", figure(score.delivered_vs_commanded_p95_percent, "%")),
        ("Delivered against due of the true fruit, median", figure(score.delivered_vs_due_median_percent, "%")),
        ("Position error, median", figure(score.position_error_median_mm, "mm")),
        ("Position error, 95th percentile", figure(score.position_error_p95_mm, "mm")),
        ("Booked", f"{score.booked_ml:.1f} ml"),
        ("Delivered (truth)", f"{score.delivered_ml:.1f} ml"),
    ]
    return tuple(rows)


def ledger_rows(evidence: Evidence) -> tuple[Row, ...]:
    """The result as far as the robot itself knows it."""
    states = [target.state for target in evidence.targets]
    sprayed = sum(state in (TargetState.SPRAYED, TargetState.UNCERTAIN) for state in states)
    totals = evidence.totals
    measured = [
        s.result.measured_ml for s in evidence.shots if s.result is not None and s.result.measured_ml is not None
    ]
    return (
        ("Targets found", str(len(states))),
        ("sprayed", str(states.count(TargetState.SPRAYED))),
        ("uncertain (booked in full)", str(states.count(TargetState.UNCERTAIN))),
        *((f"skipped, {reason}", str(count)) for reason, count in skipped_by_reason(evidence.targets).items()),
        ("Seconds a target", figure(seconds_a_target(evidence, sprayed), "s")),
        ("Booked", f"{totals.booked_ml:.1f} ml"),
        ("Pending (valve may be open)", f"{totals.pending_ml:.1f} ml"),
        ("Measured by the flow meter", f"{totals.measured_ml:.1f} ml" if measured else "no flow meter"),
    )


def kind_rows(evidence: Evidence) -> tuple[Row, ...]:
    """One row a ripeness: how many were sprayed, with how much, and by which factor."""
    return tuple((f"{kind.ripeness.value.capitalize()} fruit", _kind(kind)) for kind in kinds(evidence))


def _kind(kind: Kind) -> str:
    parts = [f"{kind.sprayed} of {kind.found} sprayed"]
    if kind.sprayed:
        parts.append(f"{kind.booked_ml:.1f} ml")
    if kind.ml_per_cm3 is not None:
        parts.append(f"{kind.ml_per_cm3:.4f} ml/cm3")
    if kind.factors is not None:
        parts.append("factor " + " to ".join(dict.fromkeys(f"{factor:.2f}" for factor in kind.factors)))
    if kind.hidden:
        parts.append(f"{kind.hidden} too hidden to measure")
    return ", ".join(parts)


def figure(value: float | None, unit: str) -> str:
    """One decimal and the unit, or a dash."""
    return "–" if value is None else f"{value:.1f} {unit}"


def _in(percent: float | None) -> str:
    return "" if percent is None else f" ({percent:.0f} %)"


def light_rows(evidence: Evidence) -> tuple[Row, ...]:
    """In what light the row was looked at, and at how many stops it could not be trusted."""
    lights = [stop.record.light for stop in evidence.stops if stop.record.light is not None]
    if not lights:
        return ()
    states = ", ".join(
        f"{state.value} {sum(light.state is state for light in lights)}"
        for state in dict.fromkeys(light.state for light in lights)
    )
    levels = [100.0 * light.plant_level for light in lights]
    rows = [
        ("Light at the stops", states),
        ("plants, of full scale", f"{min(levels):.1f} to {max(levels):.1f} %"),
        ("lamp lit at", f"{sum(light.lamp for light in lights)} of {len(lights)}"),
    ]
    if left_out := sum(not trusted(light.state) for light in lights):
        rows.append(("not looked for fruit, light not to be trusted", f"{left_out} of {len(lights)}"))
    return tuple(rows)


def light_words(light: StopLight) -> str:
    """The light of a stop in one line."""
    lamp = "lit" if light.lamp else "off"
    words = (
        f"{light.state}: plants {100.0 * light.plant_level:.1f} %, {1e3 * light.exposure_s:.1f} ms, "
        f"gain {light.gain:.1f}, lamp {lamp}"
    )
    return words + (f" ({light.remark})" if light.remark else "")
