"""Who is there: what liveliness tokens say of members and of coordinators."""

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
"""What a sample of a token says of it."""


def presence(sample: zenoh.Sample) -> s.Appeared | s.Vanished | None:
    """What a token's sample says of a member; nothing of the coordinator's own.

    Nor that one is gone who cannot have been there, for want of a name.
    """
    member, there = last_part(str(sample.key_expr)), sample.kind == HERE
    if member == COORDINATOR or not (there or is_name(member)):
        return None
    return s.Appeared(member) if there else s.Vanished(member)


@dataclass(frozen=True, slots=True)
class Successor:
    """A coordinator of this epoch is there."""

    epoch: int


def successor(sample: zenoh.Sample) -> Successor | None:
    """What a coordinator's token says of its epoch; nothing where it is gone."""
    epoch = last_part(str(sample.key_expr))
    there = sample.kind == HERE and epoch.isdecimal()
    return Successor(int(epoch)) if there else None
