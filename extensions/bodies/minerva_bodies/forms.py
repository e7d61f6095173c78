"""Forms in space, declared by the symbols of a vocabulary.

    PBrick = Primitive("PBrick", Box(0.2, 0.1, 0.05, matter=Matter(density=2000)), who=str)
    TPose = Transformation(
        "TPose", quaternion("x", "y", "z", "w", "i", "j", "k"), x=Metres, y=Metres, ...
    )

Each function returns a form of the plane, which draws the thing from above in any view, and carries
its meaning in space: a name and measures, which are sent with the vocabulary. A measure is a
number, or the name of the symbol's parameter that has it. Lengths are in metres, angles in degrees;
z points up. Sizes are half extents, as in most engines: a box of 0.2 extends 0.2 m to either side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from minerva_bodies.errors import BodiesError
from minerva_bus.grammar.appearance import Disc, Measure, Motion, Raster, Spatial

MATERIAL = 6
"""Measures of a solid's material, which stand between the name of its form and its sizes."""
SIZES = {
    "box": 3,
    "ball": 1,
    "capsule": 2,
    "cylinder": 2,
    "cone": 2,
    "mesh": 2,
    "terrain": 2,
    "wheel": 2,
}
"""Solids by name, with the number of their sizes."""
LEAST = 1e-9
"""Size of a solid, metres: single precision has its mass."""
DYNAMIC, FIXED, KINEMATIC = 0.0, 1.0, 2.0
JOINTS = ("fixed", "revolute", "prismatic", "spherical")
AXIAL = ("revolute", "prismatic")
"""Joints with a position along or about their axis, which a motor can move."""
POSTER, CAMERA = "poster", "camera"
UNFELT = (POSTER, CAMERA)
"""Forms that nothing collides with and no ray meets: a picture, and what takes pictures."""
COMMANDS = ("force", "torque", "impulse", "twist", "velocity", "spin")
"""Commands in the order in which a body carries them out, each a vector of three numbers."""


@dataclass(frozen=True, slots=True)
class Matter:
    """What a solid is made of, and what moves it.

    Attributes:
        density: kg/m³.
        friction: coefficient of Coulomb friction; of two solids, the mean counts.
        restitution: from 0 to 1; of two solids, the mean counts.
        fixed: it never moves; so is all scenery.
        kinematic: it follows its pose in the string, and nothing stops it.
        sensor: it reports contacts with solids of all kinds, and stops nothing.
        group: from 1 to 31: solids of one group do not collide with each other; 0: with all, -1:
            with none.

    """

    density: float = 1000.0
    friction: float = 0.5
    restitution: float = 0.0
    fixed: bool = False
    kinematic: bool = False
    sensor: bool = False
    group: int = 0

    def __post_init__(self) -> None:
        # Comparisons with NaN are false, so that it is refused, too.
        if not (
            0 <= self.density < math.inf
            and 0 <= self.friction < math.inf
            and 0 <= self.restitution <= 1
        ):
            raise BodiesError(
                f"{self}: expected density and friction from 0, and restitution from 0 to 1"
            )
        if self.density == 0 and not (self.fixed or self.kinematic or self.sensor):
            raise BodiesError(
                f"{self}: physics cannot move a solid without mass; expected density > 0"
            )
        if self.group not in range(-1, 32):
            raise BodiesError(f"{self}: expected a group from -1 to 31")

    @property
    def measures(self) -> tuple[float, ...]:
        """The material as numbers."""
        moved = FIXED if self.fixed else KINEMATIC if self.kinematic else DYNAMIC
        numbers = self.density, self.friction, self.restitution, moved, self.sensor, self.group
        return tuple(map(float, numbers))


EARTH = Matter()


def Box(
    x: Measure,
    y: Measure,
    z: Measure,
    color: str = "#8a5a44",
    *,
    matter: Matter = EARTH,
    meaning: str = "",
) -> Disc:
    """A box of half extents x, y and z around the origin."""
    return _solid("box", (x, y, z), x, z, color, matter, meaning)


def Ball(
    radius: Measure, color: str = "#0072b2", *, matter: Matter = EARTH, meaning: str = ""
) -> Disc:
    """A ball around the origin."""
    return _solid("ball", (radius,), radius, radius, color, matter, meaning)


def Capsule(
    half: Measure,
    radius: Measure,
    color: str = "#009e73",
    *,
    matter: Matter = EARTH,
    meaning: str = "",
) -> Disc:
    """All within a radius of the segment from z = -half to half."""
    return _solid("capsule", (half, radius), radius, half, color, matter, meaning)


def Cylinder(
    half: Measure,
    radius: Measure,
    color: str = "#cc79a7",
    *,
    matter: Matter = EARTH,
    meaning: str = "",
) -> Disc:
    """An upright cylinder from z = -half to half."""
    return _solid("cylinder", (half, radius), radius, half, color, matter, meaning)


def Cone(
    half: Measure,
    radius: Measure,
    color: str = "#e69f00",
    *,
    matter: Matter = EARTH,
    meaning: str = "",
) -> Disc:
    """A cone with its base at z = -half and its tip at z = half."""
    return _solid("cone", (half, radius), radius, half, color, matter, meaning)


