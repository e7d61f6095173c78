"""Observations: agents as numbers, for policies. A further geometry, φ into numbers.

| `observe`                  | observation of an agent                                      |
|----------------------------|--------------------------------------------------------------|
| names of attributes        | a vector: numbers, bools as 0 and 1, words one-hot, lists    |
| the name of a matrix       | that matrix; with other names, a `Dict`                      |
| a visual event type        | a vector: the parameters of its own view, in their order     |
| a function (string, agent) | what it returns, as an array                                 |

An observation depends only on the string and the frame's number, so it is the same in any process.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Protocol, TypeAlias, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.scene import AgentNode, FigureNode, Scene, TransformationNode, scene_of
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import AgentKind, EventType
from minerva_bus.semantics.geometry import Geometry, interpret
from minerva_learning.acting import AnySpace
from minerva_learning.states import KindStates

Observe: TypeAlias = "str | EventType | Sequence[Any] | Callable[[Scene, AgentNode], Any] | None"
Observations: TypeAlias = dict[str, Any]

MATRICES = {"cells": np.int16, "matrix": np.float64}
NUMBERS = ("real", "int", "bool")


class Observing(Protocol):
    """Makes observations of agents; `space` has them."""

    @property
    def space(self) -> AnySpace: ...

    def observations(self, states: KindStates) -> Observations:
        """The observation of each agent, by id. Raises MisuseError."""
        ...


def observing_of(
    observe: Observe,
    states: KindStates,
    view: Callable[[Scene, str], Scene],
) -> Observing:
    """The observations of a kind of agents; `states` are those of the initial string.

    `view` returns the view of a string for a visual event type. Raises MisuseError.
    """
    kind = states.kind
    name = observe.name if isinstance(observe, EventType) else observe
    if isinstance(name, str) and name in kind.views:
        event_type = name
        return FunctionObserving(
            lambda _, agent: _numbers_of(view(scene_of(agent), event_type)), states
        )
    if callable(name):
        return FunctionObserving(name, states)
    if name is None:
        names = [field.name for field in kind.fields.all if _is_scalar(field.type)]
    else:
        names = [name] if isinstance(name, str) else [_attribute(each) for each in name]
    types = {each: _type_of(each, kind) for each in names}
    if not types:
        raise MisuseError(
            f"observe: {kind.name} has no numbers; name attributes, or give a function"
        )
    if any(type_.kind in MATRICES for type_ in types.values()):
        return MatrixObserving(types, states)
    return VectorObserving(types, states)


def rows_of(observing: Observing, states: KindStates) -> NDArray[Any]:
    """The observations of all agents as one array, a row for each, in the order of `states.ids`."""
    if isinstance(observing, VectorObserving):
        return observing.rows(states)
    seen = observing.observations(states)
    return np.array([seen[agent] for agent in states.ids], observing.space.dtype)


def _attribute(given: Any) -> str:
    """The name of an attribute; `Rabbit.x` in Python is an expression."""
    return given if isinstance(given, str) else str(getattr(given, "name", given))


def _is_scalar(type_: Type) -> bool:
    return type_.kind in NUMBERS or bool(type_.words)


def _type_of(name: str, kind: AgentKind) -> Type:
    types = {field.name: field.type for field in kind.fields.all}
    if name not in types:
        near = nearest(name, [*types, *sorted(kind.views)])
        raise MisuseError(f"observe: {kind.name} has no attribute and no view {name}{near}")
    type_ = types[name]
    inner = type_.item if type_.item is not None else type_
    if type_.kind not in MATRICES and not _is_scalar(inner):
        raise MisuseError(
            f"observe: {kind.name}.{name} is a {type_}; expected numbers, bools, Literal words,"
            " lists of them, or a matrix"
        )
    return type_


class VectorObserving:
    """Attributes as one vector of float64, made from columns."""

    def __init__(self, types: Mapping[str, Type], states: KindStates) -> None:
        self._types = types
        self._widths = {name: _width(name, types[name], states) for name in types}
        limits = np.concatenate([_limits(types[name], self._widths[name]) for name in types], 1)
        self.space: AnySpace = spaces.Box(limits[0], limits[1], dtype=np.float64)

    def observations(self, states: KindStates) -> Observations:
        """The vector of each agent."""
        return dict(zip(states.ids, self.rows(states), strict=True))

    def rows(self, states: KindStates) -> NDArray[np.float64]:
        """The vectors of all agents, shape (n, width)."""
        # Of no agents, the attributes that are read from nodes have no block.
        if not states.ids:
            return np.empty((0, *(self.space.shape or ())))
        blocks = [self._block(name, type_, states) for name, type_ in self._types.items()]
        return np.concatenate(blocks, axis=1)

    def _block(self, name: str, type_: Type, states: KindStates) -> NDArray[np.float64]:
        """An attribute of all agents, shape (n, width)."""
        if type_.words:
            return _one_hot(states.column(name), type_.words)
        if type_.item is None:
            return states.column(name).astype(np.float64)[:, None]
        block = np.empty((len(states.ids), self._widths[name]))
        for at, agent in enumerate(states.ids):
            values = _flat(states.nodes[agent].state[name], type_.item)
            if len(values) != block.shape[1]:
                raise MisuseError(
                    f"observe: {name} of {agent} has {len(values)} numbers, not {block.shape[1]}"
                    " as in the initial string; observe a function that returns an array of one"
                    " size"
                )
            block[at] = values
        return block


def _width(name: str, type_: Type, states: KindStates) -> int:
    if type_.item is None:
        return len(type_.words) or 1
    states.check_some()
    return len(_flat(states.nodes[states.ids[0]].state[name], type_.item))


def _flat(values: Sequence[Any], item: Type) -> NDArray[np.float64]:
    if item.words:
        return _one_hot(np.array(values, object), item.words).reshape(-1)
    return np.array(values, np.float64)


def _one_hot(column: NDArray[Any], words: Sequence[str]) -> NDArray[np.float64]:
    return np.stack([column == word for word in words], axis=1).astype(np.float64)


def _limits(type_: Type, width: int) -> NDArray[np.float64]:
    """The least and the greatest value of an attribute, shape (2, width)."""
    inner = type_.item or type_
    low, high = (0.0, 1.0) if inner.words or inner.kind == "bool" else (-np.inf, np.inf)
    return np.repeat([[low], [high]], width, axis=1)


class MatrixObserving:
    """A matrix, or matrices and other attributes as a dictionary."""

    def __init__(self, types: Mapping[str, Type], states: KindStates) -> None:
        states.check_some()
        first = states.nodes[states.ids[0]].state
        own = {name: type_ for name, type_ in types.items() if type_.kind in MATRICES}
        self._vectors = {
            name: VectorObserving({name: type_}, states)
            for name, type_ in types.items()
            if name not in own
        }
        self._matrices = {name: _matrix_space(first[name], type_) for name, type_ in own.items()}
        self._alone = "" if len(types) > 1 else next(iter(own))
        parts = {name: self._space(name) for name in types}
        # A space with the names in another order is another space.
        self.space: AnySpace = parts[self._alone] if self._alone else spaces.Dict(parts)  # pyright: ignore[reportArgumentType]

    def _space(self, name: str) -> AnySpace:
        return self._matrices[name] if name in self._matrices else self._vectors[name].space

    def observations(self, states: KindStates) -> Observations:
        """The matrices of each agent."""
        vectors = {name: part.observations(states) for name, part in self._vectors.items()}
        made: Observations = {}
        for agent, node in states.nodes.items():
            # Copies, because matrices of a string are read-only and shared.
            parts = {name: np.array(node.state[name]) for name in self._matrices}
            for name, matrix in parts.items():
                _check_shape(agent, matrix, self._matrices[name])
            if self._alone:
                made[agent] = parts[self._alone]
            else:
                made[agent] = parts | {name: rows[agent] for name, rows in vectors.items()}
        return made


def _matrix_space(matrix: NDArray[Any], type_: Type) -> AnySpace:
    dtype = MATRICES[type_.kind]
    if type_.kind == "matrix":
        return spaces.Box(-np.inf, np.inf, matrix.shape, dtype)
    bounds = np.iinfo(np.int16)
    return spaces.Box(bounds.min, bounds.max, matrix.shape, dtype)


class FunctionObserving:
    """What a function of the string and the agent returns, as an array of one shape."""

    def __init__(self, function: Callable[[Scene, AgentNode], Any], states: KindStates) -> None:
        states.check_some()
        self._function = function
        first = self._array(states, states.ids[0])
        self.space: AnySpace = spaces.Box(-np.inf, np.inf, first.shape, np.float64)

    def observations(self, states: KindStates) -> Observations:
        """The array of each agent."""
        made = {agent: self._array(states, agent) for agent in states.ids}
        for agent, array in made.items():
            _check_shape(agent, array, self.space)
        return made

    def _array(self, states: KindStates, agent: str) -> NDArray[np.float64]:
        value = self._function(states.scene, states.nodes[agent])
        try:
            return np.array(value, np.float64)
        except (TypeError, ValueError):
            raise MisuseError(
                f"observe: the observation of {agent} is {value!r:.60}; expected numbers"
            ) from None


def _check_shape(agent: str, array: NDArray[Any], space: AnySpace) -> None:
    if array.shape != space.shape:
        raise MisuseError(
            f"observe: the observation of {agent} has the shape {array.shape}, not {space.shape} as"
            " in the initial string"
        )


class _Parameters(Geometry):
    """A geometry of numbers: all parameters of a string, in its order, without texts."""

    def __init__(self) -> None:
        self.numbers: list[float] = []

    def other_figure(self, figure: FigureNode) -> None:
        self._add(figure.values)

    def other_transformation(
        self, transformation: TransformationNode
    ) -> AbstractContextManager[Any]:
        self._add(transformation.values)
        return nullcontext()

    def _add(self, values: Sequence[Any]) -> None:
        for value in values:
            if isinstance(value, tuple):
                self._add(cast("tuple[Any, ...]", value))
            elif isinstance(value, np.ndarray):
                self.numbers += cast("NDArray[Any]", value).reshape(-1).tolist()
            elif isinstance(value, bool | int | float):
                self.numbers.append(float(value))


def _numbers_of(view: Scene) -> list[float]:
    """φ of a view in the geometry of numbers."""
    parameters = _Parameters()
    interpret(view, parameters)
    return parameters.numbers
