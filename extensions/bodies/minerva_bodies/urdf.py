"""Robots in URDF: links as the solids of agents, joints between them.

    ARM = Urdf.read("robots/arm.urdf")
    vocabulary = Vocabulary.of(*ARM.symbols, ...)

An agent shows `ARM.links[name]` within the transformation of its pose, and with it
`ARM.joint(name, ...)` between the agent of its parent and itself: the frame of a joint is that of
its link, and its position is 0 where the links are at `ARM.poses`. Links at a fixed joint are a
part of their parent.

Format: http://wiki.ros.org/urdf/XML. Inertia is that of the collision solids, whose density follows
from the mass of the link. Visual solids are drawn only if a link has no collision solid.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import PurePosixPath
from typing import Any, Final
from xml.parsers import expat

import numpy as np

from minerva_bodies.errors import BodiesError
from minerva_bodies.forms import (
    Ball,
    Box,
    Cylinder,
    Joint,
    Matter,
    Mesh,
    quaternion,
)
from minerva_bodies.meshes import load_mesh, read_asset
from minerva_bodies.rigid import Rigid
from minerva_bus import Default, Metres, Primitive, Scene, Transformation
from minerva_bus.grammar.appearance import Disc
from minerva_bus.grammar.scene import EMPTY

_TYPES: Final = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
}
_PACKAGE: Final = "package://"
_MAX_DEPTH, _MAX_ELEMENTS = 30, 100_000
_AXES = dict.fromkeys("xyz", Default(Metres, 0.0)) | {"w": Default(float, 1.0)}

TPlace: Final = Transformation(
    "TPlace",
    quaternion("x", "y", "z", "w", "i", "j", "k"),
    **_AXES,
    **dict.fromkeys("ijk", Default(float, 0.0)),
)
"""The place of a link, or of a solid in it."""


@dataclass(slots=True)
class _Element:
    """An element of an XML file, with its line."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[_Element] = field(default_factory=list["_Element"])

    def all(self, tag: str) -> Iterator[_Element]:
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> _Element | None:
        return next(self.all(tag), None)


@dataclass(frozen=True, slots=True)
class UrdfJoint:
    """A joint by which a link moves.

    Attributes:
        name: its name.
        kind: revolute or prismatic.
        parent: the link that carries it.
        place: its pose in the parent, which is that of the child at position 0.
        primitive: its symbol.

    """

    name: str
    kind: str
    parent: str
    place: Rigid
    primitive: Primitive


@dataclass(frozen=True, slots=True)
class Urdf:
    """A robot: links that move, in the order of the file, each with its string.

    Attributes:
        name: of the robot.
        links: the solids of each link that is an agent.
        joints: the joint by which each of them but the first hangs on another one.
        poses: the pose of each in the frame of the first, where all joints are at position 0.
        symbols: primitives and transformations, for the vocabulary.

    """

    name: str
    links: Mapping[str, Scene]
    joints: Mapping[str, UrdfJoint]
    poses: Mapping[str, Rigid]
    symbols: tuple[Primitive | Transformation, ...]

    @staticmethod
    def read(
        file: str, *, matter: Matter | None = None, color: str = "#8a8f98", fixed: bool = True
    ) -> Urdf:
        """The robot of an asset; see `meshes` for its name.

        Args:
            file: the asset.
            matter: friction, restitution and group of all solids; its density is that of links
                without a mass.
            color: of links without a material that has one.
            fixed: whether its first link stands fast.

        Raises BodiesError for a file that is none, with its line.

        """
        name, data = read_asset(f"robot {file!r}", file)
        return _Reader(name, matter or Matter(), color, fixed).robot(data)

    def joint(
        self,
        link: str,
        parent: str,
        child: str,
        *,
        target: float = 0.0,
        stiffness: float = 0.0,
        speed: float = 0.0,
        damping: float = 0.0,
    ) -> Scene:
        """The string of a link's joint between two agents, with its motor; see `forms.Joint`."""
        return self.joints[link].primitive(parent, child, target, stiffness, speed, damping)


