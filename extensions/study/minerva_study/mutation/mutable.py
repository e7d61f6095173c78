"""What may mutate in strings: the nodes and parameters that targets name.

ABug                  every ABug; see launch/assignment.py
ABug.speed            this attribute of every ABug
ABug.speed=0:2        from 0 to 2; numbers may have units
ABug.gait=walk,run    one of these values
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch import assignment
from minerva_bus.launch.assignment import ANY, NodePath
from minerva_bus.values import fast_dataclass
from minerva_study.domains import Domain, parse_domain


@fast_dataclass
class MutableTarget(assignment.Target):
    """Nodes, or one of their parameters with the values that it may have."""

    domain: Domain = None


@dataclass(frozen=True, slots=True)
class Targets:
    """What may mutate in the strings of a vocabulary; without any target, everything."""

    vocabulary: Vocabulary
    all: tuple[MutableTarget, ...] = ()

    def whole(self, place: NodePath) -> bool:
        """Whether a complete node may be removed, added or moved."""
        return not self.all or any(not field.parameter and field.meets(place) for field in self.all)

    def fields(self, place: NodePath) -> Iterator[tuple[int, Field, Domain]]:
        """The parameters of a node that may change: index, field and domain."""
        for n, field in enumerate(self.vocabulary.fields(place.node.symbol).all):
            target = self._domain(place, field.name)
            if target is not None:
                yield n, field, target.domain

    def _domain(self, place: NodePath, name: str) -> MutableTarget | None:
        """The most specific target that allows a parameter to change."""
        if not self.all:
            return _EVERYTHING
        met = [field for field in self.all if field.parameter in ("", name) and field.meets(place)]
        return max(met, key=_exactness, default=None)

    def idle(self, places: Sequence[NodePath]) -> list[int]:
        """Indexes of targets that match neither these nodes nor nodes that may be added."""
        may_come = set(self.symbols)
        return [
            number
            for number, field in enumerate(self.all)
            if _symbol(field) not in may_come and not any(self._is_of(field, it) for it in places)
        ]

    def _is_of(self, target: MutableTarget, place: NodePath) -> bool:
        names = ("", *self.vocabulary.fields(place.node.symbol).names)
        return target.parameter in names and target.meets(place)

    @property
    def symbols(self) -> Sequence[str]:
        """The symbols of nodes that may be added."""
        words = self.vocabulary
        every = [*words.primitives, *words.transformations, *words.kinds]
        named = {_symbol(field) for field in self.all if not field.parameter}
        return every if not self.all else [target for target in every if target in named]

    def domain(self, symbol: str, name: str) -> Domain:
        """The domain of a parameter of a new node at any place."""
        of_it = [field for field in self.all if (_symbol(field), field.parameter) == (symbol, name)]
        return max(of_it, key=_exactness).domain if of_it else None


_EVERYTHING: Final = MutableTarget((ANY,))


def _symbol(target: MutableTarget) -> str:
    return target.steps[-1].partition("#")[0]


def _exactness(target: MutableTarget) -> tuple[bool, bool, int]:
    # A target for one parameter precedes one for its node, bounds precede none, and a longer path
    # precedes a shorter one.
    return bool(target.parameter), target.domain is not None, len(target.steps)


def parse_targets(texts: Sequence[str], vocabulary: Vocabulary) -> Targets:
    """Targets from texts as in the module's table. Raises MisuseError."""
    return Targets(vocabulary, tuple([_target(text, vocabulary) for text in texts]))


def _target(text: str, vocabulary: Vocabulary) -> MutableTarget:
    place, equals, values = text.partition("=")
    plain, field = assignment.parse_target(place, vocabulary)
    if not equals:
        return MutableTarget(plain.steps, plain.parameter)
    name = plain.parameter
    if not name:
        raise MisuseError(f"{text!r}: values need a parameter, as in {place}.NAME={values}")
    if field is None:
        raise MisuseError(f"{text!r}: bounds need the symbol that has {name}: SYMBOL.{name}=...")
    return MutableTarget(plain.steps, name, parse_domain(values, field.type, place))
