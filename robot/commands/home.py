"""``sprayer arm home``: fold the arm away on a way that touches nothing."""

from __future__ import annotations

from robot.commands.by_hand import HandCommand, HandOptions, by_hand
from robot.commands.jog import ArmSpeedOption, move_arm
from robot.runtime.manual.arm import go_home


@by_hand
def home(options: HandOptions, speed_limit: ArmSpeedOption = 0.3) -> int:
    """Move the arm to its stow posture, clear of itself and of the rover."""
    return move_arm(HandCommand(options), "home", lambda hands: go_home(hands, speed_limit))
