"""What the light is judged by. Levels are linear: 0 is black, 1 the brightest that a picture can show."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class LightState(StrEnum):
    """How well the plants are lit in a picture. DARK and BRIGHT are not to be trusted."""

    GOOD = "good"
    DIM = "dim"        # below the goal, and nothing more to be had; noisier, still good enough
    DARK = "dark"      # noise hides what is a fruit and what is not
    BRIGHT = "bright"  # most of the plants are burnt out


@dataclass(frozen=True, slots=True)
class LightGoals:
    """``level`` is the mean that plants shall have, ``highlight`` the most that their brightest 2 % may.

    A picture within a factor of ``dead_band`` of the goal is left as it is. Plants are DARK below ``dark_signal``,
    their level at a gain of 1 (gain lifts the noise with them), and below ``dark_level`` (too few codes are left);
    with more than ``bright_share`` of them burnt out they are BRIGHT.
    """

    level: float = 0.10
    highlight: float = 0.90
    dead_band: float = 1.5
    dark_signal: float = 0.0015
    dark_level: float = 0.005
    bright_share: float = 0.5

    def __post_init__(self) -> None:
        good = self.level / self.dead_band
        for name, value in (("dark_signal", self.dark_signal), ("dark_level", self.dark_level)):
            if not 0.0 < value < good:
                raise ValueError(
                    f"{name}: expected above 0 and below {good:.3g} (the goal less its dead band), found {value:g}; "
                    "correct it"
                )
        if not (self.level < self.highlight < 1.0 and self.dead_band > 1.0 and 0.0 < self.bright_share <= 1.0):
            raise ValueError("need level < highlight < 1, dead_band > 1 and bright_share in 0..1")
