"""What aiming plans."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from drivers.arm.values import JointTrajectory


class WhyUnreachable(StrEnum):
    """Why no nozzle pose was found, most specific first."""

    TOO_NEAR = "too near the arm"
    TOO_FAR = "out of the arm's reach"
    JOINT_LIMITS = "no joint angles inside the limits"
    SELF_COLLISION = "the arm would touch itself or the rover"
    HIDDEN = "another fruit stands in the spray's way"
    PLANT_COLLISION = "the arm would touch a plant support"
    NO_PATH = "no collision-free path to the pose"


@dataclass(frozen=True, slots=True)
class Unreachable:
    reason: WhyUnreachable


@dataclass(frozen=True, slots=True, eq=False)
class AimPlan:
    """A nozzle pose for one fruit and the way there.

    ``nozzle_m`` (3,) and unit ``axis`` (3,) in the arm's base frame; ``stand_off_m`` from nozzle to fruit centre;
    ``goal_rad`` the joint angles at the pose; ``trajectory`` starts at the joint angles that were given.
    """

    nozzle_m: npt.NDArray[np.float64]
    axis: npt.NDArray[np.float64]
    stand_off_m: float
    goal_rad: tuple[float, ...]
    trajectory: JointTrajectory
