"""A stereo rig as a JSON file."""

from __future__ import annotations

import difflib
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from robot.atomic_file import atomic_file
from robot.errors import ConfigError
from robot.vision.stereo_rig import StereoRig

Array = npt.NDArray[np.float64]

_REQUIRED = ("image_size", "K_left", "K_right", "dist_left", "dist_right", "R", "t_m")
_OPTIONAL = ("world_from_left",)
_DESCRIPTIVE = (
    "rig", "note", "dist_model", "distorted_images", "baseline_m", "rotation_deg", "right_camera_centre_in_left_m",
    "P_left", "P_right",
)  # fmt: skip
_REMEDY = "mend it or calibrate again with 'sprayer calibrate camera'"


def load_rig(path: Path) -> StereoRig:
    """Read and check a calibration; ``ConfigError`` names the file, the key, what was expected and what was found."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: the calibration cannot be read ({error.strerror}); check the path") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid JSON ({error}); {_REMEDY}") from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: expected a JSON object with {', '.join(_REQUIRED)}; {_REMEDY}")
    _check_keys(path, content)
    try:
        rig = StereoRig(
            image_size=_image_size(content["image_size"]),
            K_left=_camera_matrix(content, "K_left"),
            K_right=_camera_matrix(content, "K_right"),
            dist_left=_distortion(content, "dist_left"),
            dist_right=_distortion(content, "dist_right"),
            R=_rotation(_numbers(content, "R", (3, 3)), "R"),
            t_m=_numbers(content, "t_m", (3,)),
            world_from_left=_pose(content, "world_from_left"),
        )
        _check_rig(rig)
    except ValueError as error:
        raise ConfigError(f"{path}: {error}; {_REMEDY}") from error
    return rig


def save_rig(path: Path, rig: StereoRig) -> None:
    """Write a calibration, whole or not at all.

    Raises ``FileError`` when it cannot be written, ``ConfigError`` when it is none that ``load_rig`` would take.
    """
    try:
        _check_rig(rig)
    except ValueError as error:
        raise ConfigError(f"{path}: not written: {error}; check the images and the board") from error
    content: dict[str, Any] = {"image_size": list(rig.image_size)}
    for key in (*_REQUIRED[1:], *_OPTIONAL):
        value = getattr(rig, key)
        if value is not None:
            content[key] = np.asarray(value, dtype=np.float64).tolist()
    content["note"] = "x_right = R x_left + t_m; metres; pixel centres at integers; dist is k1 k2 p1 p2 k3"
    with atomic_file(path) as stream:
        stream.write((json.dumps(content, indent=1) + "\n").encode())


def _check_keys(path: Path, content: dict[str, Any]) -> None:
    for key in _REQUIRED:
        if key not in content:
            raise ConfigError(f"{path}: '{key}' is missing; {_REMEDY}")
    for key in content:
        if key not in (*_REQUIRED, *_OPTIONAL, *_DESCRIPTIVE):
            near = difflib.get_close_matches(key, (*_REQUIRED, *_OPTIONAL, *_DESCRIPTIVE), n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"known keys: {', '.join((*_REQUIRED, *_OPTIONAL))}"
            raise ConfigError(f"{path}: unknown key '{key}'; {hint}")


def _numbers(content: dict[str, Any], key: str, shape: tuple[int, ...]) -> Array:
    try:
        array = np.array(content[key], dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"'{key}' must be numbers of shape {shape}") from None
    if array.shape != shape:
        raise ValueError(f"'{key}' must have shape {shape}, found {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"'{key}' must be finite, found NaN or infinity")
    return array


def _image_size(value: Any) -> tuple[int, int]:
    if (
        not isinstance(value, list)
        or len(value) != 2
        or not all(isinstance(side, int) and not isinstance(side, bool) and 16 <= side <= 20_000 for side in value)
    ):
        raise ValueError(f"'image_size' must be [width, height] in pixels, found {json.dumps(value)}")
    return value[0], value[1]


def _camera_matrix(content: dict[str, Any], key: str) -> Array:
    K = _numbers(content, key, (3, 3))
    if K[1, 0] != 0.0 or not np.array_equal(K[2], [0.0, 0.0, 1.0]):
        raise ValueError(f"'{key}' must be [[fx, s, cx], [0, fy, cy], [0, 0, 1]], found {K.tolist()}")
    width, height = content["image_size"]
    if not all(0.2 * width <= focal <= 20.0 * width for focal in (K[0, 0], K[1, 1])):
        raise ValueError(
            f"'{key}' must have focal lengths of 0.2 to 20 image widths ({width} px), found {K[0, 0]} and {K[1, 1]}"
        )
    if not (0.0 <= K[0, 2] <= width and 0.0 <= K[1, 2] <= height):
        raise ValueError(f"'{key}' must have its principal point in the image, found ({K[0, 2]}, {K[1, 2]})")
    return K


def _distortion(content: dict[str, Any], key: str) -> Array:
    found = np.shape(content[key]) if isinstance(content[key], list) else ()
    return np.append(_numbers(content, key, (4,)), 0.0) if found == (4,) else _numbers(content, key, (5,))


def _rotation(matrix: Array, key: str) -> Array:
    """The rotation nearest to a matrix that is one to four digits."""
    if float(np.abs(matrix @ matrix.T - np.eye(3)).max()) > 1e-4 or float(np.linalg.det(matrix)) < 0.0:
        raise ValueError(f"'{key}' must be a rotation (orthonormal, determinant 1), found {matrix.tolist()}")
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ vt)


def _pose(content: dict[str, Any], key: str) -> Array | None:
    if content.get(key) is None:
        return None
    pose = _numbers(content, key, (4, 4))
    if not np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0]):
        raise ValueError(f"'{key}' must end with the row [0, 0, 0, 1], found {pose[3].tolist()}")
    pose[:3, :3] = _rotation(pose[:3, :3], key)
    return pose


def _check_rig(rig: StereoRig) -> None:
    if not 0.005 <= rig.baseline_m <= 2.0:
        raise ValueError(f"'t_m' must be 0.005..2 m long (metres, not millimetres), found {rig.baseline_m:.6g} m")
    right_centre_m = -rig.R.T @ rig.t_m
    if right_centre_m[0] < 0.5 * rig.baseline_m:
        raise ValueError(
            f"the right camera must lie to the right of the left one, found it at {right_centre_m.round(4).tolist()} m "
            "in the left camera's frame (left and right swapped?)"
        )
