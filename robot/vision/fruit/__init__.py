"""The ``fruit`` detector: ripe, turning and green fruit in greenhouse light from noon to dusk."""

from robot.vision.fruit.detector import FruitDetector
from robot.vision.fruit.models import ModelError
from robot.vision.fruit.parameters import FruitParameters

__all__ = ["FruitDetector", "FruitParameters", "ModelError"]
