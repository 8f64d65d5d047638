"""The commands of ``sprayer``, one file each; ``robot.cli`` puts them together."""
