"""From images to measured hypotheses: circles, outlines, disparity, joint fit and the features to judge them by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robot.vision.fruit.candidates import find_candidates
from robot.vision.fruit.contour import Contours, fit_circles, stack_of, trace
from robot.vision.fruit.features import ViewFeatures, pair_features, view_features
from robot.vision.fruit.joint_fit import Spheroids, fit_spheroids
from robot.vision.fruit.network import Network
from robot.vision.fruit.parameters import FruitParameters
from robot.vision.fruit.planes import Image, Plane, planes_of, planes_of_light, working_light
from robot.vision.fruit.rectify import ParallelPair, parallel_pair, rectified
from robot.vision.fruit.skin import skin_map
from robot.vision.fruit.stereo_match import match_discs
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """n measured hypotheses of one pair: ``fit`` in the parallel pair's frame, ``features`` (n, m) to judge them by;
    ``stacks`` are the two views they were traced in."""

    pair: ParallelPair
    fit: Spheroids
    features: Array
    left: ViewFeatures
    right: ViewFeatures
    stacks: tuple[Plane, Plane]


@dataclass(frozen=True, slots=True, eq=False)
class MonoHypotheses:
    """n circles of one image in stored pixels (n, 3), with the features to judge them by."""

    circles: Array
    view: ViewFeatures


def mono_hypotheses(image: Image, skin: Network, parameters: FruitParameters) -> MonoHypotheses:
    """Of one (height, width, 3) sRGB image."""
    planes = planes_of(image)
    probability = skin_map(planes, skin)
    stack = stack_of(planes, probability)
    found = find_candidates(planes, probability, parameters.mono_candidates)
    circles, contours, residual = outline(stack, found.circles)
    view = view_features(stack, circles, contours, residual)
    values = np.column_stack([view.values, found.evidence])
    scale = 0.5 * (planes.scale_x + planes.scale_y)
    stored = np.column_stack([planes.to_stored(circles[:, :2]), circles[:, 2] * scale])
    return MonoHypotheses(stored, ViewFeatures(values, view.tint, view.seen))


def pair_hypotheses(
    full_left: Plane, full_right: Plane, rig: StereoRig, skin: Network, parameters: FruitParameters
) -> Hypotheses:
    """Of a pair of (height, width, 3) linear light as stored."""
    light_left, light_right = working_light(full_left), working_light(full_right)
    size = (light_left.shape[1], light_left.shape[0])
    scale = np.array([rig.image_size[0] / size[0], rig.image_size[1] / size[1]])
    pair = parallel_pair(rig, size)
    stacks: list[Plane] = []
    for light, rotation, K, dist in (
        (light_left, pair.rect_from_left, rig.K_left, rig.dist_left),
        (light_right, pair.rect_from_right, rig.K_right, rig.dist_right),
    ):
        planes = planes_of_light(rectified(light, pair, rotation, K, dist, scale), float(scale[0]), float(scale[1]))
        probability = skin_map(planes, skin)
        if not stacks:
            found = find_candidates(planes, probability, parameters.candidates)
        stacks.append(stack_of(planes, probability))
    circles, contours, residual = outline(stacks[0], found.circles)
    match = match_discs(stacks[0], stacks[1], circles, pair, parameters.diameter_range_m, parameters.distance_range_m)
    seeds = circles - np.column_stack([match.disparity_px, np.zeros((len(circles), 2))])
    circles_right, contours_right, residual_right = outline(stacks[1], seeds, window=(0.7, 1.3))
    fit = fit_outlines(pair, (contours, contours_right), circles, match.disparity_px)
    views = (
        view_features(stacks[0], circles, contours, residual),
        view_features(stacks[1], circles_right, contours_right, residual_right),
    )
    features = pair_features(views[0], views[1], fit, match.score, match.margin, found.evidence, pair.focal_px)
    return Hypotheses(pair, fit, features, views[0], views[1], (stacks[0], stacks[1]))


def outline(stack: Plane, circles: Array, window: tuple[float, float] | None = None) -> tuple[Array, Contours, Array]:
    """Refined circles (n, 3), their outlines and the residuals (n, k), by two rounds of tracing and fitting."""
    contours = trace(stack, circles) if window is None else trace(stack, circles, window=window)
    refined, _ = fit_circles(contours)
    refined[:, 2] = np.clip(refined[:, 2], 0.6 * circles[:, 2], 1.6 * circles[:, 2])
    shift = refined[:, :2] - circles[:, :2]
    length = np.linalg.norm(shift, axis=1, keepdims=True) + 1e-9
    refined[:, :2] = circles[:, :2] + shift * np.minimum(1.0, 0.7 * circles[:, 2:] / length)
    contours = trace(stack, refined, window=(0.7, 1.3))
    final, residual = fit_circles(contours)
    wild = (np.abs(np.log(np.maximum(final[:, 2], 1e-3) / refined[:, 2])) > 0.4) | (
        np.linalg.norm(final[:, :2] - refined[:, :2], axis=1) > 0.5 * refined[:, 2]
    )
    final[wild] = refined[wild]
    return final, contours, residual


def fit_outlines(
    pair: ParallelPair, contours: tuple[Contours, Contours], circles: Array, disparity_px: Array
) -> Spheroids:
    """The joint fit, started from the left circle and its disparity."""
    rays = np.stack([pair.rays(contours[0].points), pair.rays(contours[1].points)], axis=1)
    strength = np.stack([contours[0].strength, contours[1].strength], axis=1) + 1e-3
    depth = pair.focal_px * pair.baseline_m / np.maximum(disparity_px, 1.0)
    axis = pair.rays(circles[:, :2])
    centre = axis * (depth / axis[:, 2])[:, None]
    start = np.column_stack([centre, circles[:, 2] / pair.focal_px * depth])
    return fit_spheroids(rays, strength, pair.eyes_m, start, pair.focal_px)