def Mesh(
    file: str,
    scale: Measure = 1.0,
    color: str = "#56b4e9",
    *,
    radius: Measure = 0.5,
    matter: Matter = EARTH,
    meaning: str = "",
) -> Disc:
    """The surface in a file; a body that moves has the convex hull of its points.

    Args:
        file: name of the parameter with the asset's name; see `meshes`.
        scale: factor of its coordinates, which then are metres.
        color: of its outline in the plane.
        radius: of its outline in the plane.
        matter: what it is made of.
        meaning: text of the legend.

    """
    return _solid("mesh", (file, scale), radius, radius, color, matter, meaning)


def Terrain(
    heights: str,
    cell: Measure,
    colors: tuple[tuple[int, str], ...] = ((0, "#ddd6a3"),),
    *,
    matter: Matter = EARTH,
    meanings: tuple[str, ...] = (),
) -> Raster:
    """A ground from a matrix of heights in centimetres; row r, column c at (r·cell, c·cell)."""
    spatial = ("terrain", *matter.measures, heights, cell)
    return Raster(heights, cell, colors=colors, meanings=meanings, spatial=spatial)


def Poster(
    cells: str,
    cell: Measure,
    colors: tuple[tuple[int, str], ...] = ((0, "#000000"), (1, "#ffffff")),
    *,
    meanings: tuple[str, ...] = (),
) -> Raster:
    """A picture of squares that stands around the origin and faces along x; physics ignores it.

    Row 0 of the matrix is the uppermost, and column 0 is at the left for who looks at it. In the
    plane, it lies on the ground.

    Args:
        cells: name of the parameter with the matrix.
        cell: side of a square, metres.
        colors: the least value of each colour, as in `Raster`; "" for squares without one.
        meanings: texts of the legend.

    """
    if not isinstance(cell, str) and not 0 < cell < 1e6:
        raise BodiesError(f"Poster: squares of {cell} m; expected metres above 0, below 1e6")
    return Raster(cells, cell, colors=colors, meanings=meanings, spatial=(POSTER, cells, cell))


def euler(
    x: Measure = 0.0,
    y: Measure = 0.0,
    z: Measure = 0.0,
    *,
    turn: Measure = 0.0,
    pitch: Measure = 0.0,
    roll: Measure = 0.0,
) -> Motion:
    """A translation, then a turn about z, a pitch about the new y and a roll about the new x."""
    return Motion(x, y, turn, spatial=("euler", z, pitch, roll))


def quaternion(
    x: Measure, y: Measure, z: Measure, w: Measure, i: Measure, j: Measure, k: Measure
) -> Motion:
    """A translation, then the rotation w + xi + yj + zk, which need not be of length 1.

    Views of the plane show the translation only.
    """
    return Motion(x, y, spatial=("quaternion", z, w, i, j, k))


def Command(kind: str, x: Measure, y: Measure, z: Measure) -> Motion:
    """A command for the body within, for one frame; its vector is in the frame of the world.

    Args:
        kind: force (N), torque (N·m), impulse (N·s), twist (an angular impulse, N·m·s), velocity
            (m/s) or spin (an angular velocity, rad/s).
        x: the vector, with y and z; one of length 0 commands nothing.
        y: of the vector.
        z: of the vector.

    """
    if kind not in COMMANDS:
        raise BodiesError(f"Command({kind!r}): expected one of {', '.join(COMMANDS)}")
    return Motion(spatial=(kind, x, y, z))


def Joint(
    kind: str,
    first: str,
    second: str,
    *,
    axis: tuple[Measure, Measure, Measure] = (0.0, 0.0, 1.0),
    low: Measure = 0.0,
    high: Measure = 0.0,
    target: Measure = 0.0,
    stiffness: Measure = 0.0,
    speed: Measure = 0.0,
    damping: Measure = 0.0,
    color: str = "#444444",
    meaning: str = "",
) -> Disc:
    """A joint at this place between the bodies of two agents; "" is the scenery.

    Its position, an angle (degrees) or a distance (metres), is 0 where it is created. The motor of
    a revolute or prismatic joint acts with stiffness · (target - position) + damping · (speed -
    velocity), angles in radians here, and is none if both factors are 0.

    Args:
        kind: fixed, revolute, prismatic or spherical.
        first: name of the parameter with the id of an agent.
        second: name of the parameter with the id of another one.
        axis: of a revolute or prismatic joint, in the frame of this place.
        low: least position; of a spherical joint, about each axis. If it equals `high`, there are
            no limits.
        high: largest position.
        target: position that its motor holds, degrees or metres.
        stiffness: of its motor, N·m or N/m.
        speed: of its motor, degrees or metres per second.
        damping: of its motor, N·m·s or N·s/m.
        color: of its mark in the plane.
        meaning: text of the legend.

    """
    if kind not in JOINTS:
        raise BodiesError(f"Joint({kind!r}): expected one of {', '.join(JOINTS)}")
    spatial = (kind, first, second, *axis, low, high, target, stiffness, speed, damping)
    return Disc(0.05, color, meaning=meaning, spatial=spatial)


def _solid(
    name: str,
    sizes: tuple[Measure, ...],
    radius: Measure,
    half: Measure,
    color: str,
    matter: Matter,
    meaning: str,
) -> Disc:
    for size in sizes:
        if not isinstance(size, str) and not LEAST <= size < 1e6:
            raise BodiesError(f"{name}: a size is {size}; expected metres from {LEAST}, below 1e6")
    height = 0.3 if isinstance(half, str) else 2.0 * half
    spatial: Spatial = (name, *matter.measures, *sizes)
    return Disc(radius, color, height=height, meaning=meaning, spatial=spatial)
