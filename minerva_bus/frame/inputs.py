"""Inputs of one frame, from which it can be computed again, and a frame as recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from minerva_bus.frame.fragments import Layout
from minerva_bus.frame.messages import EvolveReply, TickReply
from minerva_bus.frame.passed import fast_dataclass
from minerva_bus.grammar.batch import AnyEvent


@fast_dataclass
class FrameInputs:
    """Input of the frame algorithm in one frame, as far as it was used.

    `due`: visual event types for which a device requested a view.
    `ticked`: replies of members in step (step 2), by member.
    `taken`: events of other sources, by source.
    `layout`: the division of populations into fragments.
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

    @property
    def complete(self) -> bool:
        """Whether these inputs include all replies, so that the frame awaits no member."""
        return bool(self.answers)

    @property
    def without_replies(self) -> FrameInputs:
        """These inputs without the results of agents, so that hosts have to compute them again."""
        # Empty `answers` mark the inputs as incomplete, so the frame sends requests to its hosts.
        return replace(self, layout=(), replies=(), waiting={}, answers=(), left_out=())


@fast_dataclass
class RecordedFrame:
    """A frame of a recorded run.

    `events`: in order. `delta`: changes of the string, as plain data (log/deltas.py).
    `digest`: of the string after the frame. `seconds`: when the frame ended, by the clock, since
    the record began. `inputs`: without the replies of hosts; None unless recorded and requested.
    """

    number: int
    events: tuple[AnyEvent, ...]
    delta: list[Any]
    digest: bytes
    seconds: float
    inputs: FrameInputs | None = None
