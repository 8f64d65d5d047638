"""The closed outline round each circle: polar unwrapping, dynamic programming over the angle, robust circle."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from robot.vision.fruit.planes import Plane, Planes

Array = npt.NDArray[np.float64]
ANGLES = 48
RADII = 40
INNER, OUTER = 0.55, 1.5
"""The widest window of radii searched, as shares of the circle's radius; RADII of them are looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class Contours:
    """Outlines of n circles: ``points`` (n, ANGLES, 2) in working pixels; ``strength`` (n, ANGLES) of their edges."""

    points: Array
    strength: Array


def stack_of(planes: Planes, skin: Plane) -> Plane:
    """(h, w, 4) image the contours are traced in: skin, log light and the two chroma."""
    return np.asarray(cv2.merge([skin, planes.log_light, planes.red_green, planes.yellow_blue]), dtype=np.float32)


def directions() -> Array:
    """(ANGLES, 2) unit vectors, clockwise from +u in the image."""
    angle = np.arange(ANGLES) * (2 * np.pi / ANGLES)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def unwrap(stack: Plane, circles: Array, shares: Array) -> Plane:
    """(n, ANGLES, len(shares), channels) samples of the stack at centre + share * r * direction."""
    reach = circles[:, 2, None] * shares
    turn = directions()
    u = circles[:, 0, None, None] + turn[None, :, 0, None] * reach[:, None, :]
    v = circles[:, 1, None, None] + turn[None, :, 1, None] * reach[:, None, :]
    return sample(stack, u, v)


def sample(stack: Plane, u: Array, v: Array) -> Plane:
    """Bilinear samples (..., channels) of the stack at (u, v); beyond the border the border's value."""
    if u.size == 0:
        return np.zeros((*u.shape, stack.shape[2]), dtype=np.float32)
    columns = u.shape[-1]
    map_u = u.reshape(-1, columns).astype(np.float32)
    map_v = v.reshape(-1, columns).astype(np.float32)
    blocks = [
        cv2.remap(stack, map_u[k : k + 16384], map_v[k : k + 16384], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for k in range(0, len(map_u), 16384)
    ]
    return np.asarray(np.concatenate(blocks).reshape(*u.shape, -1), dtype=np.float32)


def trace(
    stack: Plane, circles: Array, stiffness: float = 0.25, window: tuple[float, float] = (INNER, OUTER)
) -> Contours:
    """The best closed outline round each of (n, 3) circles of u, v, r in working pixels."""
    if len(circles) == 0:
        return Contours(np.zeros((0, ANGLES, 2)), np.zeros((0, ANGLES)))
    radii = round(RADII * (window[1] - window[0]) / (OUTER - INNER))
    shares = np.linspace(window[0], window[1], radii)
    polar = unwrap(stack, circles, shares)
    edge = _edge_strength(polar, circles[:, 2] * (shares[1] - shares[0]))
    filled = np.cumsum(np.clip(polar[..., 0] - 0.35, -0.35, 0.35), axis=2) / RADII
    reward = np.asarray(edge + 1.5 * filled, dtype=np.float32)
    path = _best_closed_path(reward, stiffness)
    rows = np.arange(len(circles))[:, None]
    columns = np.arange(ANGLES)[None, :]
    here = reward[rows, columns, path]
    before = reward[rows, columns, np.maximum(path - 1, 0)]
    after = reward[rows, columns, np.minimum(path + 1, radii - 1)]
    bend = 2 * here - before - after
    step = np.where(bend > 1e-6, np.clip(0.5 * (after - before) / np.maximum(bend, 1e-6), -0.5, 0.5), 0.0)
    share = shares[0] + (path + step) * (shares[1] - shares[0])
    points = circles[:, None, :2] + (share * circles[:, 2, None])[..., None] * directions()[None]
    return Contours(points, edge[rows, columns, path].astype(np.float64))


def _edge_strength(polar: Plane, step_px: Array) -> Plane:
    """(n, ANGLES, RADII) 0..about 1: skin that ends, light or chroma that changes, over about two working pixels."""
    reach = int(np.clip(np.round(1.0 / max(float(np.median(step_px)), 1e-3)), 1, 5))
    padded = np.pad(polar, ((0, 0), (0, 0), (reach, reach), (0, 0)), mode="edge")
    change = padded[:, :, 2 * reach :] - padded[:, :, : -2 * reach]
    skin = np.clip(-change[..., 0], 0.0, 1.0)
    light = np.abs(change[..., 1])
    tint = np.abs(change[..., 2]) + 0.5 * np.abs(change[..., 3])
    return np.asarray(0.5 * skin + 0.3 * light / (light + 0.25) + 0.3 * tint / (tint + 0.12), dtype=np.float32)


def _best_closed_path(reward: Plane, stiffness: float) -> npt.NDArray[np.int64]:
    """(n, ANGLES) indices of the radius: dynamic programming over two turns, the second turn kept."""
    count, angles, radii = reward.shape
    turns = 2 * angles
    choice = np.empty((turns, count, radii), dtype=np.int8)
    slices = np.ascontiguousarray(reward.transpose(1, 0, 2))
    total = np.full((count, radii + 2), -np.inf, dtype=np.float32)
    total[:, 1:-1] = slices[0]
    for k in range(1, turns):
        stay = total[:, 1:-1]
        side = np.maximum(total[:, :-2], total[:, 2:]) - stiffness
        towards = np.where(total[:, :-2] >= total[:, 2:], np.int8(-1), np.int8(1))
        choice[k] = towards * (side > stay)
        total[:, 1:-1] = np.maximum(stay, side) + slices[k % angles]
    path = np.empty((turns, count), dtype=np.int64)
    path[-1] = total[:, 1:-1].argmax(axis=1)
    rows = np.arange(count)
    for k in range(turns - 1, 0, -1):
        path[k - 1] = path[k] + choice[k, rows, path[k]]
    return np.asarray(np.roll(path[angles // 2 : angles // 2 + angles], angles // 2, axis=0).T)


def fit_circles(contours: Contours, iterations: int = 4) -> tuple[Array, Array]:
    """Robust circles (n, 3) through the outlines and the residuals (n, ANGLES) in working pixels (Tukey, IRLS)."""
    points, strength = contours.points, contours.strength
    weights = strength.copy() + 1e-3
    circles = np.zeros((len(points), 3))
    residual = np.zeros(points.shape[:2])
    for _ in range(iterations):
        middle = points.mean(axis=1, keepdims=True)
        local = points - middle
        design = np.concatenate([2 * local, np.ones((*points.shape[:2], 1))], axis=2)
        right = (local**2).sum(axis=2)
        weighted = (design * weights[..., None]).transpose(0, 2, 1)
        normal = weighted @ design + 1e-9 * np.eye(3)
        solution = np.linalg.solve(normal, weighted @ right[..., None])[..., 0]
        centre = solution[:, :2] + middle[:, 0]
        radius = np.sqrt(np.maximum(solution[:, 2] + (solution[:, :2] ** 2).sum(axis=1), 1e-6))
        circles = np.column_stack([centre, radius])
        residual = np.linalg.norm(points - centre[:, None], axis=2) - radius[:, None]
        spread = 1.5 * np.median(np.abs(residual), axis=1) + 0.03 * radius + 0.1
        weights = (strength + 1e-3) * np.clip(1 - (residual / (3 * spread[:, None])) ** 2, 1e-4, None) ** 2
    return circles, residual
