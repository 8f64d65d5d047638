"""The controls of a camera: set, and verified by what the camera says afterwards."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal, Protocol

from drivers.errors import DeviceFault


class Control(StrEnum):
    """What can be set. Exposure in seconds, white balance in kelvin, mains frequency in hertz (0: no filter).

    ``GAIN`` is in the camera's own units, see ``GainScale``. Automatics are 0 (off) or 1 (on).
    """

    AUTO_EXPOSURE = "auto_exposure"
    EXPOSURE_S = "exposure_s"
    GAIN = "gain"
    AUTO_WHITE_BALANCE = "auto_white_balance"
    WHITE_BALANCE_K = "white_balance_k"
    POWER_LINE_HZ = "power_line_hz"
    AUTO_FOCUS = "auto_focus"
    AUTO_RATE = "auto_rate"


@dataclass(frozen=True, slots=True)
class Limits:
    """The values that a control takes: ``low`` to ``high`` in steps of ``step``."""

    low: float
    high: float
    step: float

    def nearest(self, value: float) -> float:
        """The value that the control can take nearest to this one."""
        steps = round((min(max(value, self.low), self.high) - self.low) / self.step) if self.step > 0.0 else 0
        return min(self.low + steps * self.step, self.high)


class Controls(Protocol):
    """A camera's controls. Blocking; each method raises a ``DeviceError`` or, when the camera is gone, ``OSError``."""

    def limits(self, control: Control) -> Limits | None:
        """None when the camera has no such control."""
        ...

    def read(self, control: Control) -> float: ...

    def write(self, control: Control, value: float) -> None: ...

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class GainScale:
    """The camera's gain number for a linear gain.

    linear: ``unity + units * (gain - 1)``; decibel: ``unity + units * 20 log10(gain)``. The test card tells how to
    find ``unity`` (the number at a gain of 1) and ``units``.
    """

    kind: Literal["linear", "decibel"] = "linear"
    unity: float = 1.0
    units: float = 1.0

    def number(self, gain: float) -> float:
        return self.unity + self.units * (gain - 1.0 if self.kind == "linear" else 20.0 * math.log10(gain))

    def gain(self, number: float) -> float:
        steps = (number - self.unity) / self.units
        return 1.0 + steps if self.kind == "linear" else 10.0 ** (steps / 20.0)


def apply(
    controls: Controls, wanted: Mapping[Control, float], may_differ: frozenset[Control] = frozenset()
) -> dict[Control, float]:
    """Set the controls in this order and read each back; what the camera says, by control.

    ``DeviceFault`` names a control that the camera lacks, whose limits forbid the value, or that does not keep it,
    unless it ``may_differ``. An automatic that the camera lacks is as good as off.
    """
    kept: dict[Control, float] = {}
    for control, value in wanted.items():
        limits = controls.limits(control)
        if limits is None:
            if not _is_off(control, value) and control not in may_differ:
                raise DeviceFault(
                    "camera", f"a control {control} to set to {value:g}", "none",
                    f"use a camera that has it, or allow {control} to differ",
                )  # fmt: skip
            continue
        nearest = limits.nearest(value)
        if abs(nearest - value) > 0.51 * limits.step and control not in may_differ:
            raise DeviceFault(
                "camera", f"{control} to take {value:g}", f"{limits.low:g} to {limits.high:g} in steps of "
                f"{limits.step:g}", f"choose a value within, or allow {control} to differ",
            )  # fmt: skip
        controls.write(control, nearest)
        found = controls.read(control)
        if not math.isclose(found, nearest, rel_tol=1e-6, abs_tol=1e-9) and control not in may_differ:
            raise DeviceFault(
                "camera", f"{control} to keep {nearest:g}", f"{found:g} ({limits.low:g} to {limits.high:g} possible)",
                f"check what else drives it (v4l2-ctl --list-ctrls), or allow {control} to differ",
            )  # fmt: skip
        kept[control] = found
    return kept


def _is_off(control: Control, value: float) -> bool:
    return value == 0.0 and control not in (Control.EXPOSURE_S, Control.GAIN)
