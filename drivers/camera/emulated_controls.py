"""The controls of the emulated camera, as a UVC camera keeps them: with limits, steps, and automatics at power-on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.twin.nominal import Nominal

_EXPOSURE_STEP_S = 0.0001  # UVC 1.5, 4.2.2.1.4: units of 100 us
_MIDDLE_GREY = 118.0
_EASE = 0.5
DRIVEN = {"exposure_s": "auto_exposure", "white_balance_k": "auto_white_balance"}


@dataclass(slots=True)
class EmulatedControl:
    """One control: it holds ``value``, a multiple of ``step`` above ``low``."""

    low: float
    high: float
    step: float
    value: float

    def take(self, value: float) -> None:
        """Clamp and round as UVC drivers do."""
        steps = round((min(max(value, self.low), self.high) - self.low) / self.step)
        self.value = round(self.low + steps * self.step, 9)


@dataclass(slots=True)
class EmulatedControls:
    """All of them, by name. ``forgets`` names controls that take a value and do not keep it, ``lacks`` hidden ones."""

    table: dict[str, EmulatedControl]
    forgets: set[str] = field(default_factory=set)
    lacks: set[str] = field(default_factory=set)

    @classmethod
    def at_power_on(cls, nominal: Nominal) -> EmulatedControls:
        return cls(
            {
                "auto_exposure": EmulatedControl(0.0, 1.0, 1.0, 1.0),
                "exposure_s": EmulatedControl(nominal.exposure_min_s, nominal.exposure_max_s, _EXPOSURE_STEP_S, 0.0100),
                "gain": EmulatedControl(1.0, nominal.gain_max, 0.0625, 1.0),
                "auto_white_balance": EmulatedControl(0.0, 1.0, 1.0, 1.0),
                "white_balance_k": EmulatedControl(2800.0, 6500.0, 10.0, 4600.0),
                "power_line_hz": EmulatedControl(0.0, 60.0, 10.0, 60.0),
            }
        )

    def __getitem__(self, name: str) -> float:
        return self.table[name].value

    def take(self, wanted: Mapping[str, float]) -> None:
        """Set some; a control that an automatic drives keeps its value. ``KeyError`` for an unknown name."""
        for name, value in wanted.items():
            if name in self.lacks:
                raise KeyError(name)
            control = self.table[name]
            driver = DRIVEN.get(name)
            if name not in self.forgets and (driver is None or self[driver] == 0.0):
                control.take(value)

    def described(self) -> dict[str, dict[str, float]]:
        """What GET /controls answers."""
        return {
            name: {"value": c.value, "low": c.low, "high": c.high, "step": c.step}
            for name, c in self.table.items()
            if name not in self.lacks
        }

    def expose_by_itself(self, mean: float) -> None:
        """The automatic's next step after a picture of that mean code."""
        if self["auto_exposure"]:
            exposure = self.table["exposure_s"]
            ratio = _MIDDLE_GREY / max(mean, 1.0)
            exposure.take(exposure.value * ratio ** (2.2 * _EASE))
