"""Where the camera sits on the arm's base: hand-eye calibration with the board held by the arm's tool.

The camera is fixed beside the arm (eye to hand). Each pose of the arm gives ``arm_from_tool`` by its joint angles and
``camera_from_board`` by both images; ``arm_from_camera`` and ``tool_from_board`` are the same in all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from robot.geometry import Transform
from robot.vision.hand_eye_start import closed_form, turns_between

Array = npt.NDArray[np.float64]

MIN_POSES = 6
LEAST_TURN_RAD = np.radians(6.0)  # root mean square between two poses, about the second axis
_FOLDS = 5
_LOSS_SIGMAS = 2.0
_OUTLIER_SIGMAS = 4.0
_FLOOR = np.diag([1e-4] * 3 + [1e-4] * 3) ** 2  # radians and metres: play and sag that no joint angle tells


@dataclass(frozen=True, slots=True, eq=False)
class ArmPose:
    """One pose of the arm. Covariances are (6, 6) of (turn, radians; shift, metres):
    ``tool_covariance`` in the tool's frame, ``board_covariance`` about the left camera's axes.
    """

    name: str
    arm_from_tool: Transform
    camera_from_board: Transform
    tool_covariance: Array
    board_covariance: Array


@dataclass(frozen=True, slots=True)
class PoseResidual:
    """How far the board in one pose is, by the arm, from where the camera sees it (at the tool)."""

    name: str
    shift_m: float
    turn_rad: float
    outlier: bool


@dataclass(frozen=True, slots=True, eq=False)
class HandEye:
    """``covariance`` (6, 6) of the camera's mount: turn about the arm's axes (radians), shift along them (metres).

    ``*_rms_*`` over all poses, and over poses held out of the solution.
    """

    arm_from_camera: Transform
    tool_from_board: Transform
    covariance: Array
    residuals: tuple[PoseResidual, ...]
    held_out: tuple[PoseResidual, ...]

    @property
    def sigma_m(self) -> Array:
        """(3,) along the arm's axes."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[3:]))

    @property
    def sigma_rad(self) -> Array:
        """(3,) about the arm's axes."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[:3]))


def rms(residuals: Sequence[PoseResidual]) -> tuple[float, float]:
    """Root mean square shift (m) and turn (rad)."""
    shifts_m, turns_rad = [r.shift_m for r in residuals], [r.turn_rad for r in residuals]
    return float(np.sqrt(np.mean(np.square(shifts_m)))), float(np.sqrt(np.mean(np.square(turns_rad))))


def solve_hand_eye(poses: Sequence[ArmPose]) -> HandEye:
    """Closed form, then least squares on the six residuals of each pose, each by its own certainty, outliers damped.

    ``ValueError`` with advice for too few poses, non-finite ones, and turns about fewer than two axes.
    """
    _check(poses)
    arm_from_camera, tool_from_board, covariance = _solve(poses)
    held_out: list[PoseResidual] = []
    for chunk in np.array_split(np.arange(len(poses)), min(_FOLDS, len(poses))):
        rest = [pose for index, pose in enumerate(poses) if index not in chunk]
        camera, board, _ = _solve(rest)
        held_out += _residuals([poses[index] for index in chunk], camera, board)
    residuals = _residuals(poses, arm_from_camera, tool_from_board)
    return HandEye(arm_from_camera, tool_from_board, covariance, residuals, tuple(held_out))


def _check(poses: Sequence[ArmPose]) -> None:
    if len(poses) < MIN_POSES:
        raise ValueError(f"at least {MIN_POSES} poses with the board in both images are needed, found {len(poses)}; "
                         "take 15 to 20")  # fmt: skip
    for pose in poses:
        numbers = [pose.arm_from_tool.matrix(), pose.camera_from_board.matrix(), pose.tool_covariance]
        if not all(np.isfinite(array).all() for array in (*numbers, pose.board_covariance)):
            raise ValueError(f"pose {pose.name} holds NaN or infinity; take it away")
    turns = turns_between([p.arm_from_tool for p in poses], [p.camera_from_board for p in poses])
    spread_rad, axes = turns.spread_rad() if len(turns.in_arm) >= 3 else (np.zeros(3), np.eye(3))
    if spread_rad[0] < LEAST_TURN_RAD:
        raise ValueError("the tool was never turned; turn it by 20 to 40 degrees about two axes or more")
    if spread_rad[1] < LEAST_TURN_RAD:
        axis = ", ".join(f"{value:.2f}" for value in axes[0])
        raise ValueError(
            f"the tool turned about one axis only ({axis} in the arm's base), which leaves the camera's place along it "
            "open; turn it by 20 to 40 degrees about another axis as well"
        )


def _solve(poses: Sequence[ArmPose]) -> tuple[Transform, Transform, Array]:
    arms, boards = [pose.arm_from_tool for pose in poses], [pose.camera_from_board for pose in poses]
    camera, board = closed_form(arms, boards, turns_between(arms, boards))
    whiten = np.linalg.inv(np.linalg.cholesky(np.stack([_covariance(pose, camera, board) for pose in poses])))
    stacked = _Stacked.of(poses)

    def changed(change: Array) -> tuple[Transform, Transform]:
        return _moved(camera, change[:6]), _moved(board, change[6:])

    def misses(change: Array) -> Array:
        return np.asarray((whiten @ stacked.misses(*changed(change))[:, :, None]).ravel())

    fit = least_squares(misses, np.zeros(12), x_scale="jac", loss="soft_l1", f_scale=_LOSS_SIGMAS)
    freedom = max(len(fit.fun) - 12, 1)
    variance = max(1.0, 2.0 * float(fit.cost) / freedom)  # no better than the poses are said to be
    jacobian = np.asarray(fit.jac, dtype=np.float64)
    covariance = variance * np.linalg.pinv(jacobian.T @ jacobian)
    return *changed(fit.x), np.asarray(covariance[:6, :6])


def _moved(transform: Transform, change: Array) -> Transform:
    turn = Rotation.from_rotvec(change[:3]).as_matrix()
    return Transform(turn @ transform.rotation, transform.translation_m + change[3:])


@dataclass(frozen=True, slots=True, eq=False)
class _Stacked:
    """Poses (n) as arrays: rotations (n, 3, 3) and translations (n, 3, 1)."""

    tool_from_arm: Array
    arm_from_tool_m: Array
    camera_from_board: Array
    camera_from_board_m: Array

    @staticmethod
    def of(poses: Sequence[ArmPose]) -> _Stacked:
        return _Stacked(
            np.stack([pose.arm_from_tool.rotation.T for pose in poses]),
            np.stack([pose.arm_from_tool.translation_m for pose in poses])[:, :, None],
            np.stack([pose.camera_from_board.rotation for pose in poses]),
            np.stack([pose.camera_from_board.translation_m for pose in poses])[:, :, None],
        )

    def misses(self, arm_from_camera: Transform, tool_from_board: Transform) -> Array:
        """(n, 6) turn and shift from the tool by the arm to the tool by the camera, in the tool's frame."""
        board_from_tool = tool_from_board.inverse()
        turn = self.tool_from_arm @ arm_from_camera.rotation @ self.camera_from_board @ board_from_tool.rotation
        in_camera_m = self.camera_from_board @ board_from_tool.translation_m[:, None] + self.camera_from_board_m
        in_arm_m = arm_from_camera.rotation @ in_camera_m + arm_from_camera.translation_m[:, None]
        shift_m = self.tool_from_arm @ (in_arm_m - self.arm_from_tool_m)
        return np.column_stack([Rotation.from_matrix(turn).as_rotvec(), shift_m[:, :, 0]])


