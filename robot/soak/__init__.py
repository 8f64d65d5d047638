"""Days of work in minutes: the whole robot on its simulated machine, all that goes wrong, every property watched."""

from robot.soak.report import as_text
from robot.soak.soak import Soak, SoakOptions, SoakResult, Tally

__all__ = ["Soak", "SoakOptions", "SoakResult", "Tally", "as_text"]
