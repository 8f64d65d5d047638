"""For every test."""

from __future__ import annotations

import os

import cv2
from hypothesis import settings

settings.register_profile("nightly", max_examples=20_000, deadline=None)  # HYPOTHESIS_PROFILE=nightly



def pytest_configure() -> None:
    """One thread a worker, as the robot has it: more would take the time of tests that wait for simulated wires."""
    cv2.setNumThreads(1)
    settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))
