"""Orders: the events that people may send; those of sensors, clocks and norms are reserved."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, cast

from minerva_bus.errors import nearest
from minerva_bus.frame.messages import Hello
from minerva_bus.frame.phases import Phase
from minerva_bus.grammar.columns import values_of
from minerva_bus.grammar.events import AnyEvent, Event
from minerva_bus.grammar.measures import Of

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm

_MAX_LISTED = 12


def refusal_of_order(world: FrameAlgorithm, event_type: str) -> str:
    """Reason for rejecting people's events of a type, or an empty string.

    They may send event types that a generator takes as orders, that the world file lists, or that
    neither a generator makes nor a norm sends. All other events are measured or computed; sent from
    a terminal they would be false statements about the world.
    """
    reserved, members = _reservation(world, event_type), world.members
    if reserved:
        return f'{reserved}, or give it a process with service = "orders"'
    unknown = [member.name for member in members if member.expected and member.hello is None]
    allowed = event_type in world.world.people or members.takers(event_type)
    # A generator that joins later may make events of this type by itself.
    if unknown and not allowed and world.phase is Phase.WAITING:
        return (
            f"whether people may send {event_type} depends on members that have not joined yet:"
            f" {', '.join(unknown[:5])}; send it when the world runs"
        )
    return ""


def refusal_of_guest(world: FrameAlgorithm, hello: Hello, event_types: Iterable[str]) -> str:
    """Reason for rejecting these event types of an attached generator, or an empty string.

    One that stands for people, such as a keyboard, may send what people may send; another may be a
    sensor, but no norm. A process of the world file is the choice of this file.
    """
    if world.members.is_process(hello.member):
        return ""
    reserves = _reservation if hello.people else _reservation_by_norms
    reasons = (reserves(world, event_type) for event_type in dict.fromkeys(event_types))
    reserved = next(filter(None, reasons), "")
    return reserved and f"{reserved}, or make {hello.member} a process of it"


def _reservation(world: FrameAlgorithm, event_type: str) -> str:
    """Why an event type is not for people, and how to allow it; or an empty string."""
    members = world.members
    # An attached generator that takes orders cannot allow what the world file does not.
    if event_type in world.world.people or any(map(members.is_process, members.takers(event_type))):
        return ""
    makers = ", ".join(members.makers(event_type))
    return _reservation_by_norms(world, event_type) or (makers and _reserved(event_type, makers))


def _reservation_by_norms(world: FrameAlgorithm, event_type: str) -> str:
    """Why an event type is for norms alone, and how to allow it; or an empty string."""
    if event_type in world.world.people:
        return ""
    norms = [norm for norm in world.world.norms if event_type in norm.sends]
    names = ", ".join(norm.name for norm in norms[:_MAX_LISTED])
    return names and _reserved(event_type, f"the norm{'s'[: len(norms) > 1]} {names}")


def _reserved(event_type: str, sources: str) -> str:
    return (
        f"{event_type} comes from {sources}, so people may not send it; to let them,"
        f' write people = ["{event_type}"] under [world] in the world file'
    )


def without_effect(world: FrameAlgorithm, event: Event) -> str:
    """Why an order can change nothing, or an empty string: none of its receivers responds to it."""
    vocabulary = world.world.vocabulary
    if vocabulary.events[event.type].visual or world.members.takers(event.type):
        return ""
    kinds = {world.composition.kind(receiver) for receiver in event.receivers} - {""}
    responding = [name for name, kind in vocabulary.kinds.items() if event.type in kind.subscribes]
    if not (kinds or {*vocabulary.kinds}).isdisjoint(responding):
        return ""
    if not responding:
        return f"no agent kind of this world responds to {event.type}"
    return f"no {' or '.join(sorted(kinds))} responds to {event.type}; {listed(responding)} does"


def too_much_work(world: FrameAlgorithm, event: AnyEvent, person: str) -> str:
    """Reason for rejecting an order that gives hosts too much work, or an empty string."""
    work = world.inbox.work
    weight, most = world.inbox.ordered_by(person) + work.weight(event), work.most_of_generator
    return work.over(weight, most, "single_events", (event,)) if weight > most else ""


def unknown_value(
    world: FrameAlgorithm, event: Event, known_by: dict[Of, set[str]] | None = None
) -> str:
    """Reason for rejecting an order with a value that the world lacks, or an empty string.

    `known_by` keeps the values of the string for further events at the same time.

    It compares the order with the values that the string has for the event's type. A string without
    such a value is no reason to reject it, because objects that a robot detects are not in it.
    """
    for field in world.world.vocabulary.events[event.type].fields.all:
        source = field.type.source
        if source is None:
            continue
        known_by = {} if known_by is None else known_by
        known = known_by.get(source)
        if known is None:
            known = known_by[source] = set(map(str, values_of(world.composition.scene, source)))
        value: object = event.data[field.name]
        texts = cast("tuple[str, ...]", value if isinstance(value, tuple) else (value,))
        for text in texts:
            # No agent could carry out an order with an unknown name, such as a misspelt marker.
            if known and text not in known:
                names = sorted(known)
                return (
                    f"{event.type}: {field.name} is {text[:64]!r}, but no {source.symbol} of the"
                    f" world has this {source.parameter}; expected"
                    f" {listed(names)}{nearest(text, names)}"
                )
    return ""


def listed(names: Iterable[str]) -> str:
    """The first names of many, for a message."""
    shown = list(names)
    more = len(shown) - _MAX_LISTED
    return ", ".join(shown[:_MAX_LISTED]) + (f" or one of {more} more" if more > 0 else "")
