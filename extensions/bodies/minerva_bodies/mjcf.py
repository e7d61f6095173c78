"""Robots in MuJoCo's format MJCF: bodies as the solids of agents, joints, and actuators by name.

    ARM = Mjcf.read("robots/arm.xml", ignore=["joint armature"])
    vocabulary = Vocabulary.of(*ARM.symbols, ...)

An agent shows `ARM.links[name]` within the transformation of its pose, and with it
`ARM.driven(name, parent, id, {"elbow": 30.0})`, its joint with the controls of its actuators.
Bodies without a joint are a part of their parent; those in the world stand fast. A body with
several joints hangs on a chain of links, BODY_JOINT, each with a tenth of its mass.

Format: https://mujoco.readthedocs.io/en/stable/XMLreference.html. What the reader does not know is
an error with names and numbers, unless `ignore` has the name; what is only seen or measured, as by
cameras and sensors, is left out. Inertia is that of the solids, with the mass of <inertial>.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Final

from minerva_bodies.assets import read_asset
from minerva_bodies.errors import BodiesError
from minerva_bodies.forms import Matter
from minerva_bodies.rigid import Rigid
from minerva_bodies.robot_files import (
    Element,
    LinkedRobot,
    LinkSolid,
    RobotJoint,
    RobotReader,
    TPlace,
    words_of,
)
from minerva_bus import Scene, portable
from minerva_bus.grammar.scene import EMPTY

EVERYTHING: Final = "all"
_KINDS: Final = {"hinge": "revolute", "slide": "prismatic", "ball": "spherical"}
_TURNS: Final = ("quat", "euler", "axisangle", "xyaxes", "zaxis")
_PLACED: Final = ("name", "pos", *_TURNS, "user")
_KNOWN: Final[dict[str, tuple[str, ...]]] = {
    "mujoco": ("model",),
    "compiler": (
        *("angle", "meshdir", "assetdir", "eulerseq", "autolimits"),
        *("inertiafromgeom", "texturedir", "discardvisual", "fusestatic"),
    ),
    "body": (*_PLACED, "childclass"),
    "frame": (*_PLACED, "childclass"),
    "inertial": (*_PLACED, "mass", "diaginertia", "fullinertia"),
    "freejoint": ("name", "group", "user"),
    "joint": (
        *("name", "class", "type", "pos", "axis", "range", "limited", "group", "user"),
        *("damping", "stiffness", "springref"),
    ),
    "geom": (
        *(*_PLACED, "class", "type", "size", "fromto", "mesh", "contype", "conaffinity"),
        *("friction", "mass", "density", "rgba", "material", "group"),
    ),
    "mesh": ("name", "class", "file", "scale", "maxhullvert", "smoothnormal", "inertia"),
    "motor": ("name", "class", "joint", "gear", "ctrlrange", "ctrllimited", "group", "user"),
}
"""Attributes that are read, or that only views need."""
_KNOWN["position"] = (*_KNOWN["motor"], "kp", "kv")
_KNOWN["velocity"] = (*_KNOWN["motor"], "kv")
_KNOWN["general"] = (*_KNOWN["motor"], "gaintype", "gainprm", "biastype", "biasprm", "dyntype")
_SEEN: Final = (
    *("visual", "statistic", "size", "sensor", "keyframe", "custom"),
    *("camera", "light", "site", "texture", "material"),
)
"""Elements without an effect on bodies."""
_ENDLESS, _THICK = 100.0, 0.5
"""Half extents in metres of a plane without a size, and of its depth."""
_PART, _POINT = 0.1, 0.02
"""Part of the mass of a body with several joints that each further one has, and its radius."""
_LIGHT = 1e-3
"""Density of a solid without mass, kg/m³."""
_MAX_INCLUDES: Final = 100
_LEAST: Final = 1e-3
"""Damping (N·m·s or N·s/m) of a motor with a force: it acts by its speed."""


@dataclass(frozen=True, slots=True)
class Actuator:
    """A motor of a joint: it acts with force + stiffness · (target - q) + damping · (speed - v).

    Attributes:
        name: its name.
        kind: motor, position or velocity.
        link: the body whose joint it moves.
        gain: force, stiffness or damping for each unit of its control, in newtons, metres, radians.
        stiffness: N/m or N·m/rad, whatever its control is.
        damping: N·s/m or N·m·s/rad, whatever its control is.
        low: least control: N, N·m, metres or degrees, the latter two also in a second.
        high: the largest; if it equals `low`, there are no limits.

    """

    name: str
    kind: str
    link: str
    gain: float
    stiffness: float
    damping: float
    low: float
    high: float

    def limited(self, control: float) -> float:
        """The control within its limits."""
        return min(self.high, max(self.low, control)) if self.low < self.high else control


@dataclass(frozen=True, slots=True)
class MjcfJoint(RobotJoint):
    """A joint by which a body moves.

    Attributes:
        anchor: its place in the body.
        stiffness: of its spring, N/m or N·m/rad.
        rest: where the spring rests, metres or degrees.
        damping: N·s/m or N·m·s/rad.

    """

    anchor: Rigid
    stiffness: float
    rest: float
    damping: float


@dataclass(frozen=True, slots=True)
class Mjcf(LinkedRobot):
    """A robot in MJCF.

    Attributes:
        scenery: the solids of the world itself.
        actuators: by their names.
        ignored: what `ignore` has left out, with its number.

    """

    scenery: Scene
    actuators: Mapping[str, Actuator]
    ignored: Mapping[str, int]

    @staticmethod
    def read(
        file: str,
        *,
        matter: Matter | None = None,
        color: str = "#8a8f98",
        ignore: Collection[str] = (),
    ) -> Mjcf:
        """The robot of an asset; see `meshes` for its name.

        Args:
            file: the asset.
            matter: restitution and group of all solids.
            color: of bodies without a material that has one.
            ignore: names of what to leave out although it has an effect, such as `tendon`, an
                element, and `joint armature`, an attribute; "all" leaves out all of it.

        Raises BodiesError for a file that is none, with its line.

        """
        name, data = read_asset(f"robot {file!r}", file)
        return _Reader(name, matter or Matter(), color, ignore).robot(data)

    def driven(self, link: str, parent: str, child: str, controls: Mapping[str, float]) -> Scene:
        """The string of a link's joint between two agents, with its spring and its actuators.

        Args:
            link: the body that hangs on the joint.
            parent: id of the agent of the parent, "" for the world.
            child: id of the agent of the body.
            controls: of actuators, by their names; 0 for those that are not there. Targets are in
                metres or degrees, speeds in these per second, forces in N or N·m.

        Raises BodiesError for a name of no actuator.

        """
        strange = next((name for name in controls if name not in self.actuators), None)
        if strange is not None:
            raise BodiesError(
                f"robot {self.name}: no actuator {strange!r}; it has {', '.join(self.actuators)}"
            )
        joint = self.joints[link]
        assert isinstance(joint, MjcfJoint)
        stiffness, damping = joint.stiffness, joint.damping
        pull, push, force = joint.stiffness * joint.rest, 0.0, 0.0
        for name, actuator in self.actuators.items():
            if actuator.link == link:
                control = actuator.limited(controls.get(name, 0.0))
                stiffness, damping = stiffness + actuator.stiffness, damping + actuator.damping
                pull += actuator.gain * control if actuator.kind == "position" else 0.0
                push += actuator.gain * control if actuator.kind == "velocity" else 0.0
                force += actuator.gain * control if actuator.kind == "motor" else 0.0
        if force:
            damping = max(damping, _LEAST)
            push += force if joint.kind == "prismatic" else math.degrees(force)
        shown = joint.primitive(
            parent,
            child,
            pull / stiffness if stiffness else 0.0,
            stiffness,
            push / damping if damping else 0.0,
            damping,
        )
        return TPlace(*joint.anchor.numbers)(shown)


class _Reader(RobotReader):
    """Reads one file."""

    def __init__(self, file: str, matter: Matter, color: str, ignore: Collection[str]) -> None:
        super().__init__(file, matter, color, fixed=True)
        self._ignore = (ignore,) if isinstance(ignore, str) else tuple(ignore)
        self._ignored, self._where = Counter[str](), dict[str, Element]()
        self._defaults: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        self._compiler: dict[str, str] = {}
        self._meshes = dict[str, Element]()
        self._links, self._poses = dict[str, Scene](), dict[str, Rigid]()
        self._joints = dict[str, MjcfJoint]()
        self._carriers = dict[str, str]()
        self._bodies = set[str]()
        self._share = 1.0
        """Part of its mass that the next body has."""
        self._includes = 0
        self._masses: dict[str, float] = {}
        """Of the bodies that move, kg."""
        self._scenery = EMPTY

    def robot(self, data: bytes) -> Mjcf:
        root = self._included(self.parsed(data), ())
        if root.tag != "mujoco":
            raise self.error(root, f"the outermost element is <{root.tag}>; expected <mujoco>")
        self._check(root, root.attributes)
        self.title = words_of(root.attributes.get("model", "")) or "Robot"
        for compiler in root.all("compiler"):
            self._check(compiler, compiler.attributes)
            self._compiler |= compiler.attributes
        for default in root.all("default"):
            name = default.attributes.get("class", "main")
            self._default(default, name, self._defaults["main"])
            self._defaults["main"] = self._defaults[name]
        for asset in root.all("asset"):
            self._assets(asset)
        for world in root.all("worldbody"):
            self._inside(world, Rigid(), "", Rigid(), "main")
        actuators = self._actuators(root)
        self._complete(root)
        symbols = tuple(self.symbols)
        poses = {name: self._poses[name] for name in self._links}
        return Mjcf(
            *(self.title, self._links, self._joints, poses, symbols),
            *(self._scenery, actuators, dict(self._ignored)),
        )

    def _complete(self, root: Element) -> None:
        """Raises BodiesError for what is missing, or is not read and has an effect."""
        read = ("compiler", "default", "asset", "worldbody", "actuator")
        for element in root.children:
            if element.tag not in read:
                self._leave(element, element.tag)
        if not self._links:
            raise self.error(root, "a robot without a <body>")
        left = {
            name: number
            for name, number in self._ignored.items()
            if EVERYTHING not in self._ignore and name not in self._ignore
        }
        if left:
            listed = ", ".join(f"{name} ({number})" for name, number in left.items())
            raise self.error(
                root, f"bodies in space have no {listed}; ignore={list(left)} leaves it out"
            )
        for name, mass in self._masses.items():
            if not mass > 0.0:
                raise self.error(self._where[name], f"the body {name!r} moves, and has no mass")
        for name, scene in self._links.items():
            if not scene:
                raise self.error(
                    self._where[name],
                    f"the body {name!r} has no solid; a body that moves needs one",
                )

    # --- what is not read ---

    def _leave(self, element: Element, name: str) -> None:
        """Count what is not read, if it has an effect."""
        if element.tag not in _SEEN:
            self._ignored[name] += 1

    def _check(self, element: Element, attributes: Mapping[str, str]) -> None:
        for name, value in attributes.items():
            if name not in _KNOWN[element.tag] and (name, value) != ("coordinate", "local"):
                self._ignored[f"{element.tag} {name}"] += 1

    # --- the file ---

    def _included(self, root: Element, files: tuple[str, ...]) -> Element:
        """An element with the contents of the files that it includes. Raises BodiesError."""
        children = list[Element]()
        for child in root.children:
            if child.tag != "include":
                children.append(self._included(child, files))
                continue
            file = self.beside(self.attribute(child, "file"))
            if file in files:
                raise self.error(child, f"{file!r} includes itself")
            self._includes += 1
            if self._includes > _MAX_INCLUDES:
                raise self.error(child, f"more than {_MAX_INCLUDES} files are included")
            try:
                _, data = read_asset(f"include {file!r}", file)
            except BodiesError as error:
                raise self.error(child, str(error)) from None
            own, self.file = self.file, file
            children += self._included(self.parsed(data), (*files, file)).children
            self.file = own
        root.children[:] = children
        return root

    def _default(self, default: Element, name: str, outer: Mapping[str, Mapping[str, str]]) -> None:
        """A class of attributes, with those within it."""
        name = default.attributes.get("class", name)
        own = {tag: dict(attributes) for tag, attributes in outer.items()}
        for element in default.children:
            if element.tag != "default":
                own[element.tag] = own.get(element.tag, {}) | element.attributes
        self._defaults[name] = own
        for inner in default.all("default"):
            self.attribute(inner, "class")
            self._default(inner, name, own)

    def _full(self, element: Element, family: str) -> Element:
        """An element with the attributes of its class. Raises BodiesError for an unknown class."""
        name = element.attributes.get("class", family)
        if name not in self._defaults:
            raise self.error(element, f"there is no default class {name!r}")
        given = dict(element.attributes)
        attributes = self._defaults[name].get(element.tag, {}) | given
        # Places and turns replace each other.
        if any(turn in given for turn in _TURNS):
            attributes = {k: v for k, v in attributes.items() if k not in _TURNS or k in given}
        self._check(element, attributes)
        return Element(element.tag, attributes, element.line, element.children)

    def _assets(self, asset: Element) -> None:
        for element in asset.children:
            if element.tag == "material":
                if "rgba" in element.attributes:
                    self.colors[self.attribute(element, "name")] = self.rgb(element, "rgba")
            elif element.tag == "mesh":
                mesh = self._full(element, "main")
                file = self.attribute(mesh, "file")
                name = mesh.attributes.get("name", PurePosixPath(file).stem)
                if name in self._meshes:
                    raise self.error(mesh, f"the mesh {name!r} appears twice")
                self._meshes[name] = mesh
            else:
                self._leave(element, element.tag)

    # --- bodies ---

    def _inside(
        self, element: Element, place: Rigid, link: str, within: Rigid, family: str
    ) -> None:
        """What is in a body or a frame.

        Args:
            element: the body, the frame or the world.
            place: its pose in the world.
            link: the agent of which it is a part, "" for the world.
            within: its pose in that.
            family: the default class of what has none.

        """
        family = element.attributes.get("childclass", family)
        geoms = [self._full(geom, family) for geom in element.all("geom")]
        scene = self._solids(element, geoms, link, within)
        if link:
            self._links[link] += scene
        else:
            self._scenery += scene
        for child in element.children:
            if child.tag == "frame":
                self._check(child, child.attributes)
                at = self._place(child)
                self._inside(child, place.then(at), link, within.then(at), family)
            elif child.tag == "body":
                self._body(child, place, link, within, family)
            elif child.tag not in ("geom", "inertial", "joint", "freejoint"):
                self._leave(child, child.tag)
            elif element.tag == "frame" and child.tag in ("joint", "freejoint"):
                raise self.error(child, "a joint in a <frame>; put it into the <body>")

    def _body(self, body: Element, place: Rigid, link: str, within: Rigid, family: str) -> None:
        self._check(body, body.attributes)
        name = body.attributes.get("name", f"body{len(self._bodies)}")
        if name in self._bodies or not words_of(name):
            raise self.error(body, f"the body {name!r} appears twice, or has no letters")
        self._bodies.add(name)
        at = self._place(body)
        here = place.then(at)
        inner = body.attributes.get("childclass", family)
        joints = [self._full(joint, inner) for joint in body.all("joint")]
        free = [*body.all("freejoint")]
        for joint in free:
            self._check(joint, joint.attributes)
        free += [joint for joint in joints if joint.attributes.get("type") == "free"]
        joints = [joint for joint in joints if joint.attributes.get("type") != "free"]
        if free and (link or joints or len(free) > 1):
            raise self.error(free[0], f"the body {name!r} is free, and hangs on another joint")
        if not joints and not free and link:
            self._inside(body, here, link, within.then(at), family)
            return
        self._where[name] = body
        around, self.fixes = self.fixes, not joints and not free
        self._share = 1.0 - _PART * max(0, len(joints) - 1)
        for joint in joints[:-1]:
            link = self._between(body, inner, joint, link, here)
        self._links[name], self._poses[name] = EMPTY, here
        for joint in joints[-1:]:
            self._joint(joint, name, link, here)
        self._inside(body, here, name, Rigid(), family)
        self.fixes = around

    def _between(self, body: Element, family: str, joint: Element, link: str, here: Rigid) -> str:
        """A link for one of several joints of a body, with a part of its mass."""
        title = joint.attributes.get("name", f"joint{len(self._carriers)}")
        name = f"{body.attributes.get('name', 'body')}_{title}"
        if name in self._bodies:
            raise self.error(joint, f"the body {name!r} appears twice")
        self._bodies.add(name)
        geoms = [self._full(geom, family) for geom in body.all("geom")]
        mass = sum(solid.volume * density for _, solid, density in self._weighed(body, geoms, name))
        self._links[name], self._poses[name] = self._point(joint, name, _PART * mass), here
        self._joint(joint, name, link, here)
        return name

    def _point(self, element: Element, link: str, mass: float) -> Scene:
        """A mass at the place of an element, which touches nothing."""
        solid = LinkSolid.ball(_POINT, self._place(element))
        matter = Matter(mass / solid.volume, fixed=self.fixes, sensor=True, group=-1)
        return self.shown(link, [(element, solid, matter, self.color)], Rigid())

    def _joint(self, joint: Element, link: str, parent: str, here: Rigid) -> None:
        """A joint of a link where that is in the world."""
        name = joint.attributes.get("name", link)
        if name in self._carriers:
            raise self.error(joint, f"the joint {name!r} appears twice")
        kind = _KINDS.get(joint.attributes.get("type", "hinge"))
        place = self._poses[parent].inverse().then(here) if parent else here
        if kind is None:
            raise self.error(
                joint,
                f"the joint {name!r} is {joint.attributes['type']}; expected"
                f" {', '.join(_KINDS)} or free",
            )
        x, y, z = self.numbers(joint, "axis", 3) if "axis" in joint.attributes else (0.0, 0.0, 1.0)
        if not x * x + y * y + z * z > 0.0:
            raise self.error(joint, f"the joint {name!r}: its axis has no length")
        low, high = self._range(joint, "range", "limited", 1.0 if kind == "prismatic" else None)
        if kind == "spherical":
            low = -high
        if kind == "revolute" and high - low < 360 and (low < -180 or high > 180):
            self._ignored["joint range beyond 180 degrees"] += 1
            low, high = max(-180.0, low), min(180.0, high)
        low, high = self.limits(joint, kind, low, high)
        stiffness, damping = (self.number(joint, each, 0.0) for each in ("stiffness", "damping"))
        if kind == "spherical" and (stiffness or damping):
            self._ignored["spring and damping of a ball joint"] += 1
        unit = 1.0 if kind == "prismatic" else self._degrees()
        rest = unit * self.number(joint, "springref", 0.0)
        anchor = Rigid(*self.numbers(joint, "pos", 3)) if "pos" in joint.attributes else Rigid()
        primitive = self.turning(name, kind, (x, y, z), low, high)
        self._carriers[name] = link
        self._joints[link] = MjcfJoint(
            *(name, kind, parent, place, primitive, anchor, stiffness, rest, damping)
        )

    def _range(
        self, element: Element, name: str, switch: str, unit: float | None
    ) -> tuple[float, float]:
        """Limits, in metres or degrees; equal numbers if there are none."""
        limited = element.attributes.get(switch, "auto")
        automatic = self._compiler.get("autolimits", "true") == "true"
        if limited == "false" or (limited == "auto" and not automatic):
            return 0.0, 0.0
        if name not in element.attributes and limited == "auto":
            return 0.0, 0.0
        low, high = self.numbers(element, name, 2)
        if low > high:
            raise self.error(element, f"{name}: its limits are {low:g} to {high:g}")
        factor = self._degrees() if unit is None else unit
        return factor * low, factor * high

    def _degrees(self) -> float:
        """Degrees in a unit of the file's angles."""
        return math.degrees(1.0) if self._compiler.get("angle", "degree") == "radian" else 1.0

    # --- solids ---

    def _solids(self, body: Element, geoms: list[Element], link: str, within: Rigid) -> Scene:
        """The solids of a body, at its pose in the agent of which it is a part."""
        share, self._share = self._share, 1.0
        color = next((c for c in map(self._color_of, geoms) if c), self.color)
        fixed = not link or self.fixes
        weighed = self._weighed(body, geoms, link)
        if not fixed:
            own = sum(solid.volume * density for _, solid, density in weighed)
            self._masses[link] = self._masses.get(link, 0.0) + own
        shown = [
            (geom, solid, self._matter(geom, max(_LIGHT, share * density), fixed), color)
            for geom, solid, density in weighed
        ]
        return self.shown(link or "world", shown, within)

    def _weighed(
        self, body: Element, geoms: list[Element], link: str
    ) -> list[tuple[Element, LinkSolid, float]]:
        """The solids of a body with their densities; a ball where it has nothing but a mass."""
        collides = [
            geom
            for geom in geoms
            if any(self.number(geom, name, 1.0) for name in ("contype", "conaffinity"))
        ]
        rows = list[tuple[Element, LinkSolid, float]]()
        for geom in collides or geoms:
            solid = self._solid(geom, link)
            if solid is not None:
                density = self.number(geom, "density", 1000.0)
                if "mass" in geom.attributes and solid.volume:
                    density = self.number(geom, "mass") / solid.volume
                if density < 0.0:
                    raise self.error(geom, f"a density of {density:g} kg/m³; expected 0 or more")
                rows.append((geom, solid, density))
        inertial = body.first("inertial")
        if inertial is None or self._compiler.get("inertiafromgeom") == "true":
            return rows
        self._check(inertial, inertial.attributes)
        mass, volume = self.number(inertial, "mass"), sum(solid.volume for _, solid, _ in rows)
        if not mass > 0.0:
            raise self.error(inertial, f"a mass of {mass:g} kg; expected more than 0")
        if not volume:
            point = LinkSolid.ball(_POINT, self._place(inertial))
            return [(inertial, point, mass / point.volume)]
        return [(geom, solid, mass / volume) for geom, solid, _ in rows]

    def _matter(self, element: Element, density: float, fixed: bool) -> Matter:
        if element.tag == "inertial":
            return Matter(density, fixed=fixed, sensor=True, group=-1)
        friction = 1.0
        if "friction" in element.attributes:
            friction = self._some(element, "friction", 1, 3)[0]
        try:
            return Matter(
                density, friction, self.matter.restitution, fixed=fixed, group=self.matter.group
            )
        except BodiesError as error:
            raise self.error(element, str(error)) from None

    def _solid(self, geom: Element, link: str) -> LinkSolid | None:
        """The solid of a geom; None for a form that is not read."""
        form, place = geom.attributes.get("type", "sphere"), self._place(geom)
        if "mesh" in geom.attributes and form != "mesh":
            self._ignored[f"mesh of a geom {form}"] += 1
        if form == "mesh":
            return self._mesh(geom, place)
        if form == "plane" and not link:
            x, y = self._some(geom, "size", 2, 3)[:2] if "size" in geom.attributes else (0.0, 0.0)
            down = place.then(Rigid(0.0, 0.0, -_THICK))
            return LinkSolid.box(x or _ENDLESS, y or _ENDLESS, _THICK, down)
        if form not in ("box", "sphere", "capsule", "cylinder"):
            self._ignored[f"geom {form}"] += 1
            return None
        if "fromto" in geom.attributes and form != "sphere":
            ends = self.numbers(geom, "fromto", 6)
            along = [b - a for a, b in zip(ends[:3], ends[3:], strict=True)]
            half = math.sqrt(sum(part * part for part in along)) / 2
            middle = [(a + b) / 2 for a, b in zip(ends[:3], ends[3:], strict=True)]
            place = Rigid(*middle).then(_towards(*along))
            sizes = self._some(geom, "size", 1, 3)
            sizes = [*sizes[:2], half] if form == "box" else [sizes[0], half]
        else:
            wanted = {"box": 3, "sphere": 1}.get(form, 2)
            sizes = self._some(geom, "size", wanted, 3)
        if form == "box":
            return LinkSolid.box(sizes[0], sizes[-2], sizes[-1], place)
        if form == "sphere":
            return LinkSolid.ball(sizes[0], place)
        made = LinkSolid.capsule if form == "capsule" else LinkSolid.cylinder
        return made(sizes[1], sizes[0], place)

    def _mesh(self, geom: Element, place: Rigid) -> LinkSolid:
        name = self.attribute(geom, "mesh")
        if name not in self._meshes:
            raise self.error(geom, f"there is no mesh {name!r} among the assets")
        mesh = self._meshes[name]
        folder = self._compiler.get("meshdir", self._compiler.get("assetdir", ""))
        scales = self.numbers(mesh, "scale", 3) if "scale" in mesh.attributes else [1.0]
        return self.mesh(geom, self.beside(folder, self.attribute(mesh, "file")), scales, place)

    def _color_of(self, geom: Element) -> str:
        if "rgba" in geom.attributes:
            return self.rgb(geom, "rgba")
        return self.colors.get(geom.attributes.get("material", ""), "")

    def _some(self, element: Element, name: str, least: int, most: int) -> list[float]:
        """Numbers of an attribute that may have more than are needed."""
        count = len(self.attribute(element, name).split())
        return self.numbers(element, name, min(most, max(least, count)))

    # --- poses ---

    def _place(self, element: Element) -> Rigid:
        """The pose of a body, frame or geom. Raises BodiesError."""
        x, y, z = self.numbers(element, "pos", 3) if "pos" in element.attributes else (0.0,) * 3
        return Rigid(x, y, z).then(self._turn(element))

    def _turn(self, element: Element) -> Rigid:
        given = [turn for turn in _TURNS if turn in element.attributes]
        if not given:
            return Rigid()
        if len(given) > 1:
            raise self.error(element, f"{given[0]} and {given[1]}; expected one of them")
        numbers = self.numbers(
            element,
            given[0],
            {"quat": 4, "euler": 3, "axisangle": 4, "xyaxes": 6, "zaxis": 3}[given[0]],
        )
        try:
            if given == ["quat"]:
                return Rigid.quaternion(0, 0, 0, *numbers)
            if given == ["zaxis"]:
                return _towards(*numbers)
            if given == ["axisangle"]:
                return _about(numbers[:3], self._degrees() * numbers[3])
            if given == ["xyaxes"]:
                return _axes(numbers[:3], numbers[3:])
            made, order = Rigid(), self._compiler.get("eulerseq", "xyz")
            if len(order) != 3 or not {*order.lower()} <= {*"xyz"}:
                raise ValueError(f"eulerseq is {order!r}; expected three of x, y and z")
            for letter, angle in zip(order, numbers, strict=True):
                axis = [float(letter.lower() == each) for each in "xyz"]
                turn = _about(axis, self._degrees() * angle)
                # Small letters are axes that turn with the body.
                made = made.then(turn) if letter.islower() else turn.then(made)
            return made
        except ValueError as error:
            raise self.error(element, f"{given[0]}: {error}") from None

    # --- actuators ---

    def _actuators(self, root: Element) -> Mapping[str, Actuator]:
        actuators = dict[str, Actuator]()
        for element in (each for section in root.all("actuator") for each in section.children):
            made = self._actuator(element)
            if made is not None and made.name in actuators:
                raise self.error(element, f"the actuator {made.name!r} appears twice")
            if made is not None:
                actuators[made.name] = made
        return actuators

    def _actuator(self, element: Element) -> Actuator | None:
        """An actuator of a joint; None for what is not read."""
        kind = element.tag
        if kind not in ("motor", "position", "velocity", "general"):
            self._leave(element, kind)
            return None
        if "joint" not in element.attributes:
            self._ignored[f"{kind} without a joint"] += 1
            return None
        full = self._full(element, "main")
        name = full.attributes.get("joint", "")
        link = self._carriers.get(name)
        if link is None:
            raise self.error(element, f"there is no joint {name!r}")
        joint = self._joints[link]
        if joint.kind == "spherical":
            self._ignored[f"{kind} of a ball joint"] += 1
            return None
        gear = self._some(full, "gear", 1, 6)[0] if "gear" in full.attributes else 1.0
        gain, stiffness, damping = 1.0, 0.0, 0.0
        if kind == "position":
            gain = stiffness = self.number(full, "kp", 1.0)
            damping = self.number(full, "kv", 0.0)
        elif kind == "velocity":
            gain = damping = self.number(full, "kv", 1.0)
        elif kind == "general":
            gain = self._some(full, "gainprm", 1, 10)[0] if "gainprm" in full.attributes else 1.0
            bias = self._some(full, "biasprm", 1, 10) if "biasprm" in full.attributes else [0.0]
            bias = (
                [*bias, 0.0, 0.0][:3] if full.attributes.get("biastype") == "affine" else [0.0] * 3
            )
            stiffness, damping = -bias[1], -bias[2]
            kind = "position" if stiffness else "velocity" if damping else "motor"
            fits = {"position": stiffness, "velocity": damping, "motor": gain}[kind] == gain
            plain = full.attributes.get("gaintype", "fixed") == "fixed" and not bias[0]
            if not fits or not plain or full.attributes.get("dyntype", "none") != "none":
                self._ignored["general of another kind"] += 1
                return None
        unit = 1.0 if joint.kind == "prismatic" or kind == "motor" else math.degrees(1.0)
        low, high = self._range(
            full, "ctrlrange", "ctrllimited", unit / (1.0 if kind == "motor" else gear)
        )
        return Actuator(
            full.attributes.get("name", name),
            kind,
            link,
            *(gain * gear if kind == "motor" else gain * gear * gear, stiffness * gear * gear),
            *(damping * gear * gear, *sorted((low, high))),
        )


