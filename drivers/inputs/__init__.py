"""The rover's sensors."""

from drivers.inputs.interface import Inputs
from drivers.inputs.values import InputState

__all__ = ["InputState", "Inputs"]
