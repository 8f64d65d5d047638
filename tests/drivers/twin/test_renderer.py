"""The pictures agree with the geometry that their truth tells."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from drivers.twin.light import light_at
from drivers.twin.optics import Eye, StereoOptics
from drivers.twin.plants import grow
from drivers.twin.raycast import HitKind, first_hit
from drivers.twin.renderer import StereoRenderer
from drivers.twin.scene import Scene
from drivers.twin.solids import Capsule, Greenhouse, Leaves, TwinFruit
from tests.drivers.twin.greenhouses import bent_optics, camera_at, fruit, greenhouse, ideal_optics, leaf

Array = npt.NDArray[np.float64]

SKY = light_at(12.0, "overcast")

def _sheet(reflectance: float) -> Capsule:
    """So large and far that its middle strip of one colour fills the view."""
    grey = (reflectance, reflectance, reflectance)
    return Capsule(np.array([-30.0, 9.0, 0.9]), np.array([30.0, 9.0, 0.9]), 6.0, grey)


SHEET = _sheet(0.02)


def linear(codes: npt.NDArray[np.uint8]) -> Array:
    share = codes.astype(np.float64) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def contour(one: TwinFruit, eye: Eye, row_from_left: Array, points: int = 120) -> Array:
    """(n, 2) pixels of the contour, by OpenCV's projection of the points where lines of sight graze the spheroid."""
    eye_m = row_from_left[:3, :3] @ eye.centre_m + row_from_left[:3, 3]
    shape = one.shape()
    away = eye_m - one.centre_m
    # x on the surface with (x - c)' E (eye - c) = 1: a plane's cut, found in the unit ball's space
    root = np.linalg.cholesky(shape)
    pole = root.T @ away
    basis = np.linalg.svd(pole[None])[2]
    turn = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)[:, None]
    height = 1.0 / np.linalg.norm(pole)
    ring = height * np.sign(basis[0] @ pole) * basis[0] + np.sqrt(1.0 - height**2) * (
        np.cos(turn) * basis[1] + np.sin(turn) * basis[2]
    )
    surface = one.centre_m + np.linalg.solve(root.T, ring.T).T
    left = (surface - row_from_left[:3, 3]) @ row_from_left[:3, :3]
    pixels, _ = cv2.projectPoints(left, cv2.Rodrigues(eye.R)[0], eye.t_m, eye.K, eye.dist)
    return np.asarray(pixels.reshape(-1, 2), dtype=np.float64)


