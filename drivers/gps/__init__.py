"""The GPS receiver."""

from drivers.gps.interface import Gps
from drivers.gps.values import Fix, FixQuality

__all__ = ["Fix", "FixQuality", "Gps"]
