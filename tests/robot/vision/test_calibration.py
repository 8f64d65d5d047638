"""Calibration from board corners: known rigs come back, ill-posed views are refused."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from robot.geometry import rotation_from_rpy
from robot.vision.board_corners import Board, find_corners, same_order
from robot.vision.camera_calibration import BoardView, calibrate_stereo, outliers
from tests.robot.vision.boards import board_picture
from tests.robot.vision.spheres import small_rig

Array = npt.NDArray[np.float64]

BOARD = Board(7, 5, 0.03)
RIG = small_rig(tilted=True)


def board_points_in_left(index: int) -> Array:
    rng = np.random.default_rng(100 + index)
    turn = rotation_from_rpy(rng.uniform(-0.6, 0.6), rng.uniform(-0.6, 0.6), rng.uniform(-0.3, 0.3))
    middle = np.array([rng.uniform(-0.06, 0.12), rng.uniform(-0.07, 0.07), rng.uniform(0.32, 0.5)])
    return (BOARD.points_m() - BOARD.points_m().mean(axis=0)) @ turn.T + middle


def views(count: int, noise_px: float, same_pose: bool = False) -> list[BoardView]:
    rng = np.random.default_rng(7)
    out = []
    for index in range(count):
        points_m = board_points_in_left(0 if same_pose else index)
        left, right = RIG.project_left(points_m), RIG.project_right(points_m)
        out.append(
            BoardView(
                f"view{index + 1}",
                left + rng.normal(0.0, noise_px, left.shape),
                right + rng.normal(0.0, noise_px, right.shape),
            )
        )
    return out


def test_a_known_rig_comes_back_from_noisy_corners() -> None:
    found = calibrate_stereo(views(20, 0.05), BOARD, RIG.image_size)
    for own, true in ((found.rig.K_left, RIG.K_left), (found.rig.K_right, RIG.K_right)):
        assert own[0, 0] == pytest.approx(true[0, 0], rel=0.003)
        assert own[1, 1] == pytest.approx(true[1, 1], rel=0.003)
        assert own[:2, 2] == pytest.approx(true[:2, 2], abs=1.0)
    assert found.rig.baseline_m == pytest.approx(RIG.baseline_m, abs=0.3e-3)
    assert np.degrees(np.arccos((np.trace(found.rig.R @ RIG.R.T) - 1.0) / 2.0)) < 0.15
    assert found.stereo_rms_px == pytest.approx(0.05 * np.sqrt(2.0), rel=0.15)
    assert abs(found.rig.K_left[0, 0] - RIG.K_left[0, 0]) < 4.0 * found.focal_sigma_px


def test_exact_corners_give_the_exact_rig() -> None:
    found = calibrate_stereo(views(8, 0.0), BOARD, RIG.image_size)
    assert found.rig.K_left == pytest.approx(RIG.K_left, abs=0.02)
    assert found.rig.t_m == pytest.approx(RIG.t_m, abs=1e-5)
    assert found.rig.dist_right == pytest.approx(RIG.dist_right, abs=2e-3)


def test_world_view_makes_the_board_of_that_view_the_world() -> None:
    found = calibrate_stereo(views(8, 0.0), BOARD, RIG.image_size, world_view="view6")
    assert found.rig.world_from_left is not None
    in_left = np.column_stack([board_points_in_left(5), np.ones(35)])
    assert (in_left @ found.rig.world_from_left.T)[:, :3] == pytest.approx(BOARD.points_m(), abs=1e-4)


def test_a_world_view_without_a_board_is_refused() -> None:
    with pytest.raises(ValueError, match="world view view9"):
        calibrate_stereo(views(4, 0.0), BOARD, RIG.image_size, world_view="view9")


def test_two_views_are_too_few() -> None:
    with pytest.raises(ValueError, match=r"at least 3 views .* found 2"):
        calibrate_stereo(views(2, 0.0), BOARD, RIG.image_size)


def test_one_pose_seen_five_times_leaves_the_focal_length_open() -> None:
    with pytest.raises(ValueError, match=r"left camera.*tilted"):
        calibrate_stereo(views(5, 0.05, same_pose=True), BOARD, RIG.image_size)


def test_a_view_with_bad_corners_is_named_as_outlier_and_no_other() -> None:
    good = views(12, 0.05)
    spoilt = good[4].right_px + np.random.default_rng(1).normal(0.0, 1.0, good[4].right_px.shape)
    good[4] = BoardView("view5", good[4].left_px, spoilt)
    found = calibrate_stereo(good, BOARD, RIG.image_size)
    assert [view.name for view in found.views if view.outlier] == ["view5"]
    assert found.views[4].right_px > 5.0 * found.views[3].right_px


def test_even_errors_have_no_outlier() -> None:
    assert not outliers([0.1, 0.11, 0.09, 0.1, 0.12]).any()
    assert outliers([0.1, 0.11, 0.09, 0.1, 0.5]).tolist() == [False] * 4 + [True]


HOMOGRAPHY = np.array([[0.9, 0.12, 180.0], [-0.08, 0.85, 140.0], [0.0002, 0.0003, 1.0]])


def true_corners() -> Array:
    v, u = np.mgrid[:5, :7]
    flat = np.column_stack([u.ravel() * 40.0, v.ravel() * 40.0, np.ones(35)]) @ HOMOGRAPHY.T
    return np.asarray(flat[:, :2] / flat[:, 2:])


def test_corners_are_found_to_a_tenth_of_a_pixel() -> None:
    found = find_corners(board_picture(HOMOGRAPHY), BOARD)
    assert found is not None
    assert float(np.abs(found - true_corners()).max()) < 0.1


def test_a_board_turned_by_half_a_turn_still_starts_at_the_top_left() -> None:
    picture = board_picture(HOMOGRAPHY)
    turned = find_corners(np.ascontiguousarray(picture[::-1, ::-1]), BOARD)
    assert turned is not None
    assert turned[0].sum() < turned[-1].sum()


def test_right_corners_that_start_at_the_other_end_are_put_into_the_left_order() -> None:
    left = true_corners()
    assert same_order(left, left[::-1] - [30.0, 0.0]) == pytest.approx(left - [30.0, 0.0])
    assert same_order(left, left - [30.0, 0.0]) == pytest.approx(left - [30.0, 0.0])


def test_an_image_without_a_board_has_no_corners() -> None:
    assert find_corners(np.full((120, 160), 90, dtype=np.uint8), BOARD) is None


@pytest.mark.parametrize(
    ("columns", "rows", "square_m"), [(5, 5, 0.03), (2, 5, 0.03), (7, 5, 30.0), (7, 5, float("nan"))]
)
def test_impossible_boards_are_refused(columns: int, rows: int, square_m: float) -> None:
    with pytest.raises(ValueError, match="board"):
        Board(columns, rows, square_m)
