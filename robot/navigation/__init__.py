"""Where the rover is, where it should stop, and how it gets there."""

from robot.navigation.drive import DriveCommand, DriveLimits, command
from robot.navigation.enu import Datum, enu_m, row_xy_m
from robot.navigation.geofence import Geofence
from robot.navigation.landmarks import LandmarkRules, PoseShift, estimate_shift, update_landmarks
from robot.navigation.pose import PoseFilter, PoseNoise, pose_at, predict, start, update_position, update_relative
from robot.navigation.route import Route, Row, Stop, parse_route
from robot.navigation.satellite import FixRules, update_fix, usable

__all__ = [
    "Datum",
    "DriveCommand",
    "DriveLimits",
    "FixRules",
    "Geofence",
    "LandmarkRules",
    "PoseFilter",
    "PoseNoise",
    "PoseShift",
    "Route",
    "Row",
    "Stop",
    "command",
    "enu_m",
    "estimate_shift",
    "parse_route",
    "pose_at",
    "predict",
    "row_xy_m",
    "start",
    "update_fix",
    "update_landmarks",
    "update_position",
    "update_relative",
    "usable",
]
