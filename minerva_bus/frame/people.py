"""What people may send: the types that are theirs, and not those by which a world perceives."""

from __future__ import annotations

from collections.abc import Iterable
from typing import cast

from minerva_bus.errors import nearest
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.phases import Phase
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.known import values_of

_LISTED = 12


def refusal_of_order(world: FrameAlgorithm, event_type: str) -> str:
    """Why people may not send an event of a type, or the empty text.

    They may send what a generator takes orders for, what the world file lists, and what no
    generator makes. All else is a sensor's, a clock's or physics': from a terminal it would be a
    lie about the world.
    """
    members = world.members
    if event_type in world.world.people or members.takers(event_type):
        return ""
    makers = members.makers(event_type)
    if makers:
        return (
            f"{event_type} comes from {', '.join(makers)}, so people may not send it; to let them,"
            f' write people = ["{event_type}"] under [world] in the world file, or give it a'
            ' process with service = "orders"'
        )
    unknown = [member.name for member in members if member.expected and member.hello is None]
    if unknown and world.phase is Phase.WAITING:
        return (
            f"nobody knows yet whether people may send {event_type}: the world still gathers"
            f" {', '.join(unknown[:5])}; send it when the world runs"
        )
    return ""


def unknown_value(world: FrameAlgorithm, event: Event) -> str:
    """Why an order names what the world does not have, or the empty text.

    It looks in the string for the texts that the event's type takes from there. A string without
    any such text says nothing about them: what a robot meets on a real floor is not in it.
    """
    for one in world.world.vocabulary.events[event.type].fields.all:
        source = one.type.source
        if source is None:
            continue
        known = sorted({str(value) for value in values_of(world.composition.scene, source)})
        value: object = event.data[one.name]
        texts = cast("tuple[str, ...]", value if isinstance(value, tuple) else (value,))
        for text in texts:
            if known and text not in known:
                return (
                    f"{event.type}: {one.name} is {text!r}, but no {source.symbol} of the world has"
                    f" this {source.parameter}; expected {_listed(known)}{nearest(text, known)}"
                )
    return ""


def _listed(names: Iterable[str]) -> str:
    shown = list(names)
    more = len(shown) - _LISTED
    return ", ".join(shown[:_LISTED]) + (f" or one of {more} more" if more > 0 else "")
