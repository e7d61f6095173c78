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
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from minerva_bodies.assets import read_asset
from minerva_bodies.forms import Matter
from minerva_bodies.rigid import Rigid
from minerva_bodies.robot_files import (
    Element,
    LinkedRobot,
    LinkSolid,
    RobotJoint,
    RobotReader,
    words_of,
)
from minerva_bus import Scene
from minerva_bus.grammar.scene import EMPTY

_TYPES: Final = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
}
_PACKAGE: Final = "package://"


@dataclass(frozen=True, slots=True)
class Urdf(LinkedRobot):
    """A robot in URDF."""

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


class _Reader(RobotReader):
    """Reads one file."""

    def robot(self, data: bytes) -> Urdf:
        root = self.parsed(data)
        if root.tag != "robot":
            raise self.error(root, f"the outermost element is <{root.tag}>; expected <robot>")
        macro = next((child for child in root.children if child.tag.startswith("xacro:")), None)
        if macro is not None:
            raise self.error(
                macro, f"<{macro.tag}> is a macro; read what `xacro {self.file}` prints"
            )
        self.title = words_of(self.name_of(root))
        for material in root.all("material"):
            self._material(material)
        links = self.named(root, "link")
        if not links:
            raise self.error(root, "a robot without a <link>")
        hanging = self._joints(root, links)
        order = self._order(root, links, hanging)
        poses, owner = dict[str, Rigid](), dict[str, str]()
        solids = dict[str, Scene]()
        joints = dict[str, RobotJoint]()
        for name in order:
            joint = hanging.get(name)
            place, parent = Rigid(), ""
            if joint is not None:
                parent = self.attribute(self.child(joint, "parent"), "link")
                place = poses[parent].then(self._origin(joint))
            poses[name] = place
            fixed = joint is not None and joint.attributes["type"] == "fixed"
            owner[name] = owner[parent] if fixed else name
            within = poses[owner[name]].inverse().then(place)
            stands = self.fixes and owner[name] == order[0]
            scene = self._solids(links[name], within, stands)
            solids[owner[name]] = solids.get(owner[name], EMPTY) + scene
            if joint is not None and not fixed:
                carrier = owner[parent]
                at = poses[carrier].inverse().then(place)
                joints[name] = self._joint(joint, carrier, at)
        for name, scene in solids.items():
            if not scene:
                raise self.error(
                    links[name], f"the link {name!r} has no solid; a body that moves needs one"
                )
        moving = {name: poses[name] for name in solids}
        return Urdf(self.title, solids, joints, moving, tuple(self.symbols))

    # --- the tree ---

    def _joints(self, root: Element, links: Mapping[str, Element]) -> Mapping[str, Element]:
        """The joint of each child. Raises BodiesError for strangers and unknown types."""
        hanging = dict[str, Element]()
        for name, joint in self.named(root, "joint").items():
            kind = self.attribute(joint, "type")
            if kind not in _TYPES:
                raise self.error(
                    joint, f"the joint {name!r} is {kind}; expected {', '.join(_TYPES)}"
                )
            if mimic := joint.first("mimic"):
                raise self.error(mimic, f"the joint {name!r} follows another; remove <mimic>")
            for end in ("parent", "child"):
                link = self.attribute(self.child(joint, end), "link")
                if link not in links:
                    raise self.error(joint, f"the joint {name!r}: there is no link {link!r}")
            child = self.attribute(self.child(joint, "child"), "link")
            if child in hanging:
                raise self.error(joint, f"the link {child!r} is the child of two joints")
            hanging[child] = joint
        return hanging

    def _order(
        self, root: Element, links: Mapping[str, Element], hanging: Mapping[str, Element]
    ) -> list[str]:
        """Links after their parents. Raises BodiesError for several roots, or a circle."""
        roots = [name for name in links if name not in hanging]
        if len(roots) != 1:
            raise self.error(root, f"{len(roots)} links have no parent; expected one")
        order = roots
        for parent in order:
            children = [
                child
                for child, joint in hanging.items()
                if self.attribute(self.child(joint, "parent"), "link") == parent
            ]
            order += children
        if len(order) < len(links):
            lost = next(name for name in links if name not in order)
            raise self.error(links[lost], f"the link {lost!r} hangs on itself in a circle")
        return order

    # --- links and joints ---

    def _solids(self, link: Element, within: Rigid, stands: bool) -> Scene:
        """The solids of a link, at its pose in the body that it is a part of."""
        shown = list(link.all("collision")) or list(link.all("visual"))
        color = next(map(self._color_of, link.all("visual")), self.color)
        solids = [self._solid(each) for each in shown]
        volume = sum(solid.volume for solid in solids)
        density = self.matter.density
        inertial = link.first("inertial")
        if inertial is not None and volume:
            mass = self.number(self.child(inertial, "mass"), "value")
            if not mass > 0.0:
                raise self.error(inertial, f"a mass of {mass:g} kg; expected more than 0")
            density = mass / volume
        made_of = self.matter
        matter = Matter(
            density,
            made_of.friction,
            made_of.restitution,
            fixed=stands,
            group=made_of.group,
        )
        rows = [(each, solid, matter, color) for each, solid in zip(shown, solids, strict=True)]
        return self.shown(self.name_of(link), rows, within)

    def _solid(self, element: Element) -> LinkSolid:
        """The solid of a collision or visual element. Raises BodiesError."""
        geometry = self.child(element, "geometry")
        shape = next(iter(geometry.children), geometry)
        place = self._origin(element)
        if shape.tag == "box":
            x, y, z = (each / 2 for each in self.numbers(shape, "size", 3))
            return LinkSolid.box(x, y, z, place)
        if shape.tag == "sphere":
            radius = self.number(shape, "radius")
            return LinkSolid.ball(radius, place)
        if shape.tag == "cylinder":
            half, radius = self.number(shape, "length") / 2, self.number(shape, "radius")
            return LinkSolid.cylinder(half, radius, place)
        if shape.tag != "mesh":
            raise self.error(
                shape, f"the geometry <{shape.tag}>; expected box, sphere, cylinder or mesh"
            )
        file, scales = self.attribute(shape, "filename"), [1.0]
        if "scale" in shape.attributes:
            scales = self.numbers(shape, "scale", 3)
        is_whole = file.startswith(_PACKAGE)
        file = file.removeprefix(_PACKAGE) if is_whole else self.beside(file)
        return self.mesh(shape, file, scales, place)

    def _joint(self, joint: Element, parent: str, place: Rigid) -> RobotJoint:
        name, kind = self.name_of(joint), _TYPES[joint.attributes["type"]]
        axis, limit = joint.first("axis"), joint.first("limit")
        x, y, z = (1.0, 0.0, 0.0) if axis is None else self.numbers(axis, "xyz", 3)
        if not x * x + y * y + z * z > 0.0:
            raise self.error(joint, f"the joint {name!r}: its axis has no length")
        low = high = 0.0
        if joint.attributes["type"] != "continuous":
            if limit is None:
                raise self.error(joint, f"the joint {name!r} has no <limit>")
            unit = 1.0 if kind == "prismatic" else math.degrees(1.0)
            low, high = (unit * self.number(limit, end, 0.0) for end in ("lower", "upper"))
        low, high = self.limits(joint, kind, low, high)
        primitive = self.turning(name, kind, (x, y, z), low, high)
        return RobotJoint(name, kind, parent, place, primitive)

    # --- elements and attributes ---

    def _origin(self, element: Element) -> Rigid:
        """The pose of an element's origin: metres, and roll, pitch, yaw in radians."""
        origin = element.first("origin")
        if origin is None:
            return Rigid()
        x, y, z = self.numbers(origin, "xyz", 3) if "xyz" in origin.attributes else (0.0,) * 3
        turns = self.numbers(origin, "rpy", 3) if "rpy" in origin.attributes else (0.0,) * 3
        roll, pitch, yaw = map(math.degrees, turns)
        return Rigid.euler(x, y, z, yaw, pitch, roll)

    def _color_of(self, visual: Element) -> str:
        material = visual.first("material")
        return self.color if material is None else self._material(material)

    def _material(self, material: Element) -> str:
        """The colour of a material, which is defined here or by its name."""
        name, color = self.attribute(material, "name"), material.first("color")
        if color is not None:
            self.colors[name] = self.rgb(color, "rgba")
        return self.colors.get(name, self.color)
