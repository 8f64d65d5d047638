"""A fruit and the arm's joint angles -> nozzle pose and collision-free trajectory, all in the arm's base frame."""

from robot.aiming.capsules import Box, Capsule, Sphere
from robot.aiming.collision import CollisionModel, Thing
from robot.aiming.inverse import inverse_kinematics, nearest_solution
from robot.aiming.kinematics import link_frames, nozzle_jacobian, within_limits
from robot.aiming.obstacles import Obstacles, RoverBody, plant_support
from robot.aiming.order import visiting_order
from robot.aiming.parameters import AimingParameters
from robot.aiming.plan import motion_limits, plan, plan_joints
from robot.aiming.stand_off import stand_off_m
from robot.aiming.stow import CameraView, stow_problems
from robot.aiming.trajectory import MotionLimits, joint_trajectory, travel_time_s
from robot.aiming.urdf import ArmModel, parse_urdf
from robot.aiming.values import AimPlan, Unreachable, WhyUnreachable

__all__ = [
    "AimPlan",
    "AimingParameters",
    "ArmModel",
    "Box",
    "CameraView",
    "Capsule",
    "CollisionModel",
    "MotionLimits",
    "Obstacles",
    "RoverBody",
    "Sphere",
    "Thing",
    "Unreachable",
    "WhyUnreachable",
    "inverse_kinematics",
    "joint_trajectory",
    "link_frames",
    "motion_limits",
    "nearest_solution",
    "nozzle_jacobian",
    "parse_urdf",
    "plan",
    "plan_joints",
    "plant_support",
    "stand_off_m",
    "stow_problems",
    "travel_time_s",
    "visiting_order",
    "within_limits",
]
