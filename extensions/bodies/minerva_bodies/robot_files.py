"""What readers of files of robots share: elements of XML, solids of links, and joints."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, count
from pathlib import PurePosixPath
from posixpath import normpath
from typing import Any, Final
from xml.parsers import expat

import numpy as np

from minerva_bodies.assets import read_asset, with_digest
from minerva_bodies.errors import BodiesError
from minerva_bodies.forms import Ball, Box, Capsule, Cylinder, Joint, Matter, Mesh, quaternion
from minerva_bodies.meshes import read_mesh
from minerva_bodies.rigid import Rigid
from minerva_bus import Default, Metres, Primitive, Scene, Transformation
from minerva_bus.grammar.appearance import Disc
from minerva_bus.grammar.scene import EMPTY

_MAX_DEPTH, _MAX_ELEMENTS, _MAX_TEXT = 30, 100_000, 500
_AXES = dict.fromkeys("xyz", Default(Metres, 0.0)) | {"w": Default(float, 1.0)}

TPlace: Final = Transformation(
    "TPlace",
    quaternion("x", "y", "z", "w", "i", "j", "k"),
    **_AXES,
    **dict.fromkeys("ijk", Default(float, 0.0)),
)
"""The place of a link, or of a solid in it."""


@dataclass(slots=True)
class Element:
    """An element of an XML file, with its line."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list["Element"])

    def all(self, tag: str) -> Iterator[Element]:
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Element | None:
        return next(self.all(tag), None)


@dataclass(frozen=True, slots=True)
class LinkSolid:
    """A solid of a link: its form, which takes a colour and a material, its place and volume."""

    form: Callable[..., Disc]
    place: Rigid
    volume: float
    file: str = ""

    @staticmethod
    def box(x: float, y: float, z: float, place: Rigid) -> LinkSolid:
        """A box of these half extents."""
        return LinkSolid(partial(Box, x, y, z), place, 8 * x * y * z)

    @staticmethod
    def ball(radius: float, place: Rigid) -> LinkSolid:
        return LinkSolid(partial(Ball, radius), place, 4 / 3 * math.pi * radius**3)

    @staticmethod
    def capsule(half: float, radius: float, place: Rigid) -> LinkSolid:
        volume = math.pi * radius**2 * (2 * half + 4 / 3 * radius)
        return LinkSolid(partial(Capsule, half, radius), place, volume)

    @staticmethod
    def cylinder(half: float, radius: float, place: Rigid) -> LinkSolid:
        return LinkSolid(partial(Cylinder, half, radius), place, 2 * math.pi * half * radius**2)


@dataclass(frozen=True, slots=True)
class RobotJoint:
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
class LinkedRobot:
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
    joints: Mapping[str, RobotJoint]
    poses: Mapping[str, Rigid]
    symbols: tuple[Primitive | Transformation, ...]

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