def _covariance(pose: ArmPose, arm_from_camera: Transform, tool_from_board: Transform) -> Array:
    """Of ``_miss``: the arm's part, and the board's seen from the tool's origin."""
    tool_from_camera = pose.arm_from_tool.rotation.T @ arm_from_camera.rotation
    x, y, z = pose.camera_from_board.rotate(tool_from_board.inverse().translation_m)
    lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    carry = np.block([[tool_from_camera, np.zeros((3, 3))], [-tool_from_camera @ lever, tool_from_camera]])
    return np.asarray(carry @ pose.board_covariance @ carry.T + pose.tool_covariance + _FLOOR)


def _residuals(
    poses: Sequence[ArmPose], arm_from_camera: Transform, tool_from_board: Transform
) -> tuple[PoseResidual, ...]:
    misses = _Stacked.of(poses).misses(arm_from_camera, tool_from_board)
    squared = np.array(
        [
            miss @ np.linalg.solve(_covariance(pose, arm_from_camera, tool_from_board), miss) / 6.0
            for miss, pose in zip(misses, poses, strict=True)
        ]
    )
    usual = max(1.0, float(np.median(squared)))
    return tuple(
        PoseResidual(
            pose.name,
            float(np.linalg.norm(miss[3:])),
            float(np.linalg.norm(miss[:3])),
            bool(size > _OUTLIER_SIGMAS**2 * usual / 2.0),
        )
        for pose, miss, size in zip(poses, misses, squared, strict=True)
    )
