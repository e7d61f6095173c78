"""Hypothesis strategies for the language: values, vocabularies, strings and events.

    from hypothesis import given
    from minerva_bus.testing.strategies import scenes, vocabularies

    @given(scenes())
    def test_my_codec(w):
        assert decode(encode(w)) == w

Hypothesis must be installed (`pip install hypothesis`); nothing else in Minerva Bus needs it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache, lru_cache
from inspect import signature
from typing import Any, Final, TypeVar

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Default, Fields
from minerva_bus.grammar.scene import EMPTY, AgentNode, Node, Scene, Value, agents, rescoped
from minerva_bus.grammar.symbols import AgentKind, EventType, Primitive, Transformation
from minerva_bus.grammar.traversal import rebuild
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import Entry, Vocabulary
from minerva_bus.testing.any_string import (
    UNITS,
    agent_node,
    figure_node,
    given_ids,
    grown,
    ids,
    integers,
    matrices,
    matrices_of,
    names,
    quantities,
    reals,
    scenes,
    symbols,
    texts,
    transformation_node,
    values,
    with_unique_ids,
)
from minerva_bus.testing.family import FAMILY_VOCABULARY

__all__ = [
    "events_of",
    "family_events",
    "family_strings",
    "given_ids",
    "ids",
    "integers",
    "matrices",
    "names",
    "quantities",
    "reals",
    "scenes",
    "strings_of",
    "symbols",
    "texts",
    "types",
    "values",
    "values_of",
    "vocabularies",
    "with_unique_ids",
    "worlds",
]

_KINDS = ("bool", "int", "real", "text", "cells", "matrix")


@cache
def types(depth: int = 1) -> SearchStrategy[Type]:
    """Types of parameters, attributes and data."""
    plain = st.one_of(
        st.sampled_from(_KINDS).map(Type),
        st.sampled_from(UNITS).map(lambda unit: Type("real", unit)),
        st.lists(names(), min_size=1, max_size=3, unique=True).map(
            lambda words: Type("text", words=tuple(words))
        ),
    )
    if depth == 0:
        return plain
    return st.one_of(plain, types(depth - 1).map(lambda item: Type("list", item=item)))


# The strings are those of a vocabulary, and each vocabulary is drawn.
@lru_cache(4096)
def values_of(wanted: Type, strings: SearchStrategy[Scene] | None = None) -> SearchStrategy[Value]:
    """Values of one type, in their final form; `strings` draws those of strings of L(M)."""
    if wanted.item is not None:
        return st.lists(values_of(wanted.item, strings), max_size=3).map(tuple)
    if wanted.words:
        return st.sampled_from(wanted.words)
    by_kind: dict[str, SearchStrategy[Any]] = {
        "bool": st.booleans(),
        "int": integers(),
        "real": reals(),
        "text": texts(),
        "cells": matrices_of(np.int16),
        "matrix": matrices_of(np.float64),
        "string": strings if strings is not None else st.just(EMPTY),
    }
    return by_kind[wanted.kind]


@cache
def vocabularies() -> SearchStrategy[Vocabulary]:
    """Vocabularies with a few symbols of each alphabet and a few event types."""
    return st.builds(
        _vocabulary,
        _entries("P", lambda name, fields: Primitive(name, None, **fields)),
        _entries("T", lambda name, fields: Transformation(name, None, **fields)),
        _entries("A", lambda name, fields: AgentKind(name, Fields.of(fields))),
        _entries("e", lambda name, fields: EventType(name, False, **fields)),
    )


def _vocabulary(*alphabets: list[Entry]) -> Vocabulary:
    return Vocabulary.of(*[symbol for alphabet in alphabets for symbol in alphabet])


_Entry = TypeVar("_Entry")


def _entries(
    letter: str, make: Callable[[str, dict[str, Any]], _Entry]
) -> SearchStrategy[list[_Entry]]:
    fields = st.dictionaries(names().filter(_is_free), _field(), max_size=3)
    return st.dictionaries(symbols(letter), fields, min_size=1, max_size=3).map(
        lambda drawn: [make(name, annotations) for name, annotations in drawn.items()]
    )


_ARGUMENTS: Final = frozenset(
    name for made in (Primitive, Transformation, EventType) for name in signature(made).parameters
)


def _is_free(name: str) -> bool:
    # Excludes names of other constructor arguments, and attributes of all events.
    return name not in _ARGUMENTS and not hasattr(Event, name)


@cache
def _field() -> SearchStrategy[Any]:
    wanted = types() | st.just(Type("string"))
    return wanted | wanted.flatmap(
        lambda kind: values_of(kind).map(lambda value: Default(kind, value))
    )


def strings_of(
    vocabulary: Vocabulary, depth: int = 1, max_leaves: int = 8
) -> SearchStrategy[Scene]:
    """Checked strings of one vocabulary."""
    # Strings within values are smaller, and nested to this depth only.
    inner = strings_of(vocabulary, depth - 1, 3) if depth else None

    def data(owner: str) -> SearchStrategy[dict[str, Value]]:
        fields = vocabulary.fields(owner).all
        return st.fixed_dictionaries({field.name: values_of(field.type, inner) for field in fields})

    def living(scopes: SearchStrategy[Scene]) -> SearchStrategy[Node]:
        return _one(
            vocabulary.kinds,
            lambda s: st.builds(agent_node, st.just(s), given_ids(), data(s), scopes),
        )

    def moved(scopes: SearchStrategy[Scene]) -> SearchStrategy[Node]:
        return _one(
            vocabulary.transformations,
            lambda s: st.builds(transformation_node, st.just(s), data(s), scopes),
        )

    figures = _one(vocabulary.primitives, lambda s: st.builds(figure_node, st.just(s), data(s)))
    strings = grown(figures, lambda scopes: living(scopes) | moved(scopes), max_leaves)
    # In canonical form, so that equal strings have equal nodes.
    return strings.map(vocabulary.check)


def _one(names: Iterable[str], make: Callable[[str], SearchStrategy[Node]]) -> SearchStrategy[Node]:
    each = [make(name) for name in names]
    return st.one_of(each) if each else st.nothing()


@cache
def worlds() -> SearchStrategy[tuple[Vocabulary, Scene]]:
    """A vocabulary with one of its strings."""
    # The string depends on the vocabulary that is drawn.
    return vocabularies().flatmap(lambda v: st.tuples(st.just(v), strings_of(v)))


def events_of(
    vocabulary: Vocabulary,
    agent_ids: Sequence[str] = (),
    conditions: Sequence[str] = ("",),
    types: Iterable[str] | None = None,
) -> SearchStrategy[Event]:
    """Events of a vocabulary, for all or some of the agents."""
    receivers: SearchStrategy[list[str]] = (
        st.lists(st.sampled_from(agent_ids), unique=True, max_size=2) if agent_ids else st.just([])
    )

    def of_type(name: str) -> SearchStrategy[Event]:
        declared = vocabulary.events[name]
        data = {field.name: values_of(field.type) for field in declared.fields.all}

        def event(data: dict[str, Any], receivers: list[str], condition: str) -> Event:
            return declared(receivers=receivers, condition=condition, **data)

        return st.builds(event, st.fixed_dictionaries(data), receivers, st.sampled_from(conditions))

    return st.sampled_from(sorted(vocabulary.events if types is None else types)).flatmap(of_type)


def family_strings() -> SearchStrategy[Scene]:
    """Strings of agents that change, die, give birth and turn into others; see `family`."""
    return strings_of(FAMILY_VOCABULARY, depth=0).map(_with_few_births)


def _with_few_births(scene: Scene) -> Scene:
    def leave(node: Node, scope: Scene) -> Node:
        if not isinstance(node, AgentNode) or "births" not in node.names:
            return rescoped(node, scope)
        # Any 64-bit integer may be drawn: few are below the 3 of `births < 3`, and the largest
        # cannot be incremented.
        state = {**node.state, "births": node.state["births"] % 4}
        return AgentNode(node.symbol, node.id, node.names, tuple(state.values()), scope)

    return rebuild(scene, leave)


def family_events(scene: Scene, visual: bool = False) -> SearchStrategy[list[Event]]:
    """Events of a frame for a string of the family, each once."""
    names = [
        event_type.name
        for event_type in FAMILY_VOCABULARY.events.values()
        if event_type.visual is visual
    ]
    present = [agent.id for agent in agents(scene)]
    # Always, for some kinds, for some states, and never.
    conditions = ("", "energy > 0", "x < 3 and energy >= 1", "nothing == 1")
    single = events_of(FAMILY_VOCABULARY, present, conditions, names)
    return st.lists(single, max_size=5, unique=True)
