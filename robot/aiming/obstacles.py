"""What the arm must not touch, in the arm's base frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from robot.aiming.capsules import Box, Capsule, Sphere
from robot.geometry import Transform, Vector


@dataclass(frozen=True, slots=True)
class Obstacles:
    """``body``: the rover and what is mounted on it; ``supports``: strings, canes, stems; ``fruits``: all known fruit.

    All in one frame, which for planning is the arm's base frame (``moved`` brings them there).
    """

    body: tuple[Capsule | Box, ...] = ()
    supports: tuple[Capsule, ...] = ()
    fruits: tuple[Sphere, ...] = ()

    def moved(self, target_from_source: Transform) -> Obstacles:
        return Obstacles(
            tuple(part.moved(target_from_source) for part in self.body),
            tuple(support.moved(target_from_source) for support in self.supports),
            tuple(fruit.moved(target_from_source) for fruit in self.fruits),
        )

    def joined(self, other: Obstacles) -> Obstacles:
        return Obstacles(self.body + other.body, self.supports + other.supports, self.fruits + other.fruits)


def plant_support(x_m: float, y_m: float, height_m: float = 1.6, radius_m: float = 0.01) -> Capsule:
    """A vertical string or cane from the ground up, in a frame whose z is up and 0 on the ground."""
    return Capsule(np.array([x_m, y_m, 0.0]), np.array([x_m, y_m, height_m]), radius_m)


@dataclass(frozen=True, slots=True, eq=False)
class RoverBody:
    """The rover's solid parts, base frame, for a rig that faces left (+y).

    Deck: a box on the ground, half as long and wide as ``deck_half_m`` (2,), up to ``deck_top_m``. Mast: a capsule
    from the deck to ``mast_top_m`` (3,), then a boom to the camera. Camera: a box of half edges ``camera_half_m`` (3,)
    about ``camera_m`` (3,), the middle of the stereo pair's housing.
    """

    deck_half_m: Vector = field(default_factory=lambda: np.array([0.35, 0.28]))
    deck_top_m: float = 0.40
    mast_top_m: Vector = field(default_factory=lambda: np.array([-0.15, -0.05, 0.95]))
    mast_radius_m: float = 0.02
    camera_m: Vector = field(default_factory=lambda: np.array([0.0, 0.03, 0.88]))
    camera_half_m: Vector = field(default_factory=lambda: np.array([0.06, 0.025, 0.02]))
    boom_radius_m: float = 0.012

    def obstacles(self, base_from_arm: Transform) -> Obstacles:
        """The parts in the arm's base frame; an arm mounted above the deck stands on a post."""
        deck_half = np.array([*self.deck_half_m, self.deck_top_m / 2])
        deck = Box(Transform(np.eye(3), np.array([0.0, 0.0, self.deck_top_m / 2])), deck_half)
        mast_foot = np.array([self.mast_top_m[0], self.mast_top_m[1], self.deck_top_m])
        camera = Box(Transform(np.eye(3), self.camera_m), self.camera_half_m)
        parts: list[Capsule | Box] = [
            deck,
            Capsule(mast_foot, self.mast_top_m, self.mast_radius_m),
            Capsule(self.mast_top_m, self.camera_m - np.array([0.0, self.camera_half_m[1], 0.0]), self.boom_radius_m),
            camera,
        ]
        arm_foot = base_from_arm.translation_m
        post_radius_m = 0.05
        if arm_foot[2] - self.deck_top_m > 2 * post_radius_m:
            top = arm_foot - np.array([0.0, 0.0, post_radius_m])
            parts.append(Capsule(np.array([arm_foot[0], arm_foot[1], self.deck_top_m]), top, post_radius_m))
        return Obstacles(body=tuple(parts)).moved(base_from_arm.inverse())
