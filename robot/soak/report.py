"""What a soak found, for a person."""

from __future__ import annotations

from robot.soak.soak import HOUR_S, SoakResult
from robot.soak.values import Violation

SHOWN_BEFORE = 25


def as_text(result: SoakResult) -> str:
    """The whole report, many lines."""
    tally, memory = result.tally, result.memory
    hours, up_h = tally.simulated_s / HOUR_S, tally.running_s / HOUR_S
    slope = memory.slope_mib_h
    lines = [
        f"simulated        {hours:.2f} h (program up {up_h:.2f} h) in {tally.real_s:.0f} s, "
        f"{tally.simulated_s / max(tally.real_s, 1e-9):.0f} x life (while up {_rate(tally.running_s, tally.real_s)})",
        f"rows             {tally.rows_done} done, {tally.rows_left} left undone",
        f"shots            {tally.shots}",
        f"liquid           {result.booked_ml:.1f} ml booked, {result.true_ml:.1f} ml left the nozzle "
        f"({result.disobeyed_ml:.1f} ml of it past a valve or contact that did not obey)",
        f"lives            {tally.lives}: {_counts(tally.endings)}",
        f"went wrong       {sum(tally.happened.values())}: {_counts(tally.happened)}",
        f"worst stop       {1e3 * result.worst_stop_s:.0f} ms from the decision to the valve shut (relay line sound)",
        f"worst e-stop     {1e3 * result.worst_estop_s:.0f} ms from the button to the latch (inputs sound)",
        "memory           "
        + ("too short to tell its slope" if slope is None else f"{slope:+.3f} MiB/h of simulated time")
        + "; "
        + ", ".join(f"{mib:.0f} MiB at {h:.1f} h" for h, mib in memory.curve()),
        f"held             {' '.join(result.held)}",
        f"violated         {' '.join(item.property for item in result.violations) or 'none'}",
    ]
    for violation in result.violations:
        lines += _told(violation, result)
    return "\n".join(lines)


def _rate(simulated_s: float, real_s: float) -> str:
    return f"{simulated_s / max(real_s, 1e-9):.0f} x"


def _counts(counter: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in sorted(counter.items(), key=lambda item: -item[1])) or "none"


def _told(violation: Violation, result: SoakResult) -> list[str]:
    times = result.times_broken[violation.property]
    head = (
        f"VIOLATED {violation.property} ({times} times; first at {violation.t_s:.3f} s, life {violation.life}, "
        f"seed {result.options.seed}): {violation.text}"
    )
    return ["", head, *(f"    {line[:200]}" for line in violation.before[-SHOWN_BEFORE:])]
