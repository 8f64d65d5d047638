"""Hold-to-run by hand: at most one lease, alive as long as its holder gives signs of life."""

from __future__ import annotations

from dataclasses import replace

from robot.safety.timing import LEASE_FREED_S, LEASE_LOST_S
from robot.safety.values import Decision, Lease, SafetyState


def take_lease(
    state: SafetyState, holder: str, now_s: float, take_over: bool = False
) -> tuple[SafetyState, Decision]:
    """Refused while another holds it, unless that one has been silent for ``LEASE_FREED_S`` or ``take_over`` is said.

    The caller stops all motion by hand when the holder changes.
    """
    lease = state.lease
    if lease is not None and lease.holder != holder and not take_over and now_s - lease.beat_s <= LEASE_FREED_S:
        return state, Decision((f"'{lease.holder}' holds the controls; take over explicitly, or wait",))
    since_s = lease.since_s if lease is not None and lease.holder == holder else now_s
    return replace(state, lease=Lease(holder, since_s, now_s)), Decision(())


def beat_lease(state: SafetyState, holder: str, now_s: float) -> tuple[SafetyState, Decision]:
    """A sign of life of the holder; refused to everybody else."""
    reasons = holder_reasons(state, holder)
    if reasons:
        return state, Decision(reasons)
    assert state.lease is not None  # or there had been a reason
    return replace(state, lease=replace(state.lease, beat_s=now_s)), Decision(())


def release_lease(state: SafetyState, holder: str) -> SafetyState:
    """Nothing changes when somebody else holds it."""
    return state if holder_reasons(state, holder) else replace(state, lease=None)


def holder_reasons(state: SafetyState, holder: str) -> tuple[str, ...]:
    """Why ``holder`` may not move the machine by hand; () for the holder of the lease."""
    if state.lease is None:
        return ("nobody holds the controls; take them first",)
    if state.lease.holder != holder:
        return (f"'{state.lease.holder}' holds the controls",)
    return ()


def lease_reasons(state: SafetyState, now_s: float) -> tuple[str, ...]:
    """Why nothing may move by hand now; () while a living holder has the lease."""
    if state.lease is None:
        return ("nobody holds the controls; take them first",)
    silent_s = now_s - state.lease.beat_s
    if not -1e-6 <= silent_s <= LEASE_LOST_S:
        return (f"'{state.lease.holder}' has given no sign of life for {silent_s:.2f} s (limit {LEASE_LOST_S} s)",)
    return ()
