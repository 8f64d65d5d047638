"""What is wrong with this rover, device by device, each with its remedy. Nothing moves."""

from robot.doctor.values import Finding, Level, exit_code

__all__ = ["Finding", "Level", "exit_code"]
