"""Parameters of a string that get a given value: `AEgg.speed=0.3`, `#anna.water=5`.

The settings of a run set them. A target names nodes, or one of their parameters:

ABug                  every ABug
ABug.speed            this attribute of every ABug
ABug#b1.speed         of one agent; `#b1` without a symbol is valid, too
ABug/TMount/PEye      every PEye directly in a TMount directly in an ABug; `*` is any node
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from minerva_bus.errors import MisuseError, SceneError, nearest
from minerva_bus.grammar.columns import has_columns, packed
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.parser import parse_value
from minerva_bus.grammar.scene import (
    AGENT_ID,
    AgentNode,
    FigureNode,
    Node,
    Scene,
    TransformationNode,
    Value,
    agents,
    rebuild,
    rescoped,
    walk,
)
from minerva_bus.grammar.types import Type, Unfit
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.values import fast_dataclass

# Symbols begin with their letter and another capital one, names of processes usually do not.
_OF_STRING: Final = re.compile(r"[PTA][A-Z]|[^.=]*[#*/]")


def names_nodes(key: str) -> bool:
    """Whether a key such as `AEgg.speed` or `#anna.water` names nodes of a string."""
    return "." in key and _OF_STRING.match(key) is not None


@fast_dataclass
class Parameter:
    """A parameter of all nodes of a string that a key names."""

    key: str
    target: Target
    field: Field

    def value(self, text: str) -> Value:
        """The value that a text represents, in the parameter's unit. Raises MisuseError."""
        try:
            return typed_value(text, self.field.type)
        except Unfit as unfit:
            raise MisuseError(f"{self.key}={text}: expected {unfit}") from None


def parameter_of(key: str, scene: Scene, vocabulary: Vocabulary) -> Parameter:
    """The parameter that a key names. Raises MisuseError, also if the string has no such node."""
    path, _, name = key.partition(".")
    above, slash, last = path.rpartition("/")
    symbol, mark, wanted = last.partition("#")
    if mark and not symbol:
        last = f"{_symbol_of(wanted, key, scene)}#{wanted}"
    if last.partition("#")[0] in ("", ANY):
        raise MisuseError(f"{key}: expected a symbol or #ID before .{name}, as in AFox.{name}")
    target, field = parse_target(f"{above}{slash}{last}.{name}", vocabulary)
    if not any(map(target.meets, places(scene))):
        symbols = sorted({node.symbol for opens, node in walk(scene) if opens})
        raise MisuseError(
            f"{key}: the world's string has no {path}; it has {', '.join(symbols[:12])}"
        )
    assert field is not None  # The last step begins with a symbol.
    return Parameter(key, target, field)


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
        close = nearest(f"#{agent}", [f"#{known}" for known in symbols])
        raise MisuseError(f"{key}: the world's string has no agent #{agent}{close}")
    return symbols[agent]


def _with_value(scene: Scene, parameter: Parameter, value: Value) -> Scene:
    met = map(parameter.target.meets, _inner_first(places(scene)))

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


def typed_value(text: str, kind: Type) -> Value:
    """The value of a type that a text represents; texts need no quotes. Raises Unfit."""
    text = text.strip()
    if kind.kind == "text" and not text.startswith('"'):
        return kind.fit(text)
    try:
        return kind.fit(parse_value(text))
    except SceneError:
        raise Unfit(f"a value of the type {kind}, not {text!r}") from None


@dataclass(frozen=True, slots=True, eq=False)
class NodePath:
    """A node of a string with its index in the scope of its parent, and its depth."""

    node: Node
    index: int
    parent: NodePath | None = None
    depth: int = 1

    @property
    def path(self) -> tuple[int, ...]:
        """The indices from the outermost node to this one."""
        return tuple([above.index for above in self.upwards()])[::-1]

    def upwards(self) -> Iterator[NodePath]:
        """The place itself and the places around it, from inside to outside."""
        place: NodePath | None = self
        while place is not None:
            yield place
            place = place.parent


def places(scene: Scene, deepest: int | None = None) -> list[NodePath]:
    """All nodes of a string, or down to a depth, from left to right, outer nodes first."""
    result: list[NodePath] = []
    stack = _within(scene, None, deepest)
    while stack:
        place = stack.pop()
        result.append(place)
        if not isinstance(place.node, FigureNode):
            stack += _within(place.node.scope, place, deepest)
    return result


def _within(scene: Scene, parent: NodePath | None, deepest: int | None) -> list[NodePath]:
    depth = 1 if parent is None else parent.depth + 1
    if deepest is not None and depth > deepest:
        return []
    nodes = enumerate(scene.nodes)
    # Reversed, because the stack returns the last one first.
    return [NodePath(node, index, parent, depth) for index, node in nodes][::-1]


def with_value(node: Node, n: int, value: Value) -> Node:
    """The node with another value of its nth parameter."""
    values = (*node.values[:n], value, *node.values[n + 1 :])
    if isinstance(node, FigureNode):
        return FigureNode(node.symbol, node.names, values)
    if isinstance(node, TransformationNode):
        return TransformationNode(node.symbol, node.names, values, node.scope)
    return AgentNode(node.symbol, node.id, node.names, values, node.scope)


ANY: Final = "*"


@fast_dataclass
class Target:
    """Nodes, by steps from the outermost to their own, or one of their parameters."""

    steps: tuple[str, ...]
    parameter: str = ""

    def meets(self, place: NodePath) -> bool:
        """Whether a node is at the place that this target describes."""
        around = place.upwards()
        for step in reversed(self.steps):
            place_above = next(around, None)
            if place_above is None or not _is(place_above.node, step):
                return False
        return True


def _is(node: Node, step: str) -> bool:
    symbol, mark, name = step.partition("#")
    if mark and not (isinstance(node, AgentNode) and node.id == name):
        return False
    return symbol in ("", ANY, node.symbol)


def parse_target(text: str, vocabulary: Vocabulary) -> tuple[Target, Field | None]:
    """The target that a text of the module's table describes, and the field of its parameter.

    There is no field without a parameter, or without the symbol that has it. Raises MisuseError.
    """
    path, dot, name = text.partition(".")
    steps = tuple([step.strip() for step in path.split("/")])
    for step in steps:
        _check_step(text, step, vocabulary)
    name = name.strip()
    return Target(steps, name), _field_of(text, steps[-1], name, vocabulary) if dot else None


def _check_step(text: str, step: str, vocabulary: Vocabulary) -> None:
    symbol, mark, name = step.partition("#")
    if mark and AGENT_ID.fullmatch(name) is None:
        raise MisuseError(f"{text!r}: #{name} is not a valid agent id")
    if symbol not in (("", ANY) if mark else (ANY,)):
        try:
            vocabulary.fields(symbol)
        except Unfit as unfit:
            raise MisuseError(f"{text!r}: {unfit}") from None


def _field_of(text: str, step: str, name: str, vocabulary: Vocabulary) -> Field | None:
    """The field that a target names; None if it names no symbol."""
    symbol = step.partition("#")[0]
    if symbol in ("", ANY):
        return None
    fields = vocabulary.fields(symbol)
    if name not in fields.names:
        known = nearest(name, list(fields.names))
        has = ", ".join(fields.names) or "none"
        raise MisuseError(f"{text!r}: {symbol} has no {name!r}{known}; it has {has}")
    return fields.all[fields.names.index(name)]
