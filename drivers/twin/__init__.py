"""The simulated machine and its greenhouse: one truth behind every mock and emulator."""

from drivers.twin.aftermath import Aftermath, resume_from, run_on
from drivers.twin.deviations import TrueMachine, draw, exact
from drivers.twin.faults import Fault, FaultPlan, Verb, parse_fault
from drivers.twin.machine import Twin
from drivers.twin.nominal import Nominal
from drivers.twin.optics import StereoOptics
from drivers.twin.scene import Scene
from drivers.twin.truth import TruthLog
from drivers.twin.truth_record import ProcessTruth, TruthRecord, read_truth

__all__ = [
    "Aftermath",
    "Fault",
    "FaultPlan",
    "Nominal",
    "ProcessTruth",
    "Scene",
    "StereoOptics",
    "TrueMachine",
    "TruthLog",
    "TruthRecord",
    "Twin",
    "Verb",
    "draw",
    "exact",
    "parse_fault",
    "read_truth",
    "resume_from",
    "run_on",
]
