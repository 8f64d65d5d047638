"""An arm's URDF -> a frozen model: joints, limits, the nozzle frame and the collision capsules."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import numpy as np

from robot.aiming.capsules import Capsule
from robot.errors import ConfigError
from robot.geometry import Transform, Vector, identity, transform_from_xyz_rpy

NOZZLE_LINK = "nozzle"


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A revolute joint. ``parent_from_joint`` at angle 0, from the link of the joint before (or the root);
    ``axis`` (3,) unit, in the joint's own frame."""

    name: str
    parent_from_joint: Transform
    axis: Vector
    lower_rad: float
    upper_rad: float
    velocity_rad_s: float
    effort_nm: float


@dataclass(frozen=True, slots=True, eq=False)
class LinkCapsule:
    """A collision capsule in the frame of link ``link``: 0 is the root, k the link behind joint k."""

    link: int
    name: str
    capsule: Capsule


@dataclass(frozen=True, slots=True, eq=False)
class ArmModel:
    """A serial arm with a nozzle. ``last_from_nozzle``: nozzle frame (+x sprays) in the link behind the last joint."""

    name: str
    joints: tuple[Joint, ...]
    last_from_nozzle: Transform
    capsules: tuple[LinkCapsule, ...]

    @property
    def joint_names(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.joints)

    @property
    def lower_rad(self) -> Vector:
        return np.array([joint.lower_rad for joint in self.joints])

    @property
    def upper_rad(self) -> Vector:
        return np.array([joint.upper_rad for joint in self.joints])

    @property
    def velocity_rad_s(self) -> Vector:
        return np.array([joint.velocity_rad_s for joint in self.joints])


def parse_urdf(text: str, source: str = "URDF") -> ArmModel:
    """Read an arm from URDF text; ``source`` names it in errors.

    The chain from the root to the link ``nozzle`` holds revolute and fixed joints only; other branches may be fixed.
    A collision cylinder becomes the capsule with the same axis and radius (half spheres beyond both ends).
    Raises ``ConfigError``. Format: http://wiki.ros.org/urdf/XML.
    """
    return _Reader(text, source).model()


