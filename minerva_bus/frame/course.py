"""What a frame's outcome follows from, so that it can be had again without anybody's help."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from minerva_bus.frame.composition import Layout
from minerva_bus.frame.messages import EvolveReply, TickReply
from minerva_bus.grammar.batch import AnyEvent


@dataclass(frozen=True, slots=True)
class Course:
    """What members have said in a frame, as it counted.

    `due` are the visual event types of which devices wanted a view by themselves, `ticked` the
    answers of lockstep members by name, `taken` the events of others by source, `layout` how
    populations were cut, `replies` the answers of hosts in their order. `waiting` are events by
    source that came meanwhile, for the frame after it. The sources `people` stood for people.
    `answers` says how many of the replies came for all events, and how many each time that those
    whom norms refuse were asked again; `left_out` are the fragments that nobody answered for.
    """

    frame: int
    due: tuple[str, ...]
    ticked: Mapping[str, TickReply]
    taken: Mapping[str, Sequence[AnyEvent]]
    layout: Layout
    replies: Sequence[EvolveReply]
    waiting: Mapping[str, Sequence[AnyEvent]]
    people: tuple[str, ...] = ()
    answers: tuple[int, ...] = ()
    left_out: tuple[str, ...] = ()
