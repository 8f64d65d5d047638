"""Declared faults: what a device does wrong, from when and for how long."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum


class Verb(StrEnum):
    """What a device does wrong (the vocabulary of PX4's failure injection).

    OFF: the line is silent and takes no command; what moves or flows goes on by its own timers. STUCK: an actuator
    stays as it is, a sensor repeats itself with new stamps. GARBAGE: commands are obeyed, answers are garbled. WRONG:
    readings are off by a plausible amount. SLOW: ten times the latency. DELAYED: readings are stale by their stamps,
    relay frames arrive late. INTERMITTENT: commands are obeyed, half of the answers do not come. UNPLUGGED: the port is
    gone; power stays. A valve: OFF does not open, WRONG does not seal.
    """

    OK = "ok"
    OFF = "off"
    STUCK = "stuck"
    GARBAGE = "garbage"
    WRONG = "wrong"
    SLOW = "slow"
    DELAYED = "delayed"
    INTERMITTENT = "intermittent"
    UNPLUGGED = "unplugged"


DEVICES = ("arm", "camera", "gps", "inputs", "modem", "relay", "valve", "wheels")
VALVE_VERBS = (Verb.OK, Verb.OFF, Verb.STUCK, Verb.WRONG, Verb.SLOW)
_SPELLING = re.compile(r"(?P<device>\w+):(?P<verb>\w+)(@(?P<start>[\d.eE-]+)s?)?(\+(?P<duration>[\d.eE-]+)s?)?")


@dataclass(frozen=True, slots=True)
class Fault:
    """``device`` does ``verb`` from ``start_s`` on for ``duration_s`` (None: for good). ``ValueError`` when unknown."""

    device: str
    verb: Verb
    start_s: float = 0.0
    duration_s: float | None = None

    def __post_init__(self) -> None:
        if self.device not in DEVICES:
            raise ValueError(f"fault: unknown device {self.device!r}; known are {', '.join(DEVICES)}")
        if self.verb not in tuple(Verb):
            raise ValueError(f"fault: unknown verb {self.verb!r}; known are {', '.join(Verb)}")
        if self.device == "valve" and self.verb not in VALVE_VERBS:
            raise ValueError(f"fault: a valve cannot be {self.verb}; known for it are {', '.join(VALVE_VERBS)}")
        if not (math.isfinite(self.start_s) and self.start_s >= 0.0):
            raise ValueError(f"fault: expected a start of 0 s or later, found {self.start_s}")
        if self.duration_s is not None and not self.duration_s > 0.0:
            raise ValueError(f"fault: expected a duration above 0 s, found {self.duration_s}")

    @property
    def end_s(self) -> float:
        return math.inf if self.duration_s is None else self.start_s + self.duration_s

    def __str__(self) -> str:
        tail = "" if self.duration_s is None else f"+{self.duration_s!r}s"
        return f"{self.device}:{self.verb}@{self.start_s!r}s{tail}"


def parse_fault(text: str) -> Fault:
    """The fault written ``device:verb@start+duration`` (``relay:garbage@12s+3s``); both times may be left out."""
    match = _SPELLING.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"fault: expected device:verb@start+duration such as relay:garbage@12s+3s, found {text!r}")
    verb = match["verb"]
    if verb not in tuple(Verb):
        raise ValueError(f"fault: unknown verb {verb!r}; known are {', '.join(Verb)}")
    try:
        start = float(match["start"] or 0.0)
        duration = None if match["duration"] is None else float(match["duration"])
    except ValueError:
        raise ValueError(f"fault: expected numbers of seconds in {text!r}, such as relay:garbage@12s+3s") from None
    return Fault(match["device"], Verb(verb), start, duration)


class FaultPlan:
    """The faults of one run; times in the clock of the run. Where several overlap the last declared counts."""

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        self.faults = tuple(faults)

    def shifted(self, by_s: float) -> FaultPlan:
        """The same faults in a clock that shows ``by_s`` more."""
        return FaultPlan(replace(fault, start_s=fault.start_s + by_s) for fault in self.faults)

    def verb(self, device: str, now_s: float) -> Verb:
        """What ``device`` does wrong now; ``Verb.OK`` when nothing."""
        if device not in DEVICES:
            raise ValueError(f"fault: unknown device {device!r}; known are {', '.join(DEVICES)}")
        if not self.faults:
            return Verb.OK
        for fault in reversed(self.faults):
            if fault.device == device and fault.start_s <= now_s < fault.end_s:
                return fault.verb
        return Verb.OK

    def next_change_s(self, after_s: float) -> float:
        """When the next fault begins or ends, infinity when none does."""
        if not self.faults:
            return math.inf
        edges = [edge for fault in self.faults for edge in (fault.start_s, fault.end_s)]
        return min((edge for edge in edges if edge > after_s), default=math.inf)
