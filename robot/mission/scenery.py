"""What the arm must not touch at this stop: the rover, the plants' supports, and the fruit."""

from __future__ import annotations

from robot.aiming import Obstacles, Sphere, plant_support
from robot.geometry import Pose2, Transform
from robot.mission.context import MissionContext
from robot.targets import TargetState

NEAR_M = 1.2


def arm_from_row(context: MissionContext) -> Transform:
    """The arm's base frame from the row frame, by the pose at the frame in which the targets were seen."""
    pose = context.progress.frame_pose or context.localiser.pose
    return (pose.transform() @ context.settings.base_from_arm).inverse()


def obstacles(context: MissionContext, but: int | None = None) -> Obstacles:
    """Obstacles in the arm's base frame; ``but`` leaves one target out (the one that is aimed at)."""
    settings = context.settings
    to_arm = arm_from_row(context)
    pose: Pose2 = context.progress.frame_pose or context.localiser.pose
    supports = tuple(
        plant_support(x_m, y_m) for x_m, y_m in settings.supports_m if abs(x_m - pose.x_m) <= NEAR_M
    )
    fruits = tuple(
        Sphere(target.centre_m, 0.5 * target.diameter_m)
        for target in context.progress.book.targets
        if target.id != but
        and target.state is not TargetState.DOUBTFUL
        and abs(float(target.centre_m[0]) - pose.x_m) <= NEAR_M
    )
    plants = Obstacles(supports=supports, fruits=fruits).moved(to_arm)
    return settings.rover_body.joined(plants)
