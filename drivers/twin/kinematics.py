"""The twin's own forward kinematics, from the arm's URDF."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from drivers.twin.solids import Capsule

Array = npt.NDArray[np.float64]

ARM_DENSITY_KG_M3 = 1400.0
GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """One joint of the chain: ``origin`` (4, 4) parent link to joint; ``index`` of its angle, None if fixed."""

    name: str
    child: str
    origin: Array
    axis: Array
    index: int | None
    low_rad: float
    high_rad: float
    effort_n_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A capsule of a link, in the link's frame."""

    link: str
    p0_m: Array
    p1_m: Array
    radius_m: float
    middle_m: Array = field(init=False)
    mass_kg: float = field(init=False)

    def __post_init__(self) -> None:
        length = math.dist(self.p0_m, self.p1_m)
        volume = math.pi * self.radius_m**2 * (length + 4.0 / 3.0 * self.radius_m)
        object.__setattr__(self, "middle_m", 0.5 * (self.p0_m + self.p1_m))
        object.__setattr__(self, "mass_kg", ARM_DENSITY_KG_M3 * volume)


@dataclass(frozen=True, slots=True, eq=False)
class ArmGeometry:
    """The chain from the root link to the link ``nozzle``, and the links' capsules."""

    root: str
    chain: tuple[Joint, ...]
    bodies: tuple[Body, ...]
    _mass_kg: dict[str, float] = field(init=False)
    _moment_kg_m: dict[str, Array] = field(init=False)

    def __post_init__(self) -> None:
        """Mass and first moment of each link, in its own frame."""
        links = [self.root, *(joint.child for joint in self.chain)]
        mass, moment = dict.fromkeys(links, 0.0), dict.fromkeys(links, np.zeros(3))
        for body in self.bodies:
            mass[body.link] += body.mass_kg
            moment[body.link] = moment[body.link] + body.mass_kg * body.middle_m
        object.__setattr__(self, "_mass_kg", mass)
        object.__setattr__(self, "_moment_kg_m", moment)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The movable joints from the base outwards."""
        return tuple(joint for joint in self.chain if joint.index is not None)

    @property
    def joint_names(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.joints)

    def link_poses(self, angles_rad: Sequence[float] | Array) -> dict[str, Array]:
        """(4, 4) root_from_link of every link on the chain."""
        pose = np.eye(4)
        poses = {self.root: pose}
        for joint in self.chain:
            pose = pose @ joint.origin
            if joint.index is not None:
                pose = pose @ _turn(joint.axis, float(angles_rad[joint.index]))
            poses[joint.child] = pose
        return poses

    def nozzle_pose(self, angles_rad: Sequence[float] | Array) -> Array:
        """(4, 4) root_from_nozzle; the spray axis is its x."""
        return self.link_poses(angles_rad)["nozzle"]

    def capsules(self, angles_rad: Sequence[float] | Array, row_from_root: Array) -> tuple[Capsule, ...]:
        """The arm's bodies in the row frame."""
        poses = self.link_poses(angles_rad)
        out = []
        for body in self.bodies:
            pose = row_from_root @ poses[body.link]
            rotation, shift = pose[:3, :3], pose[:3, 3]
            out.append(Capsule(rotation @ body.p0_m + shift, rotation @ body.p1_m + shift, body.radius_m))
        return tuple(out)

    def gravity_torque_n_m(self, angles_rad: Sequence[float] | Array, up: Array) -> Array:
        """Torque (n,) that gravity puts on each joint, about its axis; ``up`` (3,) in the root frame."""
        poses = self.link_poses(angles_rad)
        x, y, z = up
        turn_up = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        mass, moment, torques = 0.0, np.zeros(3), []
        for joint in reversed(self.chain):
            pose = poses[joint.child]
            link_kg = self._mass_kg[joint.child]
            mass += link_kg
            moment = moment + pose[:3, :3] @ self._moment_kg_m[joint.child] + link_kg * pose[:3, 3]
            if joint.index is not None:  # axis . (lever x weight) = -g (up x axis) . lever
                lever = moment - mass * pose[:3, 3]
                torques.append(-GRAVITY_M_S2 * float(turn_up @ (pose[:3, :3] @ joint.axis) @ lever))
        return np.array(torques[::-1])