class _Reader:
    """Reads one file."""

    def __init__(self, file: str, matter: Matter, color: str, fixed: bool) -> None:
        self._file, self._matter, self._color, self._fixes = file, matter, color, fixed
        self._colors: dict[str, str] = {}
        self._symbols: list[Primitive | Transformation] = [TPlace]
        self._title = ""

    def robot(self, data: bytes) -> Urdf:
        root = self._parsed(data)
        if root.tag != "robot":
            raise self._error(root, f"the outermost element is <{root.tag}>; expected <robot>")
        self._title = _words(self._name(root))
        for material in root.all("material"):
            self._material(material)
        links = self._named(root, "link")
        if not links:
            raise self._error(root, "a robot without a <link>")
        hanging = self._joints(root, links)
        order = self._order(root, links, hanging)
        self._root = links[order[0]]
        poses, owner = dict[str, Rigid](), dict[str, str]()
        solids = dict[str, Scene]()
        joints = dict[str, UrdfJoint]()
        for name in order:
            joint = hanging.get(name)
            place, parent = Rigid(), ""
            if joint is not None:
                parent = self._attribute(self._child(joint, "parent"), "link")
                place = poses[parent].then(self._origin(joint))
            poses[name] = place
            fixed = joint is not None and joint.attributes["type"] == "fixed"
            owner[name] = owner[parent] if fixed else name
            within = poses[owner[name]].inverse().then(place)
            solids[owner[name]] = solids.get(owner[name], EMPTY) + self._solids(links[name], within)
            if joint is not None and not fixed:
                carrier = owner[parent]
                at = poses[carrier].inverse().then(place)
                joints[name] = self._joint(joint, carrier, at)
        for name, scene in solids.items():
            if not scene:
                raise self._error(
                    links[name], f"the link {name!r} has no solid; a body that moves needs one"
                )
        moving = {name: poses[name] for name in solids}
        return Urdf(self._title, solids, joints, moving, tuple(self._symbols))

    # --- the tree ---

    def _parsed(self, data: bytes) -> _Element:
        """The elements of the file. Raises BodiesError."""
        parser = expat.ParserCreate()
        top = _Element("", {}, 0)
        open_elements, count = [top], 0

        def begin(tag: str, attributes: dict[str, str]) -> None:
            nonlocal count
            count += 1
            element = _Element(tag, attributes, parser.CurrentLineNumber)
            if len(open_elements) > _MAX_DEPTH or count > _MAX_ELEMENTS:
                raise self._error(element, "too many elements")
            open_elements[-1].children.append(element)
            open_elements.append(element)

        def end(_: str) -> None:
            open_elements.pop()

        def refused(*_: Any) -> None:
            # Entities could expand to gigabytes, or name other files.
            at = _Element("", {}, parser.CurrentLineNumber)
            raise self._error(at, "a document type declaration; remove <!DOCTYPE ...>")

        parser.StartElementHandler, parser.EndElementHandler = begin, end
        parser.StartDoctypeDeclHandler = refused
        try:
            parser.Parse(data, True)
        except expat.ExpatError as error:
            at = _Element("", {}, error.lineno)
            raise self._error(at, f"no XML: {expat.ErrorString(error.code)}") from None
        return top.children[0]

    def _joints(self, root: _Element, links: Mapping[str, _Element]) -> Mapping[str, _Element]:
        """The joint of each child. Raises BodiesError for strangers and unknown types."""
        hanging = dict[str, _Element]()
        for name, joint in self._named(root, "joint").items():
            kind = self._attribute(joint, "type")
            if kind not in _TYPES:
                raise self._error(
                    joint, f"the joint {name!r} is {kind}; expected {', '.join(_TYPES)}"
                )
            if mimic := joint.first("mimic"):
                raise self._error(mimic, f"the joint {name!r} follows another; remove <mimic>")
            for end in ("parent", "child"):
                link = self._attribute(self._child(joint, end), "link")
                if link not in links:
                    raise self._error(joint, f"the joint {name!r}: there is no link {link!r}")
            child = self._attribute(self._child(joint, "child"), "link")
            if child in hanging:
                raise self._error(joint, f"the link {child!r} is the child of two joints")
            hanging[child] = joint
        return hanging

    def _order(
        self, root: _Element, links: Mapping[str, _Element], hanging: Mapping[str, _Element]
    ) -> list[str]:
        """Links after their parents. Raises BodiesError for several roots, or a circle."""
        roots = [name for name in links if name not in hanging]
        if len(roots) != 1:
            raise self._error(root, f"{len(roots)} links have no parent; expected one")
        order = roots
        for parent in order:
            children = [
                child
                for child, joint in hanging.items()
                if self._attribute(self._child(joint, "parent"), "link") == parent
            ]
            order += children
        if len(order) < len(links):
            lost = next(name for name in links if name not in order)
            raise self._error(links[lost], f"the link {lost!r} hangs on itself in a circle")
        return order

    # --- links and joints ---

    def _solids(self, link: _Element, within: Rigid) -> Scene:
        """The solids of a link, at its pose in the body that it is a part of."""
        shown = list(link.all("collision")) or list(link.all("visual"))
        color = next(map(self._color_of, link.all("visual")), self._color)
        solids = [self._solid(each) for each in shown]
        volume = sum(solid.volume for solid in solids)
        density = self._matter.density
        inertial = link.first("inertial")
        if inertial is not None and volume:
            mass = self._number(self._child(inertial, "mass"), "value")
            if not mass > 0.0:
                raise self._error(inertial, f"a mass of {mass:g} kg; expected more than 0")
            density = mass / volume
        made_of = self._matter
        matter = Matter(
            density,
            made_of.friction,
            made_of.restitution,
            fixed=self._fixes and link is self._root,
            group=made_of.group,
        )
        name, scene = _words(self._name(link)), EMPTY
        for number, solid in enumerate(solids):
            title = f"P{self._title}{name}{number or ''}"
            file = {"file": Default(str, solid.file)} if solid.file else {}
            try:
                form = solid.form(color=color, matter=matter, meaning=self._title.lower())
            except BodiesError as error:
                raise self._error(shown[number], str(error)) from None
            primitive = Primitive(title, form, **file)
            self._symbols.append(primitive)
            scene += TPlace(*within.then(solid.place).numbers)(primitive())
        return scene

    def _solid(self, element: _Element) -> _Solid:
        """The solid of a collision or visual element. Raises BodiesError."""
        geometry = self._child(element, "geometry")
        shape = next(iter(geometry.children), geometry)
        place = self._origin(element)
        if shape.tag == "box":
            x, y, z = (each / 2 for each in self._numbers(shape, "size", 3))
            return _Solid(partial(Box, x, y, z), place, 8 * x * y * z)
        if shape.tag == "sphere":
            radius = self._number(shape, "radius")
            return _Solid(partial(Ball, radius), place, 4 / 3 * math.pi * radius**3)
        if shape.tag == "cylinder":
            half, radius = self._number(shape, "length") / 2, self._number(shape, "radius")
            return _Solid(partial(Cylinder, half, radius), place, 2 * math.pi * half * radius**2)
        if shape.tag != "mesh":
            raise self._error(
                shape, f"the geometry <{shape.tag}>; expected box, sphere, cylinder or mesh"
            )
        file, scales = self._attribute(shape, "filename"), [1.0]
        if "scale" in shape.attributes:
            scales = self._numbers(shape, "scale", 3)
        if len(set(scales)) > 1:
            raise self._error(shape, "a mesh with different scales; expected equal ones")
        if file.startswith(_PACKAGE):
            file = file.removeprefix(_PACKAGE)
        else:
            file = str(PurePosixPath(self._file).parent / file)
        try:
            points, triangles = load_mesh(file)
        except BodiesError as error:
            raise self._error(shape, str(error)) from None
        a, b, c = (scales[0] * points)[triangles].swapaxes(0, 1)
        volume = abs(float((a * np.cross(b, c)).sum())) / 6
        reach = scales[0] * float(np.abs(points[:, :2]).max())
        return _Solid(partial(Mesh, "file", scales[0], radius=reach), place, volume, file)

    def _joint(self, joint: _Element, parent: str, place: Rigid) -> UrdfJoint:
        name, kind = self._name(joint), _TYPES[joint.attributes["type"]]
        axis, limit = joint.first("axis"), joint.first("limit")
        x, y, z = (1.0, 0.0, 0.0) if axis is None else self._numbers(axis, "xyz", 3)
        if not x * x + y * y + z * z > 0.0:
            raise self._error(joint, f"the joint {name!r}: its axis has no length")
        low = high = 0.0
        if joint.attributes["type"] != "continuous":
            if limit is None:
                raise self._error(joint, f"the joint {name!r} has no <limit>")
            unit = 1.0 if kind == "prismatic" else math.degrees(1.0)
            low, high = (unit * self._number(limit, end, 0.0) for end in ("lower", "upper"))
        if low > high:
            raise self._error(joint, f"the joint {name!r}: its limits are {low:g} to {high:g}")
        motor = dict.fromkeys(("target", "stiffness", "speed", "damping"), Default(float, 0.0))
        form = Joint(
            kind,
            "parent",
            "child",
            axis=(x, y, z),
            low=low,
            high=high,
            **{measure: measure for measure in motor},
            meaning="joint",
        )
        title = f"P{self._title}{_words(name)}Joint"
        primitive = Primitive(title, form, parent=str, child=str, **motor)
        self._symbols.append(primitive)
        return UrdfJoint(name, kind, parent, place, primitive)

    # --- elements and attributes ---

    def _named(self, root: _Element, tag: str) -> dict[str, _Element]:
        named = dict[str, _Element]()
        for element in root.all(tag):
            name = self._name(element)
            if name in named:
                raise self._error(element, f"the {tag} {name!r} appears twice")
            named[name] = element
        return named

    def _name(self, element: _Element) -> str:
        name = self._attribute(element, "name")
        if not _words(name):
            raise self._error(element, f"the name {name!r} has no letters")
        return name

    def _child(self, element: _Element, tag: str) -> _Element:
        child = element.first(tag)
        if child is None:
            raise self._error(element, f"<{element.tag}> has no <{tag}>")
        return child

    def _attribute(self, element: _Element, name: str) -> str:
        if name not in element.attributes:
            raise self._error(element, f"<{element.tag}> has no {name}")
        return element.attributes[name]

    def _number(self, element: _Element, name: str, otherwise: float | None = None) -> float:
        if name not in element.attributes and otherwise is not None:
            return otherwise
        return self._numbers(element, name, 1)[0]

    def _numbers(self, element: _Element, name: str, count: int) -> list[float]:
        text = self._attribute(element, name)
        try:
            numbers = [float(word) for word in text.split()]
        except ValueError:
            numbers = []
        if len(numbers) != count or not all(abs(number) < 1e6 for number in numbers):
            wanted = f"{count} numbers" if count > 1 else "a number"
            raise self._error(
                element, f"{name}={text!r:.60} of <{element.tag}>; expected {wanted} below 1e6"
            )
        return numbers

    def _origin(self, element: _Element) -> Rigid:
        """The pose of an element's origin: metres, and roll, pitch, yaw in radians."""
        origin = element.first("origin")
        if origin is None:
            return Rigid()
        x, y, z = self._numbers(origin, "xyz", 3) if "xyz" in origin.attributes else (0.0,) * 3
        turns = self._numbers(origin, "rpy", 3) if "rpy" in origin.attributes else (0.0,) * 3
        roll, pitch, yaw = map(math.degrees, turns)
        return Rigid.euler(x, y, z, yaw, pitch, roll)

    def _color_of(self, visual: _Element) -> str:
        material = visual.first("material")
        return self._color if material is None else self._material(material)

    def _material(self, material: _Element) -> str:
        """The colour of a material, which is defined here or by its name."""
        name, color = self._attribute(material, "name"), material.first("color")
        if color is not None:
            parts = self._numbers(color, "rgba", 4)[:3]
            levels = [min(255, max(0, round(255 * part))) for part in parts]
            self._colors[name] = "#" + "".join(f"{level:02x}" for level in levels)
        return self._colors.get(name, self._color)

    def _error(self, element: _Element, what: str) -> BodiesError:
        return BodiesError(f"robot {self._file!r}, line {element.line}: {what}")


@dataclass(frozen=True, slots=True)
class _Solid:
    """A solid of a link: its form, which takes a colour and a material, its place and volume."""

    form: Callable[..., Disc]
    place: Rigid
    volume: float
    file: str = ""


def _words(name: str) -> str:
    """The letters and digits of a name, as a part of a symbol's name: UpperArm for upper_arm."""
    words = re.findall(r"[A-Za-z0-9]+", name)
    return "".join(word[0].upper() + word[1:] for word in words)
