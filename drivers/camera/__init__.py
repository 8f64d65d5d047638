"""The stereo camera."""

from drivers.camera.interface import StereoCamera
from drivers.camera.values import StereoFrame

__all__ = ["StereoCamera", "StereoFrame"]
