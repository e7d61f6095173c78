"""People's orders: which event types they may send here, and the events made of what they say."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.printer import value_text
from minerva_bus.grammar.symbols import EventType
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.services import WorldInfo

_ASKED = ("text", "real", "int", "bool")


def kinds_of_data(declared: EventType) -> tuple[str, ...]:
    """The kinds of an event type's data, such as ("text", "text")."""
    return tuple(one.type.kind for one in declared.fields.all)


def can_be_asked(declared: EventType) -> bool:
    """Whether a form has inputs for all of an event type's data."""
    return all(kind in _ASKED for kind in kinds_of_data(declared))


def first_with(vocabulary: Vocabulary, types: tuple[str, ...], kind: str) -> str:
    """The first of the event types whose only datum is of a kind; "" for none."""
    found = (one for one in types if one in vocabulary.events)
    return next((one for one in found if kinds_of_data(vocabulary.events[one]) == (kind,)), "")


def title(field: Field) -> str:
    """A field's name with its unit."""
    return f"{field.name} ({field.type.unit})" if field.type.unit else field.name


class Orders:
    """Sends orders into a world, to one agent or to all that subscribe to them."""

    def __init__(self, world: WorldInfo) -> None:
        self._operator = world.operator
        self._vocabulary = world.vocabulary

    def send(self, event_type: str, data: Mapping[str, Any], agent: str, kind: str) -> str:
        """Send an order to an agent of a kind, or with "" to all; what was done, in a line.

        Raises MisuseError where such an agent does not listen, and what the operator raises.
        """
        if agent and not self.listens(kind, event_type):
            raise MisuseError(f"{agent} takes no {event_type}; select another agent, or all")
        declared = self._vocabulary.events[event_type]
        self._operator.order(declared(**data, receivers=[agent] if agent else []))
        said = ", ".join(f"{name}={_short(value)}" for name, value in data.items())
        return f"{event_type}({said}) sent to {agent or 'all'}"

    def listens(self, kind: str, event_type: str) -> bool:
        """Whether agents of a kind subscribe to an event type."""
        known = self._vocabulary.kinds.get(kind)
        return known is not None and event_type in known.subscribes


def _short(value: Any) -> str:
    return value if isinstance(value, str) else value_text(value)
