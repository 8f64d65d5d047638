"""What dosing plans."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Due:
    """What the rules ask for one fruit. The ``factor`` of its ripeness is already in ``ml``; ``basis`` says from what
    the dose was reckoned where that is not the measured size, "" where it is.
    """

    ml: float
    factor: float = 1.0
    basis: str = ""


@dataclass(frozen=True, slots=True)
class Shot:
    """What one fruit is to get: ``dose_ml`` in all, by valve openings of ``open_s`` seconds each (one entry a pulse).

    ``open_s`` is the time the coil is on, valve latencies already in it. ``due_ml`` is what the rules alone ask;
    ``limit`` names the minimum or cap that changed it, "" when none did. ``factor`` and ``basis`` as in ``Due``.
    """

    due_ml: float
    dose_ml: float
    open_s: tuple[float, ...]
    limit: str
    factor: float
    basis: str

    @property
    def reason(self) -> str:
        """Why the dose is not simply that of the fruit's size and ripeness, "" when it is."""
        return "; ".join(part for part in (self.basis, self.limit) if part)


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a fruit gets no dose."""

    reason: str
