"""Where the liquid went: slices of flow from a moving nozzle, summed by opening of the valve."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.twin.codec import encode
from drivers.twin.hydraulics import Flowed
from drivers.twin.spray import Deposit

Array = npt.NDArray[np.float64]

SAME_PLACE_M = 2e-4
SAME_AXIS = 5e-4


@dataclass(slots=True)
class Sums:
    """Millilitres that left the nozzle, and where they landed (fruit by id)."""

    ml: float = 0.0
    fruit_ml: dict[int, float] = field(default_factory=dict)
    leaf_ml: float = 0.0
    stem_ml: float = 0.0
    soil_ml: float = 0.0
    air_ml: float = 0.0

    def add(self, ml: float, shares: Deposit) -> None:
        """``ml`` more, spread as 1 ml is in ``shares``."""
        self.ml += ml
        for fruit, share in shares.fruit_ml.items():
            self.fruit_ml[fruit] = self.fruit_ml.get(fruit, 0.0) + ml * share
        self.leaf_ml += ml * shares.leaf_ml
        self.stem_ml += ml * shares.stem_ml
        self.soil_ml += ml * shares.soil_ml
        self.air_ml += ml * shares.air_ml


_DRIPPED = Deposit({}, 0.0, 0.0, 1.0, 0.0)


class Deposits:
    """``share_out`` gives where 1 ml goes from a nozzle's place and axis; it is asked when the nozzle has moved."""

    def __init__(self, share_out: Callable[[Array, Array], Deposit]) -> None:
        self._share_out = share_out
        self._nozzle_m, self._axis = np.full(3, np.inf), np.zeros(3)
        self._shares = _DRIPPED
        self._opened_s = 0.0
        self._opening = Sums()
        self.total = Sums()
        self.leaked_ml = 0.0

    def opened(self, t_s: float) -> None:
        """The valve opens."""
        self._opened_s, self._opening = t_s, Sums()

    def land(self, flowed: Flowed, nozzle_m: Array, axis: Array) -> None:
        """A slice of flow leaves the nozzle; what leaks through a shut valve drips to the soil."""
        if flowed.leaked:
            self.leaked_ml += flowed.ml
            self.total.add(flowed.ml, _DRIPPED)
            return
        if np.abs(nozzle_m - self._nozzle_m).max() > SAME_PLACE_M or np.abs(axis - self._axis).max() > SAME_AXIS:
            self._shares = self._share_out(nozzle_m, axis)
            self._nozzle_m, self._axis = nozzle_m, axis
        self._opening.add(flowed.ml, self._shares)
        self.total.add(flowed.ml, self._shares)

    def closed(self) -> tuple[float, dict[str, Any]]:
        """The valve has shut: when it had opened, and the sums since as JSON values."""
        return self._opened_s, encode(self._opening)
