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
from minerva_learning.shared import Batch
from minerva_learning.states import KindStates

Observe: TypeAlias = "str | EventType | Sequence[Any] | Callable[[Scene, AgentNode], Any] | None"

_WORD = np.iinfo(np.int16)
MATRICES = {"cells": (np.int16, _WORD.min, _WORD.max), "matrix": (np.float64, -np.inf, np.inf)}
"""Type, least and greatest element of a matrix."""
NUMBERS = ("real", "int", "bool")


class Observing(Protocol):
    """Makes observations of agents; `space` has those of each."""

    @property
    def space(self) -> AnySpace: ...

    def rows(self, states: KindStates) -> Batch:
        """The observations of all agents, a row for each, in the order of `states.ids`.

        Raises MisuseError.
        """
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
    if not any(type_.kind in MATRICES for type_ in types.values()):
        return VectorObserving(types, states)
    if len(types) > 1:
        return DictObserving(types, states)
    ((only, type_),) = types.items()
    return MatrixObserving(only, type_, states)


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
        self._columns: list[tuple[str, Type, slice]] = []
        limits: list[tuple[float, float]] = []
        for name, type_ in types.items():
            begin, inner = len(limits), type_.item or type_
            limit = (0.0, 1.0) if inner.words or inner.kind == "bool" else (-np.inf, np.inf)
            limits += [limit] * _width(name, type_, states)
            self._columns.append((name, type_, slice(begin, len(limits))))
        self._words = {name: np.array(type_.words) for name, type_ in types.items() if type_.words}
        low, high = np.array(limits).reshape(-1, 2).T
        self.space: AnySpace = spaces.Box(low, high, dtype=np.float64)

    def rows(self, states: KindStates) -> NDArray[np.float64]:
        """The vectors of all agents, shape (n, width)."""
        rows = np.empty((len(states.ids), *(self.space.shape or ())))
        for name, type_, at in self._columns:
            if type_.item is None:
                column = states.column(name)
                if type_.words:
                    rows[:, at] = column[:, None] == self._words[name]
                else:
                    rows[:, at.start] = column
                continue
            for row, values in enumerate(states.values(name)):
                flat = _flat(values, type_.item)
                if len(flat) != at.stop - at.start:
                    raise MisuseError(
                        f"observe: {name} of {states.ids[row]} has {len(flat)} numbers, not"
                        f" {at.stop - at.start} as in the initial string; observe a function that"
                        " returns an array of one size"
                    )
                rows[row, at] = flat
        return rows


def _width(name: str, type_: Type, states: KindStates) -> int:
    if type_.item is None:
        return len(type_.words) or 1
    states.check_some()
    return len(_flat(states.values(name)[0], type_.item))


def _flat(values: Sequence[Any], item: Type) -> NDArray[np.float64]:
    if item.words:
        values = [value == word for value in values for word in item.words]
    return np.array(values, np.float64)


class MatrixObserving:
    """A matrix of each agent."""

    def __init__(self, name: str, type_: Type, states: KindStates) -> None:
        states.check_some()
        self._name = name
        dtype, low, high = MATRICES[type_.kind]
        self.space: AnySpace = spaces.Box(low, high, states.values(name)[0].shape, dtype)

    def rows(self, states: KindStates) -> NDArray[Any]:
        """The matrices of all agents."""
        return _stacked(states.values(self._name), states, self.space)


class DictObserving:
    """Matrices and other attributes as a dictionary."""

    def __init__(self, types: Mapping[str, Type], states: KindStates) -> None:
        self._parts: dict[str, Observing] = {
            name: MatrixObserving(name, type_, states)
            if type_.kind in MATRICES
            else VectorObserving({name: type_}, states)
            for name, type_ in types.items()
        }
        self.space: AnySpace = spaces.Dict(
            {name: part.space for name, part in self._parts.items()}  # pyright: ignore[reportArgumentType]
        )

    def rows(self, states: KindStates) -> dict[str, Any]:
        """The attributes of all agents, by name."""
        return {name: part.rows(states) for name, part in self._parts.items()}


class FunctionObserving:
    """What a function of the string and the agent returns, as an array of one shape."""

    def __init__(self, function: Callable[[Scene, AgentNode], Any], states: KindStates) -> None:
        states.check_some()
        self._function = function
        shape = self._array(states, states.ids[0]).shape
        self.space: AnySpace = spaces.Box(-np.inf, np.inf, shape, np.float64)

    def rows(self, states: KindStates) -> NDArray[np.float64]:
        """The arrays of all agents."""
        made = [self._array(states, agent) for agent in states.ids]
        return _stacked(made, states, self.space)

    def _array(self, states: KindStates, agent: str) -> NDArray[np.float64]:
        value = self._function(states.scene, states.nodes[agent])
        try:
            return np.array(value, np.float64)
        except (TypeError, ValueError):
            raise MisuseError(
                f"observe: the observation of {agent} is {value!r:.60}; expected numbers"
            ) from None


def _stacked(arrays: Sequence[NDArray[Any]], states: KindStates, space: AnySpace) -> NDArray[Any]:
    """A copy of an array of each agent, as matrices of a string are read-only and shared."""
    rows = np.empty((len(arrays), *(space.shape or ())), space.dtype)
    for row, array in enumerate(arrays):
        if array.shape != space.shape:
            raise MisuseError(
                f"observe: the observation of {states.ids[row]} has the shape {array.shape}, not"
                f" {space.shape} as in the initial string"
            )
        rows[row] = array
    return rows


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
