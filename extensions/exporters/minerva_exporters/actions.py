"""What agents did in a frame, as vectors: events that they received, or their attributes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from minerva_bus.collect.collector import agent_rows, event_rows
from minerva_bus.collect.data_tables import texts
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import AgentNode, Scene, walk
from minerva_bus.grammar.vocabulary import AgentKind, Vocabulary
from minerva_exporters.vectors import RowVectors, is_numeric, numbers_in


@dataclass(slots=True)
class Actions:
    """The actions of a kind of agents.

    `events` are the vectors of event types by name, `attributes` those of the kind's numeric
    attributes, and `strings` the numbers in attributes that are strings, by attribute.
    """

    kind: AgentKind
    events: Mapping[str, RowVectors]
    attributes: RowVectors
    strings: dict[str, list[str]] = field(default_factory=dict[str, list[str]])

    @staticmethod
    def of(act: Sequence[str], kind: AgentKind, vocabulary: Vocabulary) -> Actions:
        """The actions that a user named. Raises MisuseError."""
        _check(act, kind, vocabulary)
        fields = {each.name: each for each in kind.fields.all}
        numeric = tuple(fields[name] for name in act if name in fields and is_numeric(fields[name]))
        return Actions(
            kind,
            {
                name: RowVectors(tuple(filter(is_numeric, vocabulary.events[name].fields.all)))
                for name in act
                if name not in fields
            },
            RowVectors(numeric),
            {name: [] for name in act if name in fields and not is_numeric(fields[name])},
        )

    @property
    def names(self) -> list[str]:
        """A name for each number; an event without numbers has one, which is 1 if it occurs."""
        events = [
            f"{name}.{part}" if part else name
            for name, vectors in self.events.items()
            for part in vectors.names or [""]
        ]
        strings = [f"{name}.{part}" for name, parts in self.strings.items() for part in parts]
        return [*events, *self.attributes.names, *strings]

    def survey(self, scene: Scene) -> None:
        """Learn which numbers the strings in attributes have."""
        if self.strings:
            for node in _nodes(scene, self.kind.name):
                for name, parts in self.strings.items():
                    parts += [each for each in numbers_in(node.state[name]) if each not in parts]

    def of_frame(
        self, events: Iterable[AnyEvent], after: Scene, ids: Sequence[str], vocabulary: Vocabulary
    ) -> dict[str, NDArray[np.float32]]:
        """The actions of these agents by id; of several events of a type the last one counts.

        `after` is the string after the frame, which has the attributes. Without an event its
        numbers are 0.
        """
        width = len(self.names)
        made = {agent: np.zeros(width, np.float32) for agent in ids}
        at = 0
        for name, vectors in self.events.items():
            fields = vocabulary.events[name].fields
            rows = event_rows(events, name, fields)
            size = max(1, len(vectors.names))
            values = vectors.of_rows(rows) if vectors.names else np.ones((rows.count, 1), "f4")
            receivers: list[str] = texts(rows.receivers()).tolist()
            for vector, receiver in zip(values, receivers, strict=True):
                for agent in receiver.split() or ids:
                    if agent in made:
                        made[agent][at : at + size] = vector
            at += size
        self._add_attributes(made, at, after)
        return made

    def _add_attributes(
        self, made: Mapping[str, NDArray[np.float32]], at: int, after: Scene
    ) -> None:
        if self.attributes.fields:
            rows = agent_rows(after, self.kind.name, self.kind.fields)
            end = at + len(self.attributes.names)
            for agent, vector in zip(texts(rows.ids()), self.attributes.of_rows(rows), strict=True):
                if agent in made:
                    made[agent][at:end] = vector
            at = end
        if self.strings:
            for node in _nodes(after, self.kind.name):
                if node.id in made:
                    numbers = [
                        numbers_in(node.state[name]).get(part, 0.0)
                        for name, parts in self.strings.items()
                        for part in parts
                    ]
                    made[node.id][at:] = numbers


def _check(act: Sequence[str], kind: AgentKind, vocabulary: Vocabulary) -> None:
    """Raise MisuseError if there is no action, or one that has no numbers."""
    fields = {each.name: each for each in kind.fields.all}
    for name in act:
        if name not in fields and name not in vocabulary.events:
            near = nearest(name, [*fields, *sorted(kind.subscribes)])
            raise MisuseError(f"act: {kind.name} has no attribute and no event {name}{near}")
        if name in fields and not is_numeric(fields[name]) and fields[name].type.kind != "string":
            raise MisuseError(
                f"act: {kind.name}.{name} is a {fields[name].type}; expected a number, a word,"
                " a string of the grammar, or an event type"
            )
    if not act:
        events = ", ".join(sorted(kind.subscribes)) or "none"
        raise MisuseError(
            f"act: name what is an action of {kind.name}: event types that it receives"
            f" ({events}), or attributes; on the command line --act NAME"
        )


def _nodes(scene: Scene, kind: str) -> Iterable[AgentNode]:
    return (
        node
        for opens, node in walk(scene)
        if opens and isinstance(node, AgentNode) and node.symbol == kind
    )
