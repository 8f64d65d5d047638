"""What dosing plans."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Shot:
    """What one fruit is to get: ``dose_ml`` in all, by valve openings of ``open_s`` seconds each (one entry a pulse).

    ``open_s`` is the time the coil is on, valve latencies already in it. ``due_ml`` is what the dose law alone asks;
    ``limit`` names the minimum or cap that changed it, "" when none did.
    """

    due_ml: float
    dose_ml: float
    open_s: tuple[float, ...]
    limit: str


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a fruit gets no dose."""

    reason: str
