"""Inputs of one frame: everything its outcome follows from, so that it can be computed again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from minerva_bus.frame.composition import Layout
from minerva_bus.frame.messages import EvolveReply, TickReply
from minerva_bus.grammar.batch import AnyEvent


@dataclass(frozen=True, slots=True)
class FrameInputs:
    """What the frame algorithm received in one frame and used.

    `due`: visual event types for which a device requested a view.
    `ticked`: replies of lockstep members (step 2), by member.
    `taken`: events of other sources, by source.
    `layout`: how populations were divided into fragments.
    `replies`: replies of hosts (steps 5 and 6), in the order in which they were merged.
    `waiting`: events by source that arrived during the frame and count in the next one.
    `people`: sources whose events count as sent by people (for norms).
    `answers`: number of replies to the first request, and to each repeated request after a norm
    rejected an outcome.
    `left_out`: fragments without a reply.
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