def _about(axis: list[float], angle: float) -> Rigid:
    """A turn about an axis by degrees. Raises ValueError for an axis without length."""
    length = math.sqrt(sum(part * part for part in axis))
    if not length > 0.0:
        raise ValueError("the axis has no length")
    cos, sin = portable.cos_sin(math.radians(angle) / 2.0)
    return Rigid.quaternion(0, 0, 0, cos, *(sin * part / length for part in axis))


def _towards(x: float, y: float, z: float) -> Rigid:
    """The shortest turn from the z axis to a vector. Raises ValueError for one without length."""
    length = math.sqrt(x * x + y * y + z * z)
    if not length > 0.0:
        raise ValueError("the axis has no length")
    x, y, z = x / length, y / length, z / length
    return Rigid.quaternion(0, 0, 0, *((1 + z, -y, x, 0.0) if z > -1 else (0.0, 1.0, 0.0, 0.0)))


def _axes(x: list[float], y: list[float]) -> Rigid:
    """The turn to two axes, of which the second is made perpendicular. Raises ValueError."""
    turn = _towards(*x).then(_about([0.0, 1.0, 0.0], -90.0))  # Its x axis is the first.
    back = turn.inverse().turned(*y)
    if not back[1] * back[1] + back[2] * back[2] > 1e-12:
        raise ValueError("the axes are parallel")
    return turn.then(_about([1.0, 0.0, 0.0], math.degrees(portable.atan2(back[2], back[1]))))
