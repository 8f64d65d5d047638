"""Move, stop, detect, aim, spray: the state machine and its state tasks."""

from robot.mission.context import MissionContext, Progress, rewound
from robot.mission.events import BookChanged, FrameSeen, LightSeen, ShotDone, StateEntered, TargetSkipped, Trouble
from robot.mission.localiser import Localiser
from robot.mission.machine import Mission
from robot.mission.settings import DoseSettings, LightSettings, MissionSettings
from robot.mission.transitions import TRANSITIONS, Event, State, next_state

__all__ = [
    "TRANSITIONS",
    "BookChanged",
    "DoseSettings",
    "Event",
    "FrameSeen",
    "LightSeen",
    "LightSettings",
    "Localiser",
    "Mission",
    "MissionContext",
    "MissionSettings",
    "Progress",
    "ShotDone",
    "State",
    "StateEntered",
    "TargetSkipped",
    "Trouble",
    "next_state",
    "rewound",
]
