"""Events of people for a running world: they are checked, sent, and their fates kept."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from minerva_bus.errors import ProtocolError, SceneError, nearest
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.orders import listed, refusal_of_order, unknown_value
from minerva_bus.grammar.batch import Events
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import agents
from minerva_bus.runtime.operated import Operated, person_of
from minerva_bus.wire.plain import as_list, as_map, as_text
from minerva_bus.wire.values import Reader


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
    takers = [member.name for member in algorithm.members.takers(batch.type)]
    types = algorithm.world.vocabulary.events[batch.type].fields.all
    # Generators take single orders, and values that the string has are compared one by one.
    if takers or any(field.type.source is not None for field in types):
        for event in batch:
            _send(running, event, person)
    else:
        refusal = refusal_of_order(algorithm, batch.type)
        if refusal:
            raise ProtocolError(refusal)
        missing = algorithm.composition.first_missing(batch.receivers)
        if missing is not None:
            raise ProtocolError(_no_agent(running, missing))
        running.runner.handle(s.Publish(batch, person))
    frame, sent = algorithm.frame, f"{batch.count} {batch.type}"
    return {"frame": frame, "event": sent, "through": takers, "by": person}


def _no_agent(running: Operated, receiver: str) -> str:
    known = sorted(node.id for node in agents(running.algorithm.scene))
    hint = nearest(receiver, known) or f"; there are {listed(known)}"
    return f"there is no agent #{receiver[:64]}{hint}"


def _send(running: Operated, event: Event, person: str) -> dict[str, Any]:
    algorithm = running.algorithm
    for receiver in event.receivers:
        # Not `agent`, which makes the node of an agent in columns.
        if algorithm.composition.home(receiver) is None:
            raise ProtocolError(_no_agent(running, receiver))
    refusal = refusal_of_order(algorithm, event.type)
    refusal = refusal or unknown_value(algorithm, event)
    if refusal:
        raise ProtocolError(refusal)
    takers = [member.name for member in algorithm.members.takers(event.type)]
    number = running.orders.arrive(event, person, algorithm.frame)
    running.runner.handle(s.Publish(event, person))
    return {
        "frame": algorithm.frame,
        "event": str(event),
        "through": takers,
        "by": person,
        "number": number,
    }


def publish(running: Operated, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Send an event of a type in the vocabulary; its data are texts in the notation of strings."""
    algorithm = running.algorithm
    name = as_text(asked.get("type"), "the type")
    values = {
        field: _value(as_text(value, field), field)
        for field, value in as_map(asked.get("data", {}), "the data").items()
    }
    receivers = [
        as_text(name, "a receiver") for name in as_list(asked.get("receivers", []), "receivers")
    ]
    vocabulary = algorithm.world.vocabulary
    declared = vocabulary.events.get(name)
    if declared is None:
        raise ProtocolError(
            f"the world has no event type {name}; it has {', '.join(vocabulary.events)}"
        )
    condition = as_text(asked.get("condition", ""), "if")
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
