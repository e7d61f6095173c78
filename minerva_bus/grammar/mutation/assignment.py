"""Parameters of a string that get a given value: `AEgg.speed=0.3`, `#anna.water=5`.

The nodes are those of a target (targets.py). Studies search for such values, and the settings of
a run can set them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.columns import has_columns, packed
from minerva_bus.grammar.conversion import Unfit
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.mutation.domains import Interval, OneOf, parse_domain, parse_value
from minerva_bus.grammar.mutation.nodes import with_value
from minerva_bus.grammar.mutation.places import NodePath, extent, places
from minerva_bus.grammar.mutation.targets import Target, parse_targets
from minerva_bus.grammar.mutation.targets import parse_target
from minerva_bus.grammar.packing import has_columns, packed
from minerva_bus.grammar.scene import Node, Scene, Value, agents, rescoped
from minerva_bus.grammar.traversal import rebuild, walk
from minerva_bus.grammar.vocabulary import Vocabulary

# Symbols begin with their letter and another capital one, names of processes usually do not.
_OF_STRING: Final = re.compile(r"[PTA][A-Z]|[^.=]*[#*/]")


def names_nodes(key: str) -> bool:
    """Whether a key such as `AEgg.speed` or `#anna.water` names nodes of a string."""
    return "." in key and _OF_STRING.match(key) is not None


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of all nodes of a string that a key names."""

    key: str
    target: Target
    field: Field

    def value(self, text: str) -> Value:
        """The value that a text represents, in the parameter's unit. Raises MisuseError."""
        try:
            return parse_value(text, self.field.type)
        except Unfit as unfit:
            raise MisuseError(f"{self.key}={text}: expected {unfit}") from None

    def domain(self, text: str) -> Interval | OneOf:
        """The values in a text such as `0:2` or `walk,run`. Raises MisuseError."""
        return parse_domain(text, self.field.type, self.key)


def parameter_of(key: str, scene: Scene, vocabulary: Vocabulary) -> Parameter:
    """The parameter that a key names. Raises MisuseError, also if the string has no such node."""
    path, _, name = key.partition(".")
    above, slash, last = path.rpartition("/")
    symbol, mark, wanted = last.partition("#")
    if mark and not symbol:
        last = f"{_symbol_of(wanted, key, scene)}#{wanted}"
    if last in ("", "*"):
        raise MisuseError(f"{key}: expected a symbol or #ID before .{name}, as in AFox.{name}")
    target = parse_target(f"{above}{slash}{last}.{name}", vocabulary)
    if not any(map(target.meets, places(scene, extent(scene).depth))):
        symbols = sorted({node.symbol for opens, node in walk(scene) if opens})
        raise MisuseError(
            f"{key}: the world's string has no {path}; it has {', '.join(symbols[:12])}"
        )
    fields = vocabulary.fields(target.steps[-1].partition("#")[0])
    return Parameter(key, target, next(field for field in fields.all if field.name == name))


def assigned(scene: Scene, vocabulary: Vocabulary, texts: Sequence[str]) -> Scene:
    """The string with the values of texts KEY=VALUE; of two for one parameter the later one counts.

    Raises MisuseError.
    """
    for text in texts:
        key, _, value = text.partition("=")
        parameter = parameter_of(key.strip(), scene, vocabulary)
        changed = _with_value(scene, parameter, parameter.value(value))
        # A population in columns stays in columns, which run faster.
        scene = packed(changed) if has_columns(scene) else changed
    return scene


def _symbol_of(agent: str, key: str, scene: Scene) -> str:
    symbols = {node.id: node.symbol for node in agents(scene)}
    if agent not in symbols:
        close = nearest(agent, list(symbols))
        raise MisuseError(f"{key}: the world's string has no agent #{agent}{close}")
    return symbols[agent]


def _with_value(scene: Scene, parameter: Parameter, value: Value) -> Scene:
    every = places(scene, extent(scene).depth)
    met = map(parameter.target.meets, _inner_first(every))

    def leave(node: Node, scope: Scene) -> Node:
        made = rescoped(node, scope)
        if not next(met):
            return made
        return with_value(made, made.names.index(parameter.field.name), value)

    return rebuild(scene, leave)


def _inner_first(every: Sequence[NodePath]) -> Iterator[NodePath]:
    """Places from left to right, in the order in which nodes end: that of `rebuild`."""
    opened: list[NodePath] = []
    for place in every:
        while opened and opened[-1].depth >= place.depth:
            yield opened.pop()
        opened.append(place)
    yield from reversed(opened)
