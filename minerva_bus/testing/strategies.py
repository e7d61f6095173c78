"""Hypothesis strategies for the language: values, vocabularies, strings and events.

    from hypothesis import given
    from minerva_bus.testing.strategies import scenes, vocabularies

    @given(scenes())
    def test_my_codec(w):
        assert decode(encode(w)) == w

Values and strings may be any that the grammar allows, or those of a vocabulary. Hypothesis must be
installed (`pip install hypothesis`); nothing else in Minerva Bus needs it.
"""

from __future__ import annotations

import string
from collections.abc import Callable, Iterable, Sequence
from functools import cache, lru_cache
from inspect import signature
from itertools import count
from typing import Any, Final, TypeVar

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy
from numpy.typing import NDArray

from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Default, Fields
from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    Array,
    FigureNode,
    Node,
    Scene,
    TransformationNode,
    Value,
    rebuild,
    rescoped,
)
from minerva_bus.grammar.types import Quantity, Type
from minerva_bus.grammar.vocabulary import (
    AgentKind,
    Entry,
    EventType,
    Primitive,
    Transformation,
    Vocabulary,
)

# Hypothesis validates each strategy once, with its parts. A strategy that depends on what has been
# drawn costs less if its parts are the same objects each time, which `cache` gives.

LETTERS = string.ascii_letters + string.digits + "_"
UNITS = ("m", "km", "cm", "mm", "deg", "rad", "s", "m/s", "km/h", "Hz")


@cache
def names() -> SearchStrategy[str]:
    """Names of parameters, attributes and data."""
    return st.text(LETTERS, min_size=1, max_size=8).filter(lambda name: not name[0].isdigit())


@cache
def symbols(letter: str) -> SearchStrategy[str]:
    """Symbols of one alphabet: P, T, A, or e for event types."""
    return st.text(LETTERS, max_size=6).map(lambda rest: letter + rest)


@cache
def ids() -> SearchStrategy[str]:
    """Ids of agents."""
    first = st.sampled_from(LETTERS)
    # Any form that the grammar allows, including those of newborns (`a:3`) and copies (`a:7-2`).
    return st.builds(str.__add__, first, st.text(LETTERS + ":-", max_size=8))


@cache
def given_ids() -> SearchStrategy[str]:
    """Ids as written in world files; only those of newborns and copies contain : and -."""
    return st.text(LETTERS, min_size=1, max_size=6)


@cache
def integers() -> SearchStrategy[int]:
    """Whole numbers of 64 bits."""
    return st.integers(-(1 << 63), (1 << 63) - 1)


@cache
def reals() -> SearchStrategy[float]:
    """Finite numbers, including -0.0 and denormal ones."""
    return st.floats(allow_nan=False, allow_infinity=False)


@cache
def texts() -> SearchStrategy[str]:
    """Texts of Unicode characters, including quotes, backslashes and control characters."""
    # Surrogates cannot be encoded in UTF-8.
    return st.text(st.characters(exclude_categories=("Cs",)), max_size=12)


@cache
def matrices() -> SearchStrategy[Array]:
    """Read-only matrices of both types, also without rows or columns."""
    return st.one_of(matrices_of(np.int16), matrices_of(np.float64))


@cache
def matrices_of(dtype: type[np.int16] | type[np.float64]) -> SearchStrategy[Array]:
    """Read-only matrices of one type; few different values, so that equal ones repeat."""
    return _matrix(dtype)


@st.composite
def _matrix(draw: DrawFn, dtype: type[np.int16] | type[np.float64]) -> Array:
    rows, columns = draw(st.integers(0, 4)), draw(st.integers(0, 4))
    cells: SearchStrategy[Any] = st.integers(-32768, 32767) if dtype is np.int16 else reals()
    few = draw(st.lists(cells | st.sampled_from([0.0, -0.0]), min_size=1, max_size=3))
    drawn = draw(st.lists(st.sampled_from(few), min_size=rows * columns, max_size=rows * columns))
    matrix: NDArray[Any] = np.array(drawn, dtype).reshape(rows, columns)
    matrix.flags.writeable = False
    return matrix


@cache
def quantities() -> SearchStrategy[Quantity]:
    """Numbers with a unit, as in a text, before a vocabulary converts them."""
    return st.builds(Quantity, reals(), st.sampled_from(UNITS))


@cache
def values(depth: int = 2) -> SearchStrategy[Value]:
    """Any value that a text may hold, with lists and strings nested up to a depth."""
    plain: SearchStrategy[Any] = st.one_of(
        st.booleans(), integers(), reals(), texts(), matrices(), quantities()
    )
    if depth == 0:
        return plain
    inner = values(depth - 1)
    return st.one_of(plain, st.lists(inner, max_size=3).map(tuple), scenes(depth - 1, max_leaves=3))


@cache
def scenes(depth: int = 1, max_leaves: int = 12) -> SearchStrategy[Scene]:
    """Any string of L(M): arbitrary symbols, parameters and values, unique ids of agents."""
    bare: SearchStrategy[Any] = st.dictionaries(names(), values(depth), max_size=2)
    return grown(
        st.builds(figure_node, symbols("P"), bare),
        lambda scopes: st.one_of(
            st.builds(transformation_node, symbols("T"), bare, scopes),
            st.builds(agent_node, symbols("A"), ids(), bare, scopes),
        ),
        max_leaves,
    )


def grown(
    leaves: SearchStrategy[Node],
    extend: Callable[[SearchStrategy[Scene]], SearchStrategy[Node]],
    max_leaves: int,
) -> SearchStrategy[Scene]:
    """Strings of `leaves`, and of the results of `extend` for the strings drawn so far."""

    def concatenated(nodes: SearchStrategy[Node]) -> SearchStrategy[Scene]:
        return st.lists(nodes, max_size=4).map(lambda drawn: Scene(tuple(drawn)))

    grown = st.recursive(
        concatenated(leaves),
        lambda scopes: concatenated(leaves | extend(scopes)),
        max_leaves=max_leaves,
    )
    return grown.map(with_unique_ids)


def figure_node(symbol: str, data: dict[str, Value]) -> Node:
    """A figure with its parameters."""
    return FigureNode(symbol, tuple(data), tuple(data.values()))


def transformation_node(symbol: str, data: dict[str, Value], scope: Scene) -> Node:
    """A transformation around its scope."""
    return TransformationNode(symbol, tuple(data), tuple(data.values()), scope)


def agent_node(symbol: str, name: str, data: dict[str, Value], scope: Scene) -> Node:
    """An agent around its scope."""
    return AgentNode(symbol, name, tuple(data), tuple(data.values()), scope)


def with_unique_ids(scene: Scene) -> Scene:
    """The same string with new ids for the second and later agents that share an id."""
    taken: set[str] = set()

    def leave(node: Node, scope: Scene) -> Node:
        if not isinstance(node, AgentNode):
            return rescoped(node, scope)
        name = next(
            name for n in count(1) if (name := node.id if n == 1 else f"{node.id}_{n}") not in taken
        )
        taken.add(name)
        return AgentNode(node.symbol, name, node.names, node.values, scope)

    return rebuild(scene, leave)


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