class RobotReader:
    """Reads one file."""

    def __init__(self, file: str, matter: Matter, color: str, fixed: bool) -> None:
        self.file, self.matter, self.color, self.fixes = file, matter, color, fixed
        self.colors: dict[str, str] = {}
        self.symbols: list[Primitive | Transformation] = [TPlace]
        self.title = ""
        self._names = set[str]()

    def parsed(self, data: bytes) -> Element:
        """The elements of the file. Raises BodiesError."""
        parser = expat.ParserCreate()
        top = Element("", {}, 0)
        open_elements, number = [top], 0

        def begin(tag: str, attributes: dict[str, str]) -> None:
            nonlocal number
            number += 1
            element = Element(tag, attributes, parser.CurrentLineNumber)
            if len(open_elements) > _MAX_DEPTH or number > _MAX_ELEMENTS:
                raise self.error(element, "too many elements")
            open_elements[-1].children.append(element)
            open_elements.append(element)

        def end(_: str) -> None:
            open_elements.pop()

        def refused(*_: Any) -> None:
            # Entities could expand to gigabytes, or name other files.
            at = Element("", {}, parser.CurrentLineNumber)
            raise self.error(at, "a document type declaration; remove <!DOCTYPE ...>")

        parser.StartElementHandler, parser.EndElementHandler = begin, end
        parser.StartDoctypeDeclHandler = refused
        try:
            parser.Parse(data, True)
        except expat.ExpatError as error:
            at = Element("", {}, error.lineno)
            raise self.error(at, f"no XML: {expat.ErrorString(error.code)}") from None
        except BodiesError:
            raise
        except (LookupError, ValueError) as error:  # Of the codec that the file names.
            raise self.error(Element("", {}, 1), f"no XML: {error}") from None
        return top.children[0]

    def named(self, root: Element, tag: str) -> dict[str, Element]:
        named = dict[str, Element]()
        for element in root.all(tag):
            name = self.name_of(element)
            if name in named:
                raise self.error(element, f"the {tag} {name!r} appears twice")
            named[name] = element
        return named

    def name_of(self, element: Element) -> str:
        name = self.attribute(element, "name")
        if not words_of(name):
            raise self.error(element, f"the name {name!r} has no letters")
        return name

    def child(self, element: Element, tag: str) -> Element:
        child = element.first(tag)
        if child is None:
            raise self.error(element, f"<{element.tag}> has no <{tag}>")
        return child

    def attribute(self, element: Element, name: str) -> str:
        if name not in element.attributes:
            raise self.error(element, f"<{element.tag}> has no {name}")
        return element.attributes[name]

    def number(self, element: Element, name: str, otherwise: float | None = None) -> float:
        if name not in element.attributes and otherwise is not None:
            return otherwise
        return self.numbers(element, name, 1)[0]

    def numbers(self, element: Element, name: str, count: int) -> list[float]:
        text = self.attribute(element, name)
        try:
            numbers = [float(word) for word in text.split()]
        except ValueError:
            numbers = []
        if len(numbers) != count or not all(abs(number) < 1e6 for number in numbers):
            wanted = f"{count} numbers" if count > 1 else "a number"
            raise self.error(
                element, f"{name}={text!r:.60} of <{element.tag}>; expected {wanted} below 1e6"
            )
        return numbers

    def error(self, element: Element, what: str) -> BodiesError:
        return BodiesError(f"robot {self.file!r:.200}, line {element.line}: {_line(what)}")

    def _symbol(self, name: str) -> str:
        """A name that no symbol has so far."""
        numbers = chain([""], map(str, count(1)))
        free = next(name + number for number in numbers if name + number not in self._names)
        self._names.add(free)
        return free

    def shown(
        self, name: str, solids: Sequence[tuple[Element, LinkSolid, Matter, str]], within: Rigid
    ) -> Scene:
        """The string of solids at a pose in their body; each has an element and a colour."""
        scene = EMPTY
        for element, solid, matter, color in solids:
            title = self._symbol(f"P{self.title}{words_of(name)}")
            file = {"file": Default(str, solid.file)} if solid.file else {}
            try:
                form = solid.form(color=color, matter=matter, meaning=self.title.lower())
            except BodiesError as error:
                raise self.error(element, str(error)) from None
            primitive = Primitive(title, form, **file)
            self.symbols.append(primitive)
            scene += TPlace(*within.then(solid.place).numbers)(primitive())
        return scene

    def mesh(self, element: Element, file: str, scales: Sequence[float], place: Rigid) -> LinkSolid:
        """A mesh with a scale for each axis. Raises BodiesError for different ones."""
        if len(set(scales)) > 1:
            raise self.error(element, "a mesh with different scales; expected equal ones")
        where = f"mesh {file!r}"
        try:
            file, data = read_asset(where, file)
            points, triangles = read_mesh(where, file, data)
        except BodiesError as error:
            raise self.error(element, str(error)) from None
        a, b, c = (scales[0] * points)[triangles].swapaxes(0, 1)
        volume = abs(float((a * np.cross(b, c)).sum())) / 6
        reach = scales[0] * float(np.abs(points[:, :2]).max())
        form = partial(Mesh, "file", scales[0], radius=reach)
        # Views on other machines get the file by its digest.
        return LinkSolid(form, place, volume, with_digest(file, data))

    def beside(self, *path: str) -> str:
        """The name of a file whose path begins at the folder of this one."""
        return normpath(PurePosixPath(self.file).parent.joinpath(*path))

    def limits(self, element: Element, kind: str, low: float, high: float) -> tuple[float, float]:
        """Limits in metres or degrees. Raises BodiesError for angles that no joint can have."""
        if low > high:
            raise self.error(element, f"its limits are {low:g} to {high:g}")
        if kind == "prismatic" or (low >= -180 and high <= 180):
            return low, high
        if high - low < 360:
            raise self.error(
                element, f"limits of {low:g} to {high:g} degrees; expected from -180 to 180"
            )
        return 0.0, 0.0  # A whole turn is none.

    def turning(
        self, name: str, kind: str, axis: Sequence[float], low: float, high: float
    ) -> Primitive:
        """The symbol of a joint with limits (degrees or metres), whose motor is given with it."""
        motor = dict.fromkeys(("target", "stiffness", "speed", "damping"), Default(float, 0.0))
        x, y, z = axis
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
        title = self._symbol(f"P{self.title}{words_of(name)}Joint")
        primitive = Primitive(title, form, parent=str, child=str, **motor)
        self.symbols.append(primitive)
        return primitive

    def rgb(self, element: Element, name: str) -> str:
        """A colour of four numbers from 0 to 1, as #rrggbb."""
        parts = self.numbers(element, name, 4)[:3]
        levels = [min(255, max(0, round(255 * part))) for part in parts]
        return "#" + "".join(f"{level:02x}" for level in levels)


def _line(text: str) -> str:
    """A text with names of the file, in a line."""
    return " ".join(text.split())[:_MAX_TEXT]


def words_of(name: str) -> str:
    """The letters and digits of a name, as a part of a symbol's name: UpperArm for upper_arm."""
    words = re.findall(r"[A-Za-z0-9]+", name)
    return "".join(word[0].upper() + word[1:] for word in words)
