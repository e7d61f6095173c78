"""Orders of users: which event types can be sent, and their construction from form data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.printer import value_text
from minerva_bus.grammar.symbols import EventType
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.operator import Operator

_INPUT_KINDS = ("text", "real", "int", "bool")


def kinds_of_data(declared: EventType) -> tuple[str, ...]:
    """The kinds of an event type's data, such as ("text", "text")."""
    return tuple(field.type.kind for field in declared.fields.all)


def can_be_asked(declared: EventType) -> bool:
    """True if a form has inputs for all data of an event type."""
    return all(kind in _INPUT_KINDS for kind in kinds_of_data(declared))


def first_with(vocabulary: Vocabulary, types: tuple[str, ...], kind: str) -> str:
    """The first of the event types whose only datum is of this kind; "" for none."""
    known = (name for name in types if name in vocabulary.events)
    return next((name for name in known if kinds_of_data(vocabulary.events[name]) == (kind,)), "")


def title(field: Field) -> str:
    """A field's name with its unit."""
    return f"{field.name} ({field.type.unit})" if field.type.unit else field.name


class OrderSender:
    """Sends orders of a person to one agent or to all subscribers."""

    def __init__(self, vocabulary: Vocabulary, operator: Operator) -> None:
        self.vocabulary = vocabulary
        self._operator = operator

    def send(self, event_type: str, data: Mapping[str, Any], agent: str, kind: str) -> str:
        """Send an order to an agent of a kind, or with "" to all; returns a confirmation line.

        Raises MisuseError if the agent does not subscribe to it, and errors of the operator.
        """
        if agent and not self.accepts(kind, event_type):
            raise MisuseError(f"{agent} does not accept {event_type}; select another agent, or all")
        declared = self.vocabulary.events[event_type]
        self._operator.order(declared(**data, receivers=[agent] if agent else []))
        shown = ", ".join(f"{name}={_short(value)}" for name, value in data.items())
        return f"{event_type}({shown}) sent to {agent or 'all'}"

    def accepts(self, kind: str, event_type: str) -> bool:
        """True if agents of a kind subscribe to an event type."""
        known = self.vocabulary.kinds.get(kind)
        return known is not None and event_type in known.subscribes


def _short(value: Any) -> str:
    return value if isinstance(value, str) else value_text(value)
