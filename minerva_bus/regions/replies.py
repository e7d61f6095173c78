"""Replies: what services in one region have sent for agents in others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from minerva_bus.frame import messages as m
from minerva_bus.frame.member import Member
from minerva_bus.grammar.batch import AnyEvent

Answer: TypeAlias = m.FromMember | m.Readings


@dataclass(frozen=True, slots=True)
class Replies:
    """Events of services in a frame, by their names, for one region.

    They are of all attached services, or of all services with a halo. `kept` is what the latter
    have saved of the agents that have moved.
    """

    frame: int
    source: int
    target: int
    events: Mapping[str, tuple[AnyEvent, ...]]
    kept: Mapping[str, str] = field(default_factory=dict[str, str])

    @property
    def needed_in(self) -> int:
        """The frame that cannot begin without it."""
        return self.frame


def received(member: Member, message: m.ToMember | m.Readings) -> list[Answer]:
    """Deliver a message to a member; returns its answers."""
    answers = member.receive(message)
    # On the bus an observer draws when its inbox is empty, which it always is here.
    member.show()
    return answers
