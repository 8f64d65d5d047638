"""The light: how bright plants and fruit are, how to expose for them, when to light the lamp, when not to trust."""

from robot.vision.light.exposure import ExposureBounds, Setting, next_setting, split
from robot.vision.light.judgement import judge, trusted
from robot.vision.light.lamp import LampMemory, LampPolicy, after_switch, lamp_wanted
from robot.vision.light.metering import Reading, meter
from robot.vision.light.values import LightGoals, LightState

__all__ = [
    "ExposureBounds",
    "LampMemory",
    "LampPolicy",
    "LightGoals",
    "LightState",
    "Reading",
    "Setting",
    "after_switch",
    "judge",
    "lamp_wanted",
    "meter",
    "next_setting",
    "split",
    "trusted",
]
