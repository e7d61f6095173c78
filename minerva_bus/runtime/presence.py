"""Presence of members and coordinators, read from samples of their liveliness tokens."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import zenoh

from minerva_bus.frame import stimuli as s
from minerva_bus.wire.keys import COORDINATOR, is_name, last_part

HERE: Final = zenoh.SampleKind.PUT
GONE: Final = zenoh.SampleKind.DELETE


def presence(sample: zenoh.Sample) -> s.Appeared | s.Vanished | None:
    """A member's appearance or disappearance; None for the coordinator's token.

    Also None when a token without a valid name disappears: its member was never admitted.
    """
    member, there = last_part(str(sample.key_expr)), sample.kind == HERE
    # An appearance under an invalid name is passed on, so that it is counted and logged.
    if member == COORDINATOR or not (there or is_name(member)):
        return None
    return s.Appeared(member) if there else s.Vanished(member)


@dataclass(frozen=True, slots=True)
class Successor:
    """A coordinator of this epoch is running."""

    epoch: int


def successor(sample: zenoh.Sample) -> Successor | None:
    """The coordinator whose token appeared; None if it disappeared."""
    epoch = last_part(str(sample.key_expr))
    there = sample.kind == HERE and epoch.isdecimal()
    return Successor(int(epoch)) if there else None
