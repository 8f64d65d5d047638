"""The paper's method, sections 3.3 and 3.4: the named baseline ``detector = "paper"``."""

from robot.vision.paper.detector import PaperDetector
from robot.vision.paper.parameters import PaperParameters
from robot.vision.paper.volume import sphere_volume_m3

__all__ = ["PaperDetector", "PaperParameters", "sphere_volume_m3"]
