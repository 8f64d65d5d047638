"""For every test."""

from __future__ import annotations

import cv2


def pytest_configure() -> None:
    """One thread a worker, as the robot has it: more would take the time of tests that wait for simulated wires."""
    cv2.setNumThreads(1)
