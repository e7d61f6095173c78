"""Events of people for a running world: they are checked, sent, and their fates kept."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection import MAX_NAMES, unknown_agent
from minerva_bus.frame.orders import (
    listed,
    refusal_of_order,
    too_much_work,
    unknown_value,
    without_effect,
)
from minerva_bus.frame.work import MAX_SINGLE_EVENTS
from minerva_bus.grammar.conversion import Unfit
from minerva_bus.grammar.events import Event, Events
from minerva_bus.grammar.measures import Of
from minerva_bus.grammar.parser import parse
from minerva_bus.runtime.operated import Operated, person_of
from minerva_bus.wire.message_limits import DEFAULT, check
from minerva_bus.wire.plain import as_list, as_map, as_text
from minerva_bus.wire.strings_codec import Reader

MAX_CHARS: Final = 16_384
"""Characters of the data and the condition of an event, which the main thread parses."""


def order(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Send an event, or a batch, of people, in the form of the wire."""
    reader = Reader(running.algorithm.world.vocabulary)
    event = reader.event(asked.get("event"))
    # Agents trust the sender of an event, so an operator must not set one.
    if event.senders is not None if isinstance(event, Events) else event.sender:
        raise ProtocolError("an order is an event or a batch of people: it has no sender")
    if isinstance(event, Events):
        return _send_batch(running, event, person_of(asked))
    return _send(running, event, person_of(asked))


def _send_batch(running: Operated, batch: Events, person: str) -> dict[str, Any]:
    """Send the events of a batch; their fates are not kept."""
    algorithm = running.algorithm
    takers = algorithm.members.takers(batch.type)
    types = algorithm.world.vocabulary.events[batch.type].fields.all
    # Generators take single orders, and values that the string has are compared one by one.
    if takers or any(field.type.source is not None for field in types):
        advice = "send events in columns of a type that no generator takes, or fewer at once"
        check(f"an order of {batch.type}", batch.count, MAX_SINGLE_EVENTS, "events", advice)
        known = dict[Of, set[str]]()
        for event in batch:
            _send(running, event, person, known)
    else:
        refusal = refusal_of_order(algorithm, batch.type)
        if refusal:
            raise ProtocolError(refusal)
        missing = algorithm.composition.first_missing(batch.receivers)
        if missing is not None:
            raise ProtocolError(_no_agent(running, missing))
        refusal = too_much_work(algorithm, batch, person)
        if refusal:
            raise ProtocolError(refusal)
        running.runner.handle(s.Publish(batch, person))
    frame, sent = algorithm.frame, f"{batch.count} {batch.type}"
    return {"frame": frame, "event": sent, "through": takers, "by": person}


def _no_agent(running: Operated, receiver: str) -> str:
    composition = running.algorithm.composition
    few = composition.count <= MAX_NAMES
    several = listed(sorted(composition.agents())) if few else f"{composition.count} agents"
    return f"there is no agent {unknown_agent(composition, receiver, f'there are {several}')}"


def _send(
    running: Operated, event: Event, person: str, known: dict[Of, set[str]] | None = None
) -> dict[str, Any]:
    algorithm = running.algorithm
    check(f"an order of {event.type}", len(event.receivers), DEFAULT.receivers, "receivers")
    # Not `agent`, which makes the node of an agent in columns.
    homes = algorithm.composition.home_of_each(event.receivers)
    for receiver in event.receivers:
        if receiver not in homes:
            raise ProtocolError(_no_agent(running, receiver))
    refusal = refusal_of_order(algorithm, event.type)
    refusal = refusal or unknown_value(algorithm, event, known)
    refusal = refusal or too_much_work(algorithm, event, person)
    if refusal:
        raise ProtocolError(refusal)
    takers = algorithm.members.takers(event.type)
    note = without_effect(algorithm, event)
    number = running.orders.arrive(event, person, algorithm.frame)
    running.runner.handle(s.Publish(event, person))
    return {
        "frame": algorithm.frame,
        "event": str(event),
        "through": takers,
        "by": person,
        "number": number,
        **({"note": note} if note else {}),
    }


def publish(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Send an event of a type in the vocabulary; its data are texts in the notation of strings."""
    algorithm = running.algorithm
    name = as_text(asked.get("type"), "the type")
    texts = {
        field: as_text(value, field)
        for field, value in as_map(asked.get("data", {}), "the data").items()
    }
    condition = as_text(asked.get("condition", ""), "if")
    size, advice = sum(map(len, [condition, *texts.values()])), "send it by the Python API"
    check("the data of an event", size, MAX_CHARS, "characters", advice)
    values = {field: _value(text, field) for field, text in texts.items()}
    receivers = [
        as_text(name, "a receiver") for name in as_list(asked.get("receivers", []), "receivers")
    ]
    vocabulary = algorithm.world.vocabulary
    declared = vocabulary.events.get(name)
    if declared is None:
        raise ProtocolError(
            f"the world has no event type {name}; it has {', '.join(vocabulary.events)}"
        )
    # A condition that no agent can fulfil is an error of the operator.
    vocabulary.check_condition(name, condition, "pub")
    try:
        fitted = declared.fields.values(name, values)
    except Unfit as unfit:
        raise ProtocolError(str(unfit)) from None
    to = tuple(sorted(set(receivers)))
    event = Event(name, declared.fields.names, fitted, condition, receivers=to)
    return _send(running, event, person_of(asked))


def _value(shown: str, name: str) -> Any:
    """A value in the notation of strings; quotes around a text are optional."""
    try:
        (node,) = parse(f"P<value={shown}>", name)
        (value,) = node.values
    except (SceneError, ValueError):
        return shown
    return value