class _Reader:
    def __init__(self, text: str, source: str) -> None:
        self._source = source
        try:
            self._root = ElementTree.fromstring(text)
        except ElementTree.ParseError as error:
            raise ConfigError(f"{source}: expected a URDF (XML), found {error}; mend the file") from error
        if self._root.tag != "robot":
            raise self._wrong("the top element <robot>", f"<{self._root.tag}>", "give a URDF file")
        self._links = self._by_name("link")
        self._joints = self._by_name("joint")
        self._joint_above = self._parents()

    def model(self) -> ArmModel:
        if NOZZLE_LINK not in self._links:
            found = ", ".join(self._links) or "no links"
            raise self._wrong(f"a link named '{NOZZLE_LINK}'", found, "add it with +x along the spray axis")
        joints: list[Joint] = []
        link_index: dict[str, tuple[int, Transform]] = {}
        offset = identity()
        chain = self._chain_to(NOZZLE_LINK)
        link_index[self._child_of(chain[0], "parent") if chain else NOZZLE_LINK] = (0, offset)
        for element in chain:
            kind = element.get("type", "")
            parent_from_child = offset @ self._origin(element)
            if kind == "revolute":
                joints.append(self._revolute(element, parent_from_child))
                offset = identity()
            elif kind == "fixed":
                offset = parent_from_child
            else:
                expected = f"joint '{self._name(element)}' of type revolute or fixed"
                raise self._wrong(expected, f"'{kind}'", "describe it as revolute with limits")
            link_index[self._child_of(element, "child")] = (len(joints), offset)
        if not joints:
            raise self._wrong("a revolute joint between root and nozzle", "none", "add the arm's joints")
        self._add_fixed_branches(link_index)
        return ArmModel(self._root.get("name", "arm"), tuple(joints), offset, self._capsules(link_index))

    def _by_name(self, tag: str) -> dict[str, ElementTree.Element]:
        found: dict[str, ElementTree.Element] = {}
        for element in self._root.findall(tag):
            name = self._name(element)
            if name in found:
                raise self._wrong(f"one {tag} named '{name}'", "two", "give each its own name")
            found[name] = element
        return found

    def _parents(self) -> dict[str, ElementTree.Element]:
        above: dict[str, ElementTree.Element] = {}
        for name, element in self._joints.items():
            for end in ("parent", "child"):
                link = self._child_of(element, end)
                if link not in self._links:
                    raise self._wrong(f"joint '{name}' to join known links", f"{end} '{link}'", "add that link")
            child = self._child_of(element, "child")
            if child in above:
                raise self._wrong(f"one joint above link '{child}'", f"'{name}' as well", "describe a tree, no loops")
            above[child] = element
        return above

    def _chain_to(self, link: str) -> list[ElementTree.Element]:
        chain: list[ElementTree.Element] = []
        while (joint := self._joint_above.get(link)) is not None:
            if joint in chain:
                raise self._wrong("a tree of links", f"a loop through joint '{self._name(joint)}'", "break the loop")
            chain.append(joint)
            link = self._child_of(joint, "parent")
        return chain[::-1]

    def _add_fixed_branches(self, link_index: dict[str, tuple[int, Transform]]) -> None:
        for name in self._links:
            branch: list[ElementTree.Element] = []
            link = name
            while link not in link_index and (joint := self._joint_above.get(link)) is not None and joint not in branch:
                branch.append(joint)
                link = self._child_of(joint, "parent")
            if link not in link_index:
                raise self._wrong(f"link '{name}' joined to the arm", "no joint to it", "join it or remove it")
            for joint in reversed(branch):
                if joint.get("type") != "fixed":
                    raise self._wrong(
                        f"only fixed joints beside the chain to '{NOZZLE_LINK}'",
                        f"joint '{self._name(joint)}' of type '{joint.get('type')}'",
                        "fix it or remove that branch",
                    )
                index, offset = link_index[self._child_of(joint, "parent")]
                link_index[self._child_of(joint, "child")] = (index, offset @ self._origin(joint))

    def _revolute(self, element: ElementTree.Element, parent_from_joint: Transform) -> Joint:
        name = self._name(element)
        limit = element.find("limit")
        if limit is None:
            raise self._wrong(f"joint '{name}' with <limit>", "none", "add lower, upper, velocity and effort")
        lower, upper, velocity, effort = (
            self._number(limit, key, f"<limit> of joint '{name}'") for key in ("lower", "upper", "velocity", "effort")
        )
        if lower >= upper:
            raise self._wrong(f"joint '{name}' with lower < upper", f"{lower} .. {upper} rad", "correct the limits")
        if velocity <= 0.0:
            raise self._wrong(f"joint '{name}' with velocity > 0", f"{velocity} rad/s", "correct the limit")
        axis_element = element.find("axis")
        axis = self._vector(axis_element, "xyz", (1.0, 0.0, 0.0), f"<axis> of joint '{name}'")
        length = float(np.linalg.norm(axis))
        if not 0.99 < length < 1.01:
            raise self._wrong(f"joint '{name}' with a unit axis", f"length {length:.3g}", "normalise the axis")
        return Joint(name, parent_from_joint, axis / length, lower, upper, velocity, effort)

    def _capsules(self, link_index: dict[str, tuple[int, Transform]]) -> tuple[LinkCapsule, ...]:
        capsules: list[LinkCapsule] = []
        for name, link in self._links.items():
            index, frame_from_link = link_index[name]
            for collision in link.findall("collision"):
                cylinder = collision.find("geometry/cylinder")
                if cylinder is None:
                    expected = f"cylinders as collision geometry of link '{name}'"
                    raise self._wrong(expected, "another shape", "use <cylinder>")
                what = f"<cylinder> of link '{name}'"
                radius, length = (self._number(cylinder, key, what) for key in ("radius", "length"))
                if radius <= 0.0 or length < 0.0:
                    raise self._wrong(f"{what} with radius > 0 and length >= 0", f"{radius}, {length} m", "correct it")
                pose = frame_from_link @ self._origin(collision)
                ends = pose.apply(np.array([[0.0, 0.0, -length / 2], [0.0, 0.0, length / 2]]))
                capsules.append(LinkCapsule(index, name, Capsule(ends[0], ends[1], radius)))
        return tuple(sorted(capsules, key=lambda item: item.link))

    def _origin(self, element: ElementTree.Element) -> Transform:
        origin = element.find("origin")
        what = f"<origin> in {element.tag} '{element.get('name', '')}'"
        zero = (0.0, 0.0, 0.0)
        xyz, rpy = (self._vector(origin, key, zero, what) for key in ("xyz", "rpy"))
        return transform_from_xyz_rpy(xyz.tolist(), rpy.tolist())

    def _vector(
        self, element: ElementTree.Element | None, key: str, default: tuple[float, float, float], what: str
    ) -> Vector:
        raw = None if element is None else element.get(key)
        if raw is None:
            return np.array(default)
        try:
            values = [float(part) for part in raw.split()]
        except ValueError:
            values = []
        if len(values) != 3 or not all(math.isfinite(value) for value in values):
            raise self._wrong(f"{what} with three numbers in {key}", f"'{raw}'", "correct it")
        return np.array(values)

    def _number(self, element: ElementTree.Element, key: str, what: str) -> float:
        raw = element.get(key)
        try:
            value = float(raw) if raw is not None else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self._wrong(f"{what} with a number '{key}'", "none" if raw is None else f"'{raw}'", f"add {key}")
        return value

    def _child_of(self, joint: ElementTree.Element, end: str) -> str:
        element = joint.find(end)
        link = None if element is None else element.get("link")
        if link is None:
            raise self._wrong(f"joint '{self._name(joint)}' with <{end} link=...>", "none", "add it")
        return link

    def _name(self, element: ElementTree.Element) -> str:
        name = element.get("name")
        if not name:
            raise self._wrong(f"a name for every <{element.tag}>", "one without", "name it")
        return name

    def _wrong(self, expected: str, found: str, remedy: str) -> ConfigError:
        return ConfigError(f"{self._source}: expected {expected}, found {found}; {remedy}")
