"""The differential drive."""

from drivers.wheels.interface import Wheels
from drivers.wheels.values import Odometry

__all__ = ["Odometry", "Wheels"]
