"""One book of targets in the row's frame: sightings of many stops merged, each fruit sprayed once."""

from robot.targets.book import Book, book_of, match, observe, with_state
from robot.targets.matching import BookParameters, Match
from robot.targets.policy import TOO_HIDDEN, Policy, Verdict, wanted
from robot.targets.ripeness import RipenessBorders, classify
from robot.targets.sighting import Sighting, sighting
from robot.targets.values import Target, TargetState

__all__ = [
    "TOO_HIDDEN",
    "Book",
    "BookParameters",
    "Match",
    "Policy",
    "RipenessBorders",
    "Sighting",
    "Target",
    "TargetState",
    "Verdict",
    "book_of",
    "classify",
    "match",
    "observe",
    "sighting",
    "wanted",
    "with_state",
]
