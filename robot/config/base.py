"""What the sections of a configuration have in common: strictness and the windows of plausible values."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

MAX_SEED = 2**63 - 1

Metres = Annotated[float, Field(allow_inf_nan=False, ge=-5.0, le=5.0)]
Radians = Annotated[float, Field(allow_inf_nan=False, ge=-6.3, le=6.3)]
Vector3 = tuple[Metres, Metres, Metres]
Rotation3 = tuple[Radians, Radians, Radians]
Pixels = Annotated[int, Field(ge=64, le=8192)]
Fraction = Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=1.0)]


def between(low: float, high: float) -> Any:
    """A finite number from ``low`` to ``high``."""
    return Field(allow_inf_nan=False, ge=low, le=high)


class Section(BaseModel):
    """A table of the file; unknown keys are errors, and nothing changes once it is read."""

    model_config = ConfigDict(extra="forbid", frozen=True)
