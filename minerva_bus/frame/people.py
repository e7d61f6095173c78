"""What people may send: the types that are theirs, and not those by which a world perceives."""

from __future__ import annotations

from minerva_bus.frame.core import Core, Phase


def refusal_of_order(world: Core, event_type: str) -> str:
    """Why people may not send an event of a type, or the empty text.

    They may send what a generator takes orders for, what the world file lists, and what no
    generator makes. All else is a sensor's, a clock's or physics': from a terminal it would be a
    lie about the world.
    """
    roster = world.roster
    if event_type in world.world.people or roster.takers(event_type):
        return ""
    makers = roster.makers(event_type)
    if makers:
        return (
            f"{event_type} comes from {', '.join(makers)}, so people may not send it; to let them,"
            f' write people = ["{event_type}"] under [world] in the world file, or give it a'
            ' process with service = "orders"'
        )
    unknown = [member.name for member in roster if member.expected and member.hello is None]
    if unknown and world.phase is Phase.WAITING:
        return (
            f"nobody knows yet whether people may send {event_type}: the world still gathers"
            f" {', '.join(unknown[:5])}; send it when the world runs"
        )
    return ""