def edge_errors(coverage: Array, outline: Array) -> Array:
    """(n,) how far outside the outline the edge of an image of coverage lies, pixels, by the area under its profile."""
    tangent = np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0)
    normal = np.column_stack([tangent[:, 1], -tangent[:, 0]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.sign(np.sum((outline - outline.mean(axis=0)) * normal, axis=1))[:, None]
    s = np.arange(-5.0, 5.001, 0.1)
    places = (outline[:, None] + s[:, None] * normal[:, None]).astype(np.float32)
    across = cv2.remap(coverage.astype(np.float32), places[..., 0], places[..., 1], cv2.INTER_LINEAR)
    return np.asarray(np.trapezoid(across.astype(np.float64), s, axis=1) + s[0])


@pytest.mark.parametrize("optics", [ideal_optics(), bent_optics()], ids=["ideal", "distorted and turned"])
@pytest.mark.parametrize(
    "one",
    [
        fruit((0.0, 0.60, 0.90), 0.07, 1.0),
        fruit((0.22, 0.50, 1.00), 0.07, 0.85, (0.3, 0.2, 1.0)),
        fruit((-0.20, 0.70, 0.72), 0.12, 0.80, (0.2, -0.4, 1.0)),
    ],
    ids=["middle", "right", "left, large"],
)
def test_the_edge_of_a_fruit_is_true_to_a_twentieth_of_a_pixel(one: TwinFruit, optics: StereoOptics) -> None:
    """Before a dark and before a pale sheet what differs is the part of each pixel that the fruit leaves free."""
    pose = camera_at(0.0)
    renderer = StereoRenderer(greenhouse(one), optics, 1)
    dark, pale = (
        renderer.render(pose, SKY, 0.012, arm=(sheet,), noise=False) for sheet in (SHEET, _sheet(0.5))
    )
    bare = StereoRenderer(greenhouse(), optics, 1)
    dark_bare, pale_bare = (bare.render(pose, SKY, 0.012, arm=(sheet,), noise=False) for sheet in (SHEET, _sheet(0.5)))
    for k, eye in enumerate((optics.left, optics.right)):
        free = (linear(pale[k]) - linear(dark[k])) / (linear(pale_bare[k]) - linear(dark_bare[k]))
        errors = edge_errors(1.0 - free.mean(axis=2), contour(one, eye, pose))
        assert abs(np.mean(errors)) < 0.01
        assert np.max(np.abs(errors)) < 0.05


def test_truth_agrees_with_opencv_projection_of_the_centre() -> None:
    optics, one, pose = bent_optics(), fruit((0.1, 0.6, 0.95)), camera_at(0.05)
    (view,) = StereoRenderer(greenhouse(one), optics, 1).truth(pose)
    centre = (one.centre_m - pose[:3, 3]) @ pose[:3, :3]
    assert view.centre_m == pytest.approx(centre)
    for eye, seen in ((optics.left, view.left), (optics.right, view.right)):
        pixel, _ = cv2.projectPoints(centre[None], cv2.Rodrigues(eye.R)[0], eye.t_m, eye.K, eye.dist)
        assert seen.centre_px == pytest.approx(pixel.ravel(), abs=1e-6)


def test_the_outline_of_a_sphere_has_its_area() -> None:
    (view,) = StereoRenderer(greenhouse(fruit((0.03, 0.65, 0.88), 0.08, 1.0)), ideal_optics(), 1).truth(camera_at(0.03))
    assert view.left.area_px2 == pytest.approx(np.pi * (457.0 * 0.04) ** 2 / (0.6**2 - 0.04**2), rel=1e-4)
    assert view.left.visible_fraction == pytest.approx(1.0, abs=0.01)


def test_a_fruit_half_out_of_the_image_counts_half() -> None:
    pose = camera_at(0.0)
    at_the_edge = fruit((-320.0 / 457.0 * 0.6, 0.65, 0.88), 0.08, 1.0)
    (view,) = StereoRenderer(greenhouse(at_the_edge), ideal_optics(), 1).truth(pose)
    assert view.left.in_image_fraction == pytest.approx(0.5, abs=0.03)
    assert view.left.visible_fraction == pytest.approx(view.left.in_image_fraction, abs=0.01)
    assert view.visible_fraction == view.right.visible_fraction < 0.1


def test_a_leaf_before_a_fruit_hides_just_what_it_covers() -> None:
    one = fruit((0.0, 0.70, 0.88), 0.09, 0.9)
    plants = greenhouse(one, leaves=leaf((0.02, 0.55, 0.90), 0.09))
    _hidden_as_rays_tell(plants, camera_at(0.0))


def test_in_a_grown_row_the_visible_shares_are_those_that_rays_tell() -> None:
    _hidden_as_rays_tell(grow(Scene(seed=3, row_length_m=1.35)), camera_at(0.6))


def _hidden_as_rays_tell(plants: Greenhouse, pose: Array) -> None:
    """Compare with one ray through every fourth pixel of both eyes."""
    optics = ideal_optics()
    views = StereoRenderer(plants, optics, 1).truth(pose)
    u, v = (grid.ravel() for grid in np.meshgrid(np.arange(0, 640, 2), np.arange(0, 480, 2)))
    for name, eye in (("left", optics.left), ("right", optics.right)):
        rays = np.column_stack([eye.rays(np.column_stack([u, v])), np.ones(len(u))]) @ pose[:3, :3].T
        origin = pose[:3, :3] @ eye.centre_m + pose[:3, 3]
        kinds, ids, _ = first_hit(plants, origin, rays)
        errors = []
        for view in views:
            seen = getattr(view, name)
            if seen.area_px2 > 800.0 and seen.in_image_fraction > 0.99:
                expected = 4.0 * np.count_nonzero((kinds == HitKind.FRUIT) & (ids == view.id)) / seen.area_px2
                errors.append(abs(seen.visible_fraction - expected))
        assert errors
        assert np.median(errors) < 0.02
        assert max(errors) < 0.12


def test_near_things_shift_more_between_the_eyes_than_far_ones() -> None:
    plants = greenhouse(fruit((0.0, 0.45, 0.98), number=1), fruit((0.0, 0.85, 0.80), number=2))
    near, far = StereoRenderer(plants, ideal_optics(), 1).truth(camera_at(0.0))
    assert near.left.centre_px[0] - near.right.centre_px[0] == pytest.approx(457.0 * 0.06 / 0.40)
    assert far.left.centre_px[0] - far.right.centre_px[0] == pytest.approx(457.0 * 0.06 / 0.80)


@pytest.mark.parametrize("depth_m", [0.45, 0.7])
def test_a_leafs_picture_shifts_by_its_disparity(depth_m: float) -> None:
    plants = greenhouse(leaves=leaf((0.0, 0.05 + depth_m, 0.88), 0.12))
    left, right = StereoRenderer(plants, ideal_optics(), 1).render(camera_at(-0.03), SKY, arm=(SHEET,), noise=False)
    places = []
    for picture in (left, right):
        green = np.maximum(linear(picture)[..., 1] - 1.3 * linear(picture)[..., 2], 0.0)
        places.append(float((green.sum(axis=0) * np.arange(640)).sum() / green.sum()))
    assert places[0] - places[1] == pytest.approx(457.0 * 0.06 / depth_m, abs=0.15)


def test_the_wall_shifts_by_its_disparity() -> None:
    left, right = StereoRenderer(greenhouse(), ideal_optics(), 1).render(camera_at(0.0), SKY, noise=False)
    patch = left[100:300, 200:500]
    score = cv2.matchTemplate(right[100:300], patch, cv2.TM_CCOEFF_NORMED)
    assert 200 - int(np.argmax(score[0])) == pytest.approx(457.0 * 0.06 / 1.55, abs=1.0)


def test_the_arm_hides_the_fruit_behind_it_and_not_the_one_before_it() -> None:
    plants = greenhouse(fruit((0.0, 0.70, 0.88), number=1), fruit((0.12, 0.40, 0.88), number=2))
    arm = Capsule(np.array([-0.1, 0.5, 0.88]), np.array([0.4, 0.5, 0.88]), 0.06)
    behind, before = StereoRenderer(plants, ideal_optics(), 1).truth(camera_at(0.03), (arm,))
    assert behind.visible_fraction == 0.0
    assert before.visible_fraction == pytest.approx(1.0, abs=0.02)


def test_the_arm_shows_in_the_picture() -> None:
    renderer = StereoRenderer(greenhouse(), ideal_optics(), 1)
    arm = Capsule(np.array([-0.2, 0.4, 0.88]), np.array([0.2, 0.5, 0.88]), 0.04, (0.03, 0.03, 0.03))
    without, _ = renderer.render(camera_at(0.0), SKY, noise=False)
    with_arm, _ = renderer.render(camera_at(0.0), SKY, arm=(arm,), noise=False)
    assert with_arm[235:245, 310:330].mean() < 0.6 * without[235:245, 310:330].mean()
    assert np.array_equal(with_arm[:60], without[:60])


def test_the_same_frame_number_gives_the_same_picture_and_another_other_noise() -> None:
    plants = grow(Scene(seed=2, row_length_m=0.9))
    one, other = StereoRenderer(plants, ideal_optics(), 7), StereoRenderer(plants, ideal_optics(), 7)
    pose = camera_at(0.4)
    first = one.render(pose, SKY, frame=3)
    other.render(camera_at(0.2), SKY, frame=9)
    again = other.render(pose, SKY, frame=3)
    assert np.array_equal(first[0], again[0])
    assert np.array_equal(first[1], again[1])
    assert not np.array_equal(first[0], one.render(pose, SKY, frame=4)[0])
    assert not np.array_equal(first[0], StereoRenderer(plants, ideal_optics(), 8).render(pose, SKY, frame=3)[0])


@pytest.mark.parametrize("hour", [12.0, 19.0])
def test_noise_is_that_of_photons_and_read_out(hour: float) -> None:
    """Variance e + 7^2 electrons squared at 9000 electrons full scale, over 24 pictures of a grey sheet."""
    light = light_at(hour, "overcast")
    grey = _sheet(0.3)
    renderer = StereoRenderer(greenhouse(), ideal_optics(), 1)
    clean, _ = renderer.render(camera_at(0.0), light, arm=(grey,), noise=False)
    frames = [
        9000.0 * linear(renderer.render(camera_at(0.0), light, arm=(grey,), frame=k)[0][200:280, 280:360, 1])
        for k in range(24)
    ]
    expected = float(9000.0 * linear(clean[200:280, 280:360, 1]).mean())
    assert np.mean(frames) == pytest.approx(expected, rel=0.03)
    assert np.var(frames, axis=0).mean() == pytest.approx(expected + 49.0, rel=0.12)


def test_gain_brightens_and_exposure_too() -> None:
    renderer = StereoRenderer(greenhouse(), ideal_optics(), 1)
    light = light_at(19.5, "overcast")
    base = linear(renderer.render(camera_at(0.0), light, 0.002, noise=False)[0]).mean()
    gained = linear(renderer.render(camera_at(0.0), light, 0.002, 2.0, noise=False)[0]).mean()
    exposed = linear(renderer.render(camera_at(0.0), light, 0.004, noise=False)[0]).mean()
    assert gained == pytest.approx(2.0 * base, rel=0.05)
    assert exposed == pytest.approx(2.0 * base, rel=0.05)


def test_touching_fruit_darken_each_other() -> None:
    """No sun: only the neighbour takes sky from the side that faces it."""
    lone = greenhouse(fruit((0.0, 0.6, 0.88), 0.08, 1.0))
    pair = greenhouse(fruit((0.0, 0.6, 0.88), 0.08, 1.0), fruit((0.08001, 0.6, 0.88), 0.08, 1.0, number=2))
    pictures = [
        StereoRenderer(plants, ideal_optics(), 1).render(camera_at(0.03), SKY, noise=False)[0]
        for plants in (lone, pair)
    ]
    (view, *_) = StereoRenderer(lone, ideal_optics(), 1).truth(camera_at(0.03))
    u, v = (int(value) for value in view.left.centre_px)
    near_side = [linear(picture)[v - 4 : v + 5, u + 22 : u + 27, 2].mean() for picture in pictures]
    far_side = [linear(picture)[v - 4 : v + 5, u - 27 : u - 22, 2].mean() for picture in pictures]
    assert near_side[1] < 0.8 * near_side[0]
    assert far_side[1] == pytest.approx(far_side[0], rel=0.02)


def test_a_leaf_before_the_sun_shades_the_fruit() -> None:
    light = light_at(12.0)
    one = fruit((0.0, 0.6, 0.88), 0.08, 1.0)
    over = one.centre_m + 0.12 * light.sun_direction
    bare = StereoRenderer(greenhouse(one), ideal_optics(), 1)
    shaded = StereoRenderer(greenhouse(one, leaves=_across(over, light.sun_direction)), ideal_optics(), 1)
    (view,) = bare.truth(camera_at(0.0))
    x0, y0, x1, _ = (int(value) for value in view.left.bbox)
    top = slice(y0 + 4, y0 + 24), slice(x0 + 20, x1 - 20)
    lit = linear(bare.render(camera_at(0.0), light, noise=False)[0][top])[..., 2].mean()
    dark = linear(shaded.render(camera_at(0.0), light, noise=False)[0][top])[..., 2].mean()
    assert dark < 0.5 * lit


def _across(centre_m: Array, direction: Array) -> Leaves:
    u = np.cross(direction, [0.0, 0.0, 1.0])
    u /= np.linalg.norm(u)
    v = np.cross(direction, u)
    u, v = 0.25 * u, 0.25 * v
    return Leaves((centre_m - 0.5 * (u + v))[None], u[None], v[None], np.array([5]), np.ones((1, 3)))


def test_the_right_hand_row_is_seen_by_a_rig_that_is_turned_round() -> None:
    plants = grow(Scene(seed=2, side="right", row_length_m=0.9))
    views = StereoRenderer(plants, ideal_optics(), 1).truth(camera_at(0.45, side=-1.0))
    assert len(views) >= 3
    assert all(view.centre_m[2] > 0.2 for view in views)


@pytest.mark.parametrize(
    ("pose", "exposure_s", "gain", "words"),
    [
        (np.eye(3), 0.004, 1.0, r"row_from_camera: expected shape \(4, 4\)"),
        (2.0 * np.eye(4), 0.004, 1.0, "row_from_camera: expected a rigid transform"),
        (np.eye(4), 0.0, 1.0, "exposure_s: expected above 0"),
        (np.eye(4), 0.004, 0.5, "gain: expected 1 or more"),
    ],
)
def test_an_impossible_picture_is_refused(pose: Array, exposure_s: float, gain: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        StereoRenderer(greenhouse(), ideal_optics(), 1).render(pose, SKY, exposure_s, gain)
