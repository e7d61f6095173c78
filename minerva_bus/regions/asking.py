"""The order in which the services of a region answer: publishers before those that read them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from minerva_bus.errors import WorldStopped
from minerva_bus.frame import messages as m
from minerva_bus.frame.member import Member
from minerva_bus.regions.replies import Answer, received


def answers_of(
    members: Mapping[str, Member], ask: Callable[[Member], Sequence[Answer]]
) -> dict[str, m.TickReply]:
    """The replies of all members to a tick; what they publish reaches those that read it.

    Raises WorldStopped if members wait for each other's readings.
    """
    replies, waiting = dict[str, m.TickReply](), dict(sorted(members.items()))
    while waiting:
        name = next((name for name in waiting if _has_readings(name, waiting)), None)
        if name is None:
            raise WorldStopped(
                f"regions: halo = true: {', '.join(waiting)} wait for each other's readings;"
                " expected no cycle of sensor topics"
            )
        for answer in ask(waiting.pop(name)):
            if isinstance(answer, m.TickReply):
                replies[name] = answer
            elif isinstance(answer, m.Readings):
                for member in members.values():
                    if answer.topic in member.topics:
                        received(member, answer)
    return replies


def _has_readings(name: str, waiting: Mapping[str, Member]) -> bool:
    publishers = [member for other, member in waiting.items() if other != name]
    published = {topic for member in publishers for topic in member.hello().publishes}
    return published.isdisjoint(waiting[name].topics)