def read_urdf(text: str) -> ArmGeometry:
    """The arm of a URDF with revolute and fixed joints. Raises ``ValueError`` naming what is wrong."""
    try:
        robot = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"arm URDF: expected XML, found {error}; correct the file") from error
    by_child = {_link_of(joint, "child"): joint for joint in robot.iterfind("joint")}
    if "nozzle" not in by_child:
        raise ValueError("arm URDF: expected a joint whose child link is 'nozzle', found none; add the nozzle link")
    path: list[ElementTree.Element] = []
    link = "nozzle"
    while link in by_child:
        path.insert(0, by_child[link])
        link = _link_of(by_child[link], "parent")
        if len(path) > len(by_child):
            raise ValueError("arm URDF: expected a chain, found a loop of joints; correct the parents")
    chain: list[Joint] = []
    moving = 0
    for element in path:
        joint = _joint(element, moving)
        moving += joint.index is not None
        chain.append(joint)
    on_chain = {link, *(joint.child for joint in chain)}
    bodies = tuple(
        _body(element.get("name", ""), collision)
        for element in robot.iterfind("link")
        if element.get("name") in on_chain
        for collision in element.iterfind("collision")
    )
    return ArmGeometry(link, tuple(chain), bodies)


def _link_of(joint: ElementTree.Element, role: str) -> str:
    element = joint.find(role)
    name = element.get("link") if element is not None else None
    if name is None:
        raise ValueError(f"arm URDF: joint {joint.get('name')!r} expected a {role} link, found none; add it")
    return name


def _joint(element: ElementTree.Element, index: int) -> Joint:
    name, kind = element.get("name", ""), element.get("type")
    child, origin = _link_of(element, "child"), _origin(element)
    if kind == "fixed":
        return Joint(name, child, origin, np.array([1.0, 0.0, 0.0]), None, 0.0, 0.0, 0.0)
    limit, axis = element.find("limit"), element.find("axis")
    if kind != "revolute" or limit is None:
        raise ValueError(f"arm URDF: joint {name!r} expected revolute with limits or fixed, found {kind}; correct it")
    direction = _numbers(axis.get("xyz", "1 0 0") if axis is not None else "1 0 0")
    return Joint(
        name=name,
        child=child,
        origin=origin,
        axis=direction / np.linalg.norm(direction),
        index=index,
        low_rad=float(limit.get("lower", -math.pi)),
        high_rad=float(limit.get("upper", math.pi)),
        effort_n_m=float(limit.get("effort", 1.0)),
    )


def _body(link: str, collision: ElementTree.Element) -> Body:
    cylinder = collision.find("geometry/cylinder")
    if cylinder is None:
        raise ValueError(f"arm URDF: link {link!r} expected a cylinder as collision geometry, found another; use one")
    origin, half = _origin(collision), 0.5 * float(cylinder.get("length", 0.0))
    along = origin[:3, 2] * half
    return Body(link, origin[:3, 3] - along, origin[:3, 3] + along, float(cylinder.get("radius", 0.0)))


def _origin(element: ElementTree.Element) -> Array:
    """(4, 4) of an ``<origin>``: fixed-axis roll, pitch, yaw."""
    found = element.find("origin")
    pose = np.eye(4)
    if found is not None:
        roll, pitch, yaw = _numbers(found.get("rpy", "0 0 0"))
        turn = _turn(np.array([0.0, 0.0, 1.0]), yaw) @ _turn(np.array([0.0, 1.0, 0.0]), pitch)
        pose = turn @ _turn(np.array([1.0, 0.0, 0.0]), roll)
        pose[:3, 3] = _numbers(found.get("xyz", "0 0 0"))
    return pose


def _numbers(text: str) -> Array:
    values = np.array([float(word) for word in text.split()])
    if values.shape != (3,):
        raise ValueError(f"arm URDF: expected three numbers, found {text!r}; correct it")
    return values


def _turn(axis: Array, angle_rad: float) -> Array:
    """(4, 4) rotation about a unit axis."""
    x, y, z = axis
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    d = 1.0 - c
    return np.array(
        [
            [c + x * x * d, x * y * d - z * s, x * z * d + y * s, 0.0],
            [y * x * d + z * s, c + y * y * d, y * z * d - x * s, 0.0],
            [z * x * d - y * s, z * y * d + x * s, c + z * z * d, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
