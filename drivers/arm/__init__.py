"""The arm."""

from drivers.arm.interface import Arm
from drivers.arm.values import ArmState, JointTrajectory

__all__ = ["Arm", "ArmState", "JointTrajectory"]
