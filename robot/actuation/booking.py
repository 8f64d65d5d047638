"""From the flow meter's count to what the ledger books."""

from __future__ import annotations

from robot.actuation.values import HandSettings, PulseOrder
from robot.ledger.values import Outcome, Result

WHOLE = 0.95         # an opening of this share of the order counts as whole
PLAUSIBLE_FLOW = 0.7  # below this share of the flow model, meter or nozzle is not to be trusted


class FlowAccount:
    """Keeps the booked sum one pulse ahead of the meter's counter and wider by its tolerance: never below the truth."""

    def __init__(self, settings: HandSettings) -> None:
        self._settings = settings
        self._accounted_to_ml: float | None = None

    def begin(self, total_ml: float) -> None:
        """Start at the meter's present count."""
        self._accounted_to_ml = total_ml

    def leaked_ml(self, total_ml: float) -> float:
        """What passed the meter since the last take: nothing, as long as the valve is shut and tight."""
        return 0.0 if self._accounted_to_ml is None else max(0.0, total_ml - self._accounted_to_ml)

    def take(self, total_ml: float | None) -> tuple[float | None, float | None]:
        """(measured ml, ml to book) since the last take; (None, None) without a count, or when it was reset."""
        if total_ml is None:
            return None, None
        before_ml, count_ml = self._accounted_to_ml, total_ml + self._settings.meter_ml_per_pulse
        self._accounted_to_ml = count_ml
        if before_ml is None or count_ml < before_ml:
            return None, None
        measured_ml = count_ml - before_ml
        return measured_ml, measured_ml * (1.0 + self._settings.meter_tolerance)


def outcome_of(
    order: PulseOrder, open_s: float, problem: str, why_short: str, counted: tuple[float | None, float | None],
    settings: HandSettings, now_s: float,
) -> Result:  # fmt: skip
    """How a pulse ended. What is not certain is booked as the board's full pulse.

    ``open_s`` is how long the coil was on, ``problem`` what went wrong ("" if nothing), ``why_short`` who
    would have cut it short, ``counted`` what the flow account gave.
    """
    measured_ml, upper_ml = counted
    if problem:
        return Result(Outcome.UNCERTAIN, max(order.full_ml, upper_ml or 0.0), open_s, measured_ml, problem, now_s)
    cut_short = open_s < WHOLE * order.open_s
    if measured_ml is None or upper_ml is None:
        outcome, why = (Outcome.SHORTENED, f"shortened: {why_short}; ") if cut_short else (Outcome.SPRAYED, "")
        return Result(outcome, order.full_ml, open_s, None, f"{why}no flow reading: booked the full pulse", now_s)
    if cut_short:
        return Result(Outcome.SHORTENED, upper_ml, open_s, measured_ml, f"shortened: {why_short}", now_s)
    if measured_ml < PLAUSIBLE_FLOW * order.model_ml - settings.meter_ml_per_pulse:
        reason = f"flow meter saw {measured_ml:.2f} of {order.model_ml:.2f} ml: check nozzle, filter and meter"
        return Result(Outcome.UNCERTAIN, max(order.full_ml, upper_ml), open_s, measured_ml, reason, now_s)
    return Result(Outcome.SPRAYED, upper_ml, open_s, measured_ml, "", now_s)
