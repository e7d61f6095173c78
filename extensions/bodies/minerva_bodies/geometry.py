"""The geometric system of space: what a string means to bodies, joints, sensors and commands.

β and δ move a rigid pose; α adds a solid to the body of its owner: the agent whose view it is, or
the agent that the text parameter `who` of the figure or of a transformation around it names. The
outermost motion within an agent is the pose of its body, and places it when it is new; motions
within it place its solids. Solids without an owner are scenery, which never moves. A motion of the
plane is one on the ground; other forms of the plane have no meaning here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bodies.errors import BodiesError
from minerva_bodies.forms import (
    COMMANDS,
    DYNAMIC,
    JOINTS,
    KINEMATIC,
    LEAST,
    MATERIAL,
    SIZES,
    UNFELT,
)
from minerva_bodies.rigid import Rigid
from minerva_bodies.sensors import SENSORS, Sensor
from minerva_bus.grammar.appearance import Measure, Motion, Spatial
from minerva_bus.grammar.columns import Columns, walk_pieces
from minerva_bus.grammar.scene import AgentNode, FigureNode, Scene, TransformationNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import Geometry, interpret
from minerva_bus.world.services import View

Part: TypeAlias = list[Any]
"""A solid as plain data: its form, the numbers of its material, its sizes, its pose in the body."""
Act: TypeAlias = tuple[str, float, float, float]
"""A command: its kind and its vector."""

NOTHING: Final = MappingProxyType[str, list[Any]]({})

MAX_NUMBER = 1e18
"""Largest number that enters Rapier, whose squares its single precision must still hold."""


@dataclass(slots=True)
class ShownBody:
    """A body as a string shows it: its pose, solids, and commands (name, x, y, z)."""

    pose: Rigid
    parts: list[Part] = field(default_factory=list[Part])
    commands: tuple[Act, ...] = ()

    @property
    def plain(self) -> list[Any]:
        """The body as plain data: its pose and solids."""
        return [list(self.pose.numbers), self.parts]

    @property
    def kinematic(self) -> bool:
        """Whether it follows its pose in the string."""
        return any(part[1][3] == KINEMATIC for part in self.parts)


class SpaceGeometry(Geometry):
    """Contents of one view, collected by φ.

    Args:
        vocabulary: of the world.
        known: the bodies that exist, each with its pose and solids; their rows in populations are
            not read again unless they have a command or other sizes.
        who: the name of the parameter with the id of an owner.

    Attributes:
        seen: ids of the agents with bodies, with the number of their solids.
        changed: those of known bodies whose solids are others now.
        bodies: those that are new, single or commanded; "" is the scenery.
        joints: plain data by name: kind, ids, pose, and the numbers of the joint.
        sensors: in the order of the string.

    """

    def __init__(
        self, vocabulary: Vocabulary, known: Mapping[str, list[Any]] = NOTHING, who: str = "who"
    ) -> None:
        self._vocabulary, self._known, self._who = vocabulary, known, who
        self.changed: set[str] = set()
        self._owner: str = ""
        self.pose = Rigid()
        # The pose of the body within which α adds solids, and the pose relative to it.
        self._base: Rigid | None = None
        self._inner = Rigid()
        self._commands: tuple[Act, ...] = ()
        self._clear()

    def _clear(self) -> None:
        self.seen = Counter[str]()
        # Bodies of which rows have not been read.
        self._partial: set[str] = set()
        self.bodies: dict[str, ShownBody] = {}
        self.joints: dict[str, list[Any]] = {}
        self.sensors: list[Sensor] = []

    def read(self, view: View) -> None:
        """φ of a view. Raises BodiesError for anything that cannot stand as it shows it."""
        self._read(view)
        changed = {who for who in self.seen if who in self._known and self._differs(who)}
        if not changed.isdisjoint(self._partial):
            # Again, with all rows of these bodies.
            known = self._known
            self._known = {who: plain for who, plain in known.items() if who not in changed}
            self._clear()
            self._read(view)
            self._known = known
        self.changed = changed

    def _differs(self, who: str) -> bool:
        parts = self._known[who][1]
        if who not in self._partial:
            return self.bodies[who].parts != parts
        shown = self.bodies[who].parts if who in self.bodies else []
        return self.seen[who] != len(parts) or any(part not in parts for part in shown)

    def _read(self, view: View) -> None:
        for opens, node in walk_pieces(view.skeleton, self.many):
            if isinstance(node, AgentNode):
                if opens and node.id in view.parts:
                    self._owner = node.id
                    interpret(view.parts[node.id], self)
                    self._owner = ""
            elif isinstance(node, FigureNode):
                self.draw(node)
            elif opens:
                self.enter(node)
            else:
                self.leave(node)

    def other_figure(self, figure: FigureNode) -> None:
        """α of a solid or a joint."""
        primitive = self._vocabulary.primitives.get(figure.symbol)
        spatial = primitive.shape.spatial if primitive is not None and primitive.shape else ()
        if not spatial or spatial[0] in UNFELT:
            return
        owner = str(figure.parameters.get(self._who, "")) or self._owner
        if owner.startswith("~"):
            raise BodiesError(
                f"{figure.symbol} in the view of a population has no owner; give it, or a"
                f" transformation around it, a text parameter {self._who} with the agent's id"
            )
        values = [value_of(measure, figure, owner) for measure in spatial[1:]]
        if spatial[0] in JOINTS:
            self._joint(str(spatial[0]), owner, figure, values)
        elif spatial[0] in SENSORS:
            mount = self._inner if self._base is not None else Rigid()
            self.sensors.append(Sensor(str(spatial[0]), owner, figure.symbol, mount, values))
        else:
            self.solid(str(spatial[0]), owner, figure, values)

    def solid(self, form: str, owner: str, figure: FigureNode, values: list[Any]) -> None:
        """α of a solid, at `pose`: its form, the agent that owns it, its material and sizes."""
        if form not in SIZES or len(values) != MATERIAL + SIZES[form]:
            raise BodiesError(
                f"{figure.symbol} has the form {form!r} in space; expected {', '.join(SIZES)}"
            )
        material, sizes = values[:MATERIAL], values[MATERIAL:]
        for size in sizes:
            if isinstance(size, float) and not LEAST <= size < 1e6:
                raise BodiesError(
                    f"{_where(owner, figure)}: a size is {size:g}; expected metres from {LEAST:g},"
                    " below 1e6"
                )
        if owner and form == "terrain" and material[3] == DYNAMIC:
            raise BodiesError(f"{_where(owner, figure)}: a terrain cannot move; make it fixed")
        self.seen[owner] += 1
        base = Rigid() if not owner else self.pose if self._base is None else self._base
        inner = self.pose if not owner else self._inner if self._base is not None else Rigid()
        shown = self.bodies.setdefault(owner, ShownBody(base, commands=self._commands))
        shown.parts.append([form, material, sizes, list(inner.numbers)])

    def _joint(self, kind: str, owner: str, figure: FigureNode, values: list[Any]) -> None:
        ids = [str(value) for value in values[:2]]
        name = "/".join((owner, figure.symbol, *ids))
        if name in self.joints:
            raise BodiesError(f"{_where(owner, figure)}: this joint appears twice; remove one")
        low, high, _, stiffness, _, damping = values[5:]
        if low > high or stiffness < 0.0 or damping < 0.0:
            raise BodiesError(
                f"{_where(owner, figure)}: limits {low:g} to {high:g}, stiffness {stiffness:g},"
                f" damping {damping:g}; expected low <= high, and factors from 0"
            )
        self.joints[name] = [kind, ids, list(self.pose.numbers), values[2:]]

    def other_transformation(
        self, transformation: TransformationNode
    ) -> AbstractContextManager[Any]:
        """β and δ: move the pose, or give a command to the body within."""
        return self._within(transformation)

    @contextmanager
    def _within(self, node: TransformationNode) -> Generator[None]:
        before = self.pose, self._base, self._inner, self._commands, self._owner
        self._owner = str(node.parameters.get(self._who, "")) or self._owner
        declared = self._vocabulary.transformations.get(node.symbol)
        motion = declared.motion if declared is not None else None
        if motion is not None and motion.spatial and motion.spatial[0] in COMMANDS:
            x, y, z = [value_of(measure, node, self._owner) for measure in motion.spatial[1:]]
            if x or y or z:
                self._commands = (*self._commands, (str(motion.spatial[0]), x, y, z))
        elif motion is not None:
            self._move(moved(motion, node, self._owner))
        yield
        self.pose, self._base, self._inner, self._commands, self._owner = before

    def _move(self, by: Rigid) -> None:
        self.pose = self.pose.then(by)
        if self._base is not None:
            self._inner = self._inner.then(by)
        elif self._owner:
            self._base = self.pose

    def many(self, columns: Columns) -> bool:
        """Read only the rows of a population that are new, or no longer as known."""
        levels = list(columns.levels())
        primitive = self._vocabulary.primitives.get(levels[-1].symbol)
        spatial = primitive.shape.spatial if primitive is not None and primitive.shape else ()
        if not spatial or spatial[0] in UNFELT:
            return True
        if spatial[0] in (*JOINTS, *SENSORS) or spatial[4] == KINEMATIC:
            return False
        owners = next(
            (level.column(self._who) for level in levels if self._who in level.names), None
        )
        if owners is None:
            return False
        names: list[str] = owners.tolist()
        known = self._known
        rows = {row for row, name in enumerate(names) if name not in known}
        commands = dict[int, tuple[Act, ...]]()
        for level in levels[:-1]:
            kind, vectors = self._vectors(level)
            # The reading of a single row raises the error.
            rows.update(np.flatnonzero(~(np.abs(vectors) < MAX_NUMBER).all(axis=1)).tolist())
            given = np.flatnonzero(vectors.any(axis=1))
            for row, (x, y, z) in zip(given.tolist(), vectors[given].tolist(), strict=True):
                commands[row] = (*commands.get(row, self._commands), (kind, x, y, z))
        rows.update(self._resized(levels[-1], spatial[1 + MATERIAL :], names))
        unread = [name for row, name in enumerate(names) if row not in rows]
        self.seen.update(unread)
        self._partial.update(unread)
        for row in range(columns.count) if self._commands else sorted({*rows, *commands}):
            if row in rows:
                interpret(Scene((columns.node(row),)), self)
            else:
                given = commands.get(row, self._commands)
                self.bodies.setdefault(names[row], ShownBody(Rigid(), commands=given))
        return True

    def _resized(
        self, solids: Columns, sizes: Sequence[Measure], names: Sequence[str]
    ) -> Iterator[int]:
        """The rows of known bodies whose solids have other sizes now."""
        if any(isinstance(size, str) for size in sizes):
            shown = zip(*(_listed(solids, size) for size in sizes), strict=True)
            for row, (name, values) in enumerate(zip(names, shown, strict=True)):
                known = self._known.get(name)
                if known is not None and all(part[2] != list(values) for part in known[1]):
                    yield row

    def _vectors(self, level: Columns) -> tuple[str, NDArray[np.float64]]:
        """The kind and the vectors (n, 3) of commands; zeros for other transformations."""
        declared = self._vocabulary.transformations.get(level.symbol)
        motion = declared.motion if declared is not None else None
        if motion is None or not motion.spatial or motion.spatial[0] not in COMMANDS:
            return "", np.zeros((level.count, 3))
        columns = [_listed(level, measure) for measure in motion.spatial[1:]]
        return str(motion.spatial[0]), np.array(columns, np.float64).T


def _listed(level: Columns, measure: Measure) -> list[Any]:
    return level.column(measure).tolist() if isinstance(measure, str) else [measure] * level.count


def moved(motion: Motion, node: TransformationNode, owner: str) -> Rigid:
    """The pose to which a motion with a node's parameters leads. Raises BodiesError."""

    def number(measure: Any) -> float:
        return value_of(measure, node, owner)

    x, y = number(motion.x), number(motion.y)
    spatial: Spatial = motion.spatial or ("euler", 0.0, 0.0, 0.0)
    z, *rest = map(number, spatial[1:])
    if spatial[0] == "quaternion":
        try:
            return Rigid.quaternion(x, y, z, *rest)
        except BodiesError as error:
            raise BodiesError(f"{_where(owner, node)}: {error}") from None
    if spatial[0] != "euler":
        raise BodiesError(
            f"{node.symbol} has the form {spatial[0]!r} in space; expected euler, quaternion,"
            f" {', '.join(COMMANDS)}"
        )
    made = Rigid.euler(x, y, z, number(motion.turn), *rest)
    return made.then(Rigid(number(motion.forward))) if motion.forward else made


def value_of(measure: Any, node: FigureNode | TransformationNode, owner: str) -> Any:
    """The value of a measure: a number, a text, or a matrix as lists."""
    value = node.parameters[measure] if isinstance(measure, str) else measure
    if isinstance(value, str):
        return value
    if isinstance(value, np.ndarray):
        return value.tolist()
    if not abs(value) < MAX_NUMBER:
        raise BodiesError(
            f"{_where(owner, node)}: {measure} is {value}; expected a number below {MAX_NUMBER:g}"
        )
    return float(value)


def _where(owner: str, node: FigureNode | TransformationNode) -> str:
    return f"agent {owner}, {node.symbol}" if owner else f"the scenery, {node.symbol}"
