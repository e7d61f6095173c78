"""Targets: the nodes and parameters of a string that may mutate, and their bounds.

ABug                  every ABug: it may be replaced, deleted and copied; its state may change
ABug.speed            only this attribute of every ABug
ABug.speed=0:2        from 0 to 2; numbers may have units
ABug.gait=walk,run    one of these values
ABug#b1.speed=0:2     of one agent; `#b1` without a symbol is valid, too
ABug/TMount/PEye      every PEye directly in a TMount directly in an ABug; `*` is any node
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.conversion import Unfit
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.mutation.domains import Domain, parse_domain
from minerva_bus.grammar.mutation.places import NodePath
from minerva_bus.grammar.scene import AGENT_ID, AgentNode, Node
from minerva_bus.grammar.vocabulary import Vocabulary

ANY: Final = "*"


@dataclass(frozen=True, slots=True)
class Target:
    """Nodes, by steps from the outermost to their own, or one of their parameters."""

    steps: tuple[str, ...]
    parameter: str = ""
    domain: Domain = None

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


def parse_target(text: str, vocabulary: Vocabulary) -> Target:
    """The target that a text of the module's table describes. Raises MisuseError."""
    place, equals, values = text.partition("=")
    path, dot, name = place.partition(".")
    steps = tuple([step.strip() for step in path.split("/")])
    for step in steps:
        _check_step(text, step, vocabulary)
    if not dot:
        if equals:
            raise MisuseError(f"{text!r}: values need a parameter, as in {path}.NAME={values}")
        return Target(steps)
    kind = _type_of(text, steps[-1], name.strip(), vocabulary)
    if not equals:
        return Target(steps, name.strip())
    if kind is None:
        raise MisuseError(f"{text!r}: bounds need the symbol that has {name}: SYMBOL.{name}=...")
    return Target(steps, name.strip(), parse_domain(values, kind.type, place))


def _check_step(text: str, step: str, vocabulary: Vocabulary) -> None:
    symbol, mark, name = step.partition("#")
    if mark and AGENT_ID.fullmatch(name) is None:
        raise MisuseError(f"{text!r}: #{name} is not a valid agent id")
    if symbol not in (("", ANY) if mark else (ANY,)):
        try:
            vocabulary.fields(symbol)
        except Unfit as unfit:
            raise MisuseError(f"{text!r}: {unfit}") from None


def _type_of(text: str, step: str, name: str, vocabulary: Vocabulary) -> Field | None:
    """The field that a target names; None if it names no symbol."""
    symbol = step.partition("#")[0]
    if symbol in ("", ANY):
        return None
    fields = vocabulary.fields(symbol)
    if name not in fields.names:
        known = nearest(name, list(fields.names))
        has = ", ".join(fields.names) or "none"
        raise MisuseError(f"{text!r}: {symbol} has no {name!r}{known}; it has {has}")
    return next(field for field in fields.all if field.name == name)
