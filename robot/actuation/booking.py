"""From the flow meter's count to what the ledger books."""

from __future__ import annotations

import math

from robot.actuation.values import HandSettings, PulseOrder
from robot.dosing.flow_check import LEAST_RATIO, ShotFlow, one_shot_problem
from robot.ledger.records import MeterMark
from robot.ledger.values import Leak, Outcome, Result

WHOLE = 0.95  # an opening of this share of the order counts as whole
LEAK_PULSES = 0.5  # more of the meter's pulses than this past a shut valve: a whole one


class FlowAccount:
    """Keeps the booked sum one pulse ahead of the meter's counter and wider by its tolerance: never below the truth.

    Every count belongs to one row: that of the shot which took it, or that of a leak.
    """

    def __init__(self, settings: HandSettings) -> None:
        self._settings = settings
        self._accounted_to_ml: float | None = None  # one pulse ahead of the last count, once something was booked
        self._count_ml = 0.0
        self._count_known = False
        self._counted_s = -math.inf
        self._credit_ml = 0.0  # was booked on a shot in excess of its count, and may still come
        self._credit_until_s = -math.inf

    @property
    def booked_to_ml(self) -> float | None:
        """The meter's count up to which everything is booked; None when the last shot could not be counted."""
        return self._count_ml if self._count_known else None

    def begin(self, total_ml: float, stamp_s: float) -> None:
        """Start at the meter's present count."""
        self._accounted_to_ml = self._count_ml = total_ml
        self._counted_s, self._count_known = stamp_s, True
        self._credit_ml = 0.0

    def take(self, total_ml: float | None, stamp_s: float) -> tuple[float | None, float | None]:
        """(measured ml, ml to book) since the last take; (None, None) without a count, or when it was reset."""
        self._count_known = total_ml is not None
        if total_ml is None:
            return None, None
        before_ml, ahead_ml = self._accounted_to_ml, total_ml + self._settings.meter_ml_per_pulse
        reset = total_ml < self._count_ml
        self._accounted_to_ml, self._count_ml, self._counted_s = ahead_ml, total_ml, stamp_s
        if before_ml is None or reset:
            return None, None
        measured_ml = ahead_ml - before_ml
        return measured_ml, measured_ml * (1.0 + self._settings.meter_tolerance)

    def credit(self, ml: float, until_s: float) -> None:
        """A shot is booked with ``ml`` more than was counted of it: what the meter still counts is that, not a leak.

        ``until_s`` is when the board has shut the valve by itself; the first count after that is the last of the shot.
        """
        self._credit_ml, self._credit_until_s = max(0.0, ml), until_s

    def leaked(self, total_ml: float, stamp_s: float) -> Leak | None:
        """What passed the meter since the last take and belongs to no shot. Call it while no shot is under way.

        A reading that is older than the last take tells nothing.
        """
        if self._accounted_to_ml is None or stamp_s <= self._counted_s:
            return None
        if total_ml < self._count_ml:  # the meter was reset: what it counted before is booked
            self.begin(total_ml, stamp_s)
            return None
        leak = None
        if total_ml - self._count_ml > LEAK_PULSES * self._settings.meter_ml_per_pulse:
            measured_ml, upper_ml = self.take(total_ml, stamp_s)
            assert measured_ml is not None
            assert upper_ml is not None
            covered_ml = min(upper_ml, self._credit_ml)
            self._credit_ml -= covered_ml
            if upper_ml > covered_ml:
                share = 1.0 - covered_ml / upper_ml
                leak = Leak(upper_ml - covered_ml, share * measured_ml, "flow past the shut valve", stamp_s)
        if stamp_s > self._credit_until_s:
            self._credit_ml = 0.0
        return leak


def missed(mark: MeterMark, total_ml: float, stamp_s: float, settings: HandSettings) -> Leak | None:
    """What passed the meter since the last run, beyond what that run's shots without a count were booked with.

    None also when the counter went back (it had lost its power), or on by more than a tank holds (another meter).
    """
    passed_ml = total_ml - mark.count_ml
    upper_ml = (passed_ml + settings.meter_ml_per_pulse) * (1.0 + settings.meter_tolerance)
    if passed_ml <= LEAK_PULSES * settings.meter_ml_per_pulse or not mark.covered_ml < upper_ml <= settings.tank_ml:
        return None
    share = 1.0 - mark.covered_ml / upper_ml
    return Leak(share * upper_ml, share * passed_ml, "flow while the program was not running", stamp_s)


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
    flow = ShotFlow(order.model_ml, measured_ml)
    reason = one_shot_problem((flow,), settings.meter_ml_per_pulse)
    if reason and flow.ratio < LEAST_RATIO:
        return Result(Outcome.UNCERTAIN, max(order.full_ml, upper_ml), open_s, measured_ml, reason, now_s)
    return Result(Outcome.SPRAYED, upper_ml, open_s, measured_ml, reason, now_s)
