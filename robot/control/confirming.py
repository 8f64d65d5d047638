"""Start in two steps: a plan is shown under a token, and only that token, soon and with nothing changed, starts it."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass, fields, replace

from robot.control.machine import Declined, Plan

TOKEN_LIVES_S = 120.0
MAY_WANDER_M = 0.2


@dataclass(frozen=True, slots=True)
class _Offer:
    plan: Plan
    until_s: float


class Offers:
    """The newest plan that was shown, good for one start; ``clock`` gives loop time."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._token = ""
        self._offer: _Offer | None = None

    def make(self, plan: Plan) -> str:
        """A token for this plan; an earlier one is good no more."""
        self._token = secrets.token_hex(8)
        self._offer = _Offer(plan, self._clock() + TOKEN_LIVES_S)
        return self._token

    def take(self, token: str) -> Plan:
        """The plan of a token, once. ``Declined`` for any other token, and for one that is too old."""
        offer = self._offer
        if offer is None or not secrets.compare_digest(token.encode(), self._token.encode()):
            raise Declined("no plan waits under this token; ask for a plan first, and confirm the newest")
        self._offer = None
        if self._clock() > offer.until_s:
            raise Declined(f"the plan is older than {TOKEN_LIVES_S:.0f} s; ask for a new one")
        return offer.plan


def changed(before: Plan, now: Plan) -> tuple[str, ...]:
    """A line for each thing that is not as it was planned. The pose may wander as it does while the rover stands."""
    if abs(now.x_m - before.x_m) <= MAY_WANDER_M:
        now = replace(now, x_m=before.x_m)
    return tuple(
        f"{field.name.replace('_', ' ')} was {getattr(before, field.name)} and is {getattr(now, field.name)} now"
        for field in fields(Plan)
        if getattr(before, field.name) != getattr(now, field.name)
    )
