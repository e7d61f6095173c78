"""The check that the declarations of a vocabulary refer only to what it has."""

from __future__ import annotations

from typing import TYPE_CHECKING

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.symbols import AgentKind, EventType

if TYPE_CHECKING:
    from minerva_bus.grammar.vocabulary import Vocabulary


def check_declarations(vocabulary: Vocabulary) -> None:
    """Raise MisuseError if entries of a vocabulary do not agree.

    Its tables are complete, because entries refer to each other in any order.
    """
    for kind in vocabulary.kinds.values():
        _check_events_of(kind, vocabulary)
    for symbols in (vocabulary.primitives, vocabulary.transformations, vocabulary.kinds):
        for symbol in symbols.values():
            _check_unlimited(symbol.name, symbol.fields)
    for event_type in vocabulary.events.values():
        _check_sources_of(event_type, vocabulary)
        _check_orders_of(event_type, vocabulary)


def _check_events_of(kind: AgentKind, vocabulary: Vocabulary) -> None:
    for is_view, event_types in ((False, kind.subscribes), (True, kind.views)):
        for event_type in sorted(event_types):
            declared = vocabulary.events.get(event_type)
            if declared is None:
                known = nearest(event_type, list(vocabulary.events))
                raise MisuseError(
                    f"{kind.name} responds to the unknown event type {event_type}{known}"
                )
            if declared.visual != is_view:
                how = "visual: use @view" if declared.visual else "not visual: use @on"
                raise MisuseError(f"{kind.name} responds to {event_type}, which is {how}")


def _check_unlimited(owner: str, fields: Fields) -> None:
    for parameter in fields.all:
        if parameter.type.range is not None or parameter.type.source is not None:
            raise MisuseError(
                f"{owner}: {parameter.name} is a {parameter.type}; only data of event types have a"
                " range or a source"
            )


def _check_sources_of(event_type: EventType, vocabulary: Vocabulary) -> None:
    for parameter in event_type.fields.all:
        of = parameter.type.source
        if of is None:
            continue
        table = vocabulary.symbols(of.symbol[:1])
        names = table[of.symbol].fields.names if of.symbol in table else ()
        if of.parameter not in names:
            every = [f"{name}.{own}" for name in table for own in table[name].fields.names]
            raise MisuseError(
                f"{event_type.name}: {parameter.name} is a text of {of}, which the vocabulary"
                f" does not have{nearest(str(of), every)}"
            )


def _check_orders_of(event_type: EventType, vocabulary: Vocabulary) -> None:
    """Check the types of the orders that agents end with an event."""
    for order in (*event_type.completes, *event_type.fails, *event_type.replaces):
        if order not in vocabulary.events:
            raise MisuseError(
                f"{event_type.name} ends orders {order!r}, an event type that the"
                f" vocabulary does not have{nearest(order, list(vocabulary.events))}"
            )
