"""Agents of a string and events of a frame as columns, without an object for each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import AgentNode, FigureNode, Scene, TransformationNode

Data: TypeAlias = NDArray[Any] | Ids

DTYPES: Final[Mapping[str, Any]] = {
    "real": np.float64,
    "int": np.int64,
    "bool": np.bool_,
    "text": object,
}
"""The array types of columns, by the kind of an attribute's type."""


class Rows:
    """Columns of `count` agents or events, created on demand."""

    def __init__(self, fields: Fields, parts: Sequence[Columns | Events | list[Any]]) -> None:
        self._fields = fields
        self._parts = parts
        self.count = sum(map(len_of, parts))

    def column(self, name: str) -> NDArray[Any]:
        """The values of an attribute or datum, shape (count,)."""
        at = self._fields.names.index(name)
        dtype = DTYPES[self._fields.all[at].type.kind]
        return _joined([_values(part, name, at, dtype) for part in self._parts], dtype)

    def ids(self) -> Data:
        """The ids of agents."""
        return _texts([_ids(part) for part in self._parts])

    def senders(self) -> Data:
        """The senders of events; "" for those of generators."""
        return _texts([_senders(part) for part in self._parts])

    def receivers(self) -> Data:
        """The receivers of events, separated by blanks; "": all that subscribe."""
        return _texts([_receivers(part) for part in self._parts])


def len_of(part: Columns | Events | list[Any]) -> int:
    """The number of rows of a part."""
    return len(part) if isinstance(part, list) else part.count


def agent_rows(scene: Scene, kind: str, fields: Fields) -> Rows:
    """The agents of a kind in a string, including those within others, in its order."""
    parts: list[Columns | Events | list[Any]] = []
    _gather(scene, kind, parts)
    return Rows(fields, parts)


def _gather(scene: Scene, kind: str, parts: list[Columns | Events | list[Any]]) -> None:
    # Strings may be nested as deep as memory goes, so this does not recurse.
    stack = list(reversed(scene.pieces))
    while stack:
        piece = stack.pop()
        if isinstance(piece, Columns):
            if piece.ids is not None and piece.symbol == kind:
                parts.append(piece)
            continue
        # These contain no agents.
        if isinstance(piece, FigureNode) or (isinstance(piece, TransformationNode) and piece.still):
            continue
        if isinstance(piece, AgentNode) and piece.symbol == kind:
            # Neighbouring nodes form one part, so that columns and nodes stay in their order.
            if parts and isinstance(parts[-1], list):
                parts[-1].append(piece)
            else:
                parts.append([piece])
        if piece.scope.pieces:
            stack += reversed(piece.scope.pieces)


def event_rows(events: Iterable[AnyEvent], event_type: str, fields: Fields) -> Rows:
    """The events of a type, in their order."""
    parts: list[Columns | Events | list[Any]] = []
    for event in events:
        if event.type != event_type:
            continue
        if isinstance(event, Events):
            parts.append(event)
        elif parts and isinstance(parts[-1], list):
            parts[-1].append(event)
        else:
            parts.append([event])
    return Rows(fields, parts)


def _values(part: Columns | Events | list[Any], name: str, at: int, dtype: Any) -> NDArray[Any]:
    if isinstance(part, Columns):
        return part.column(name)
    if isinstance(part, Events):
        return part.data(name)
    nodes: list[AgentNode | Event] = part
    return _array([node.values[at] for node in nodes], dtype)


def _ids(part: Columns | Events | list[Any]) -> Ids | list[str]:
    if isinstance(part, Columns) and part.ids is not None:
        return part.ids
    nodes: list[AgentNode] = part if isinstance(part, list) else []
    return [node.id for node in nodes]


def _senders(part: Columns | Events | list[Any]) -> Ids | list[str]:
    if isinstance(part, Events):
        return [""] * part.count if part.senders is None else part.senders
    events: list[Event] = part if isinstance(part, list) else []
    return [event.sender for event in events]


def _receivers(part: Columns | Events | list[Any]) -> Ids | list[str]:
    if isinstance(part, Events):
        return [""] * part.count if part.receivers is None else part.receivers
    events: list[Event] = part if isinstance(part, list) else []
    return [" ".join(event.receivers) for event in events]


def _texts(parts: Sequence[Ids | list[str]]) -> Data:
    if len(parts) == 1 and isinstance(parts[0], Ids):
        # Ids are spelled only if a writer needs texts.
        return parts[0]
    texts = [text for part in parts for text in part]
    return _array(texts, object)


def _array(values: Sequence[Any], dtype: Any) -> NDArray[Any]:
    if dtype is not object:
        return np.array(values, dtype)
    made = np.empty(len(values), object)
    made[:] = values
    return made


def _joined(arrays: Sequence[NDArray[Any]], dtype: Any) -> NDArray[Any]:
    if len(arrays) == 1:
        return arrays[0]
    return np.concatenate([np.empty(0, dtype), *arrays]) if arrays else np.empty(0, dtype)
