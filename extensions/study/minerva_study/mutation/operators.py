"""The operators: each derives another string, or returns None if it is not applicable.

Added agents have unique ids, and at least one node of the string remains.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from minerva_bus.grammar.scene import EMPTY, FigureNode, Node, Scene, Value, scene_of, with_scope
from minerva_bus.grammar.text_and_digest import head, value_text
from minerva_bus.launch.assignment import NodePath, places
from minerva_study.domains import Extent
from minerva_study.mutation.mutable import Targets
from minerva_study.mutation.naming import with_own_ids
from minerva_study.mutation.nodes import (
    ids_of,
    new_node,
    put,
    scope_of,
    with_value,
    with_value_at,
)
from minerva_study.mutation.values import Inner, drawn, one_of, perturbed

Stream = np.random.Generator


@dataclass(frozen=True, slots=True)
class Mutant:
    """A string and a description of its mutation: `PEye.left 1 → 1.25`."""

    scene: Scene
    how: str


@dataclass(frozen=True, slots=True)
class Material:
    """Arguments of an operator: a string, the targets in it, limits and a random stream."""

    scene: Scene
    targets: Targets
    limit: Extent
    chance: Stream
    inner: Inner

    def all(self) -> list[NodePath]:
        """All nodes down to the maximum depth."""
        return places(self.scene, self.limit.depth)

    def movable(self) -> list[NodePath]:
        """The nodes that may be added, removed and moved."""
        return [field for field in self.all() if self.targets.whole(field)]

    def one_of(self, places: Sequence[NodePath]) -> NodePath | None:
        """A random one of the places; None if there are none."""
        return one_of(places, self.chance) if places else None

    def new(self, scope: Scene = EMPTY, without: Scene = EMPTY) -> Node:
        """A new node of a random symbol."""
        return new_node(self.scene, self.targets, scope, without, self.chance)

    def with_own_ids(self, nodes: Scene, without: Scene = EMPTY) -> Scene:
        """Nodes of another string with ids that are unique here after replacing `without`."""
        return with_own_ids(nodes, ids_of(self.scene) - ids_of(without))


Operator: TypeAlias = Callable[[Material], Mutant | None]


def perturb(given: Material) -> Mutant | None:
    """Change one parameter to a value near its own, of its type and in its domain."""
    candidates = [
        (place, n, field, domain)
        for place in given.all()
        for n, field, domain in given.targets.fields(place)
    ]
    if not candidates:
        return None
    place, n, parameter, domain = one_of(candidates, given.chance)
    old = place.node.values[n]
    new = perturbed(parameter.type, domain, old, given.chance, given.inner)
    if new is old:
        return None
    text = f"{_name(place.node)}.{parameter.name} {_short(old)} → {_short(new)}"
    return Mutant(put(given.scene, place, [with_value(place.node, n, new)]), text)


def replace(given: Material) -> Mutant | None:
    """Replace a node by a new one of any symbol, which keeps the scope if it can have one."""
    place = given.one_of(given.movable())
    if place is None or not given.targets.symbols:
        return None
    kept = scope_of(place.node)
    node = given.new(kept, scene_of(place.node))
    if isinstance(node, FigureNode) and kept:
        return None  # The whole scope would be lost: that is a deletion, not a replacement.
    return Mutant(put(given.scene, place, [node]), f"{_name(place.node)} replaced by {_name(node)}")


def insert(given: Material) -> Mutant | None:
    """Insert a new node beside another, into its scope, or around it."""
    if not given.targets.symbols:
        return None
    place = given.one_of(given.movable())
    if place is None:
        node = given.new()
        free = not given.targets.all
        return Mutant(given.scene + scene_of(node), f"{_name(node)} inserted") if free else None
    choice = given.chance.integers(3)
    # Around the node, in its scope, or beside it, which is also the fallback.
    if choice == 0:
        around = given.new(scene_of(place.node))
        if not isinstance(around, FigureNode):
            text = f"{_name(around)} inserted around {_name(place.node)}"
            return Mutant(put(given.scene, place, [around]), text)
    node = given.new()
    text = f"{_name(node)} inserted"
    if choice == 1 and not isinstance(place.node, FigureNode):
        inside = with_scope(place.node, place.node.scope + scene_of(node))
        return Mutant(put(given.scene, place, [inside]), text)
    return Mutant(put(given.scene, place, [place.node, node]), text)


def delete(given: Material) -> Mutant | None:
    """Delete a node, with or without its scope."""
    place = given.one_of(given.movable())
    if place is None:
        return None
    kept = scope_of(place.node).nodes if given.chance.random() < 0.5 else ()
    # The string would become ε, which ends a world.
    if place.parent is None and not kept and len(given.scene) == 1:
        return None
    return Mutant(put(given.scene, place, kept), f"{_name(place.node)} deleted")


def duplicate(given: Material) -> Mutant | None:
    """Place a copy of a node, with its scope, beside it."""
    place = given.one_of(given.movable())
    if place is None:
        return None
    copy = given.with_own_ids(scene_of(place.node))
    text = f"{_name(place.node)} duplicated"
    return Mutant(put(given.scene, place, [place.node, *copy.nodes]), text)


def swap(given: Material) -> Mutant | None:
    """Exchange two nodes, neither of which contains the other."""
    movable = given.movable()
    left, right = given.one_of(movable), given.one_of(movable)
    if left is None or right is None or left is right:
        return None
    first, second = sorted((left, right), key=lambda place: place.path)
    # The first node contains the second.
    if second.path[: first.depth] == first.path:
        return None
    # The later place first, because replacing it leaves the path of the earlier one valid.
    there = put(given.scene, second, [first.node])
    again = next(p for p in places(there, first.depth) if p.path == first.path)
    text = f"{_name(first.node)} and {_name(second.node)} swapped"
    return Mutant(put(there, again, [second.node]), text)


def cross(given: Material, other: Scene) -> Mutant | None:
    """Replace a node by one of another string, with the same symbol if there is one."""
    place = given.one_of(given.movable())
    donors = [item for item in places(other, given.limit.depth) if given.targets.whole(item)]
    if place is None or not donors:
        return None
    # A node of the same symbol is more likely to make sense in its new place.
    alike = [item for item in donors if item.node.symbol == place.node.symbol]
    donor = given.one_of(alike or donors)
    assert donor is not None
    taken = given.with_own_ids(scene_of(donor.node), scene_of(place.node))
    text = f"{_name(donor.node)} from the other parent"
    return Mutant(put(given.scene, place, taken.nodes), text)


def blend(given: Material, other: Scene) -> Mutant | None:
    """Take each changeable parameter from either string, in nodes that both strings have."""
    theirs = {(item.path, item.node.symbol): item.node for item in places(other, given.limit.depth)}
    scene = given.scene
    for place in given.all():
        donor = theirs.get((place.path, place.node.symbol))
        for n, _, _ in given.targets.fields(place) if donor is not None else ():
            if donor is not None and given.chance.random() < 0.5:
                scene = with_value_at(scene, place.path, n, donor.values[n])
    return None if scene is given.scene else Mutant(scene, "values from the other parent")


def scatter(given: Material) -> Mutant:
    """Draw every parameter with a domain from its domain."""
    scene = given.scene
    for place in given.all():
        for n, field, domain in given.targets.fields(place):
            if domain is not None:
                scene = with_value_at(scene, place.path, n, drawn(field.type, domain, given.chance))
    return Mutant(scene, "resampled")


def _name(node: Node) -> str:
    return head(node).partition("<")[0]


def _short(value: Value) -> str:
    text = f"{value:.4g}" if isinstance(value, float) else value_text(value)
    return text if len(text) <= 24 else text[:23] + "…"
