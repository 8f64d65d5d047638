"""Collision-free ways in joint space from a posture to the best of several goals: straight, else by vias."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.sparse.csgraph import dijkstra

from robot.aiming.collision import CollisionModel
from robot.aiming.inverse import inverse_kinematics
from robot.aiming.kinematics import link_frames
from robot.aiming.low_discrepancy import spread_between
from robot.aiming.parameters import AimingParameters
from robot.aiming.trajectory import MotionLimits, travel_time_s
from robot.geometry import Vector

_STRAIGHT_TRIED = 8
_VIAS = 96
_AROUND_RAD = 0.8
_EDGES_CHECKED = 40
_RETREATS_M = (0.06, 0.12)


class Roads:
    """Ways through one scene; each edge is checked once, and only when it lies on the best way found so far."""

    def __init__(self, collisions: CollisionModel, parameters: AimingParameters, limits: MotionLimits) -> None:
        self._collisions = collisions
        self._parameters = parameters
        self._limits = limits
        self._known: dict[tuple[bytes, bytes], bool] = {}

    def straight(self, start: Vector, goals: Vector, goal_costs_s: Vector) -> tuple[Vector, int] | None:
        """The straight move (2, n) with the least sum of travel time and goal cost, and the index of its goal.

        ``goals`` (m, n), ``goal_costs_s`` (m,); None when the cheapest few are blocked.
        """
        total_s = goal_costs_s + travel_time_s(goals - start, self._limits)
        for k in np.argsort(total_s, kind="stable")[:_STRAIGHT_TRIED]:
            if self.free(start, goals[k]):
                return np.stack([start, goals[k]]), int(k)
        return None

    def by_vias(self, start: Vector, goals: Vector, goal_costs_s: Vector) -> tuple[Vector, int] | None:
        """The cheapest way (k, n) to one of the goals in a graph of via points, and the index of that goal; or None.

        Vias: the ready pose, the nozzle drawn back from start and goals, and a fixed spread of postures around them.
        Lazy evaluation of edges: Bohlin, Kavraki, Path planning using lazy PRM (2000). Deterministic.
        """
        vias = self._vias(start, goals)
        nodes = np.concatenate([start[None], vias, goals])
        first_goal, arrived = len(nodes) - len(goals), len(nodes)
        cost_s = np.full((arrived + 1, arrived + 1), np.inf)
        cost_s[:first_goal, 1:arrived] = travel_time_s(nodes[:first_goal, None] - nodes[None, 1:], self._limits) + 1e-6
        cost_s[first_goal:arrived, arrived] = goal_costs_s - goal_costs_s.min() + 1e-6
        for _ in range(_EDGES_CHECKED):
            way = _cheapest(cost_s)
            if way is None:
                return None
            blocked = next((edge for edge in pairwise(way[:-1]) if not self.free(nodes[edge[0]], nodes[edge[1]])), None)
            if blocked is None:
                return nodes[way[:-1]], way[-2] - first_goal
            cost_s[blocked] = np.inf
        return None

    def free(self, start: Vector, end: Vector) -> bool:
        key = start.tobytes(), end.tobytes()
        if key not in self._known:
            self._known[key] = self._collisions.path_is_free(
                np.stack([start, end]), self._parameters.path_step_rad, self._parameters.path_sweep_m
            )
        return self._known[key]

    def _vias(self, start: Vector, goals: Vector) -> Vector:
        model = self._collisions.model
        ends = np.concatenate([start[None], goals])
        low = np.maximum(ends.min(axis=0) - _AROUND_RAD, model.lower_rad)
        high = np.minimum(ends.max(axis=0) + _AROUND_RAD, model.upper_rad)
        seed = np.clip(start, model.lower_rad, model.upper_rad)
        around = spread_between(low, high, _VIAS)
        around[:, -1] = seed[-1]
        ready = np.asarray(self._parameters.ready_rad, dtype=np.float64)[None]
        vias = np.concatenate([ready, self._drawn_back(seed, seed[None]), self._drawn_back(seed, goals), around])
        clear = self._collisions.clearances(vias).least_m() >= self._collisions.margin_m
        return np.asarray(vias[clear])

    def _drawn_back(self, seed: Vector, postures: Vector) -> Vector:
        """Postures near the given ones with the nozzle drawn back along its axis."""
        model = self._collisions.model
        frames = link_frames(model, postures)
        back_m = frames.nozzle_m[:, None] - np.array(_RETREATS_M)[:, None] * frames.spray_axis[:, None]
        axes = np.broadcast_to(frames.spray_axis[:, None], back_m.shape)
        found = inverse_kinematics(model, back_m, axes, seed)
        away = np.abs(found.joints_rad - postures[:, None, None]).max(axis=-1)
        away[~found.valid] = np.inf
        best = away.argmin(axis=-1)
        joints = np.take_along_axis(found.joints_rad, best[..., None, None], axis=2)[:, :, 0]
        return np.asarray(joints[np.isfinite(away.min(axis=-1))])


def _cheapest(cost_s: Vector) -> list[int] | None:
    """Nodes from the first to the last of a dense graph (inf: no edge), or None when there is no way."""
    reached, before = dijkstra(cost_s, indices=np.array(0), return_predecessors=True)
    if not np.isfinite(reached[-1]):
        return None
    way = [len(cost_s) - 1]
    while way[-1] != 0:
        way.append(int(before[way[-1]]))
    return way[::-1]
