"""Views of the next frame that a host sends with its answer, without a request.

An agent that has changed may send a visual event, which shows it in the next frame. If nothing else
happens, its host knows that frame's views already, and the request for them would take two
crossings of the bus. A host sends such views after some frames in a row in which nothing else has
happened, until something does. Whether the views count is decided in their frame, by its events
and fragments, so only time depends on it; otherwise the host receives its fragments again.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from minerva_bus.frame import messages as m
from minerva_bus.frame.event_sources import AGENTS
from minerva_bus.frame.inbox import EarlyEvolution
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.symbols import EventType
from minerva_bus.world.order import Order, collect

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm

NEEDED: Final = 2
"""Frames in a row in which early views of a host would have counted, before it sends them."""


def views_after(
    reply: m.EvolveReply, types: Mapping[str, EventType], order: Order | None = None
) -> tuple[AnyEvent, ...]:
    """The events of the next frame if all of them are in this reply, and visual; none otherwise.

    A host does not know the `order` of a world; that of event types does not affect their views.
    """
    # The order of several senders is that of the string, which a host knows in part only.
    if reply.part or len(reply.emitted) != 1:
        return ()
    (events,) = reply.emitted.values()
    if not all(types[event.type].visual for event in events):
        return ()
    return collect(order or Order(), {AGENTS: events})


class EarlyViewsStep:
    """Decides which host is to send early views, and judges those that have arrived."""

    def __init__(self, algorithm: FrameAlgorithm) -> None:
        self._algorithm = algorithm
        self._sender = ""
        # Consecutive frames with the expected events of one host, and how many there are to be
        # before it is told to send early views: twice as many after views that were void,
        # and fewer after those that count.
        self._host = ""
        self._expected: int = 0
        self._needed = NEEDED

    def objection(self, reply: m.EvolveReply) -> str:
        """Reason for rejecting a reply with views of the next frame, or an empty string."""
        if reply.ahead is None or reply.member == self._sender:
            return ""
        return "it sent views of the next frame and was not told to"

    def after(self, reply: m.EvolveReply, fragments: tuple[str, ...]) -> EarlyEvolution | None:
        """The early evolution that follows from a reply about these fragments, if any does."""
        world, former = self._algorithm.world, self._algorithm.inbox.early.evolution
        events = views_after(reply, world.vocabulary.events, world.order)
        # One host sends early views, so there are no others yet if this reply has some.
        if reply.ahead is None and (not events or (former is not None and former.begun)):
            return None
        sources = {AGENTS: [event for sent in reply.emitted.values() for event in sent]}
        return EarlyEvolution(
            reply.frame + 1, reply.member, fragments, sources, events, reply.ahead, asked=False
        )

    def judge(self, early: EarlyEvolution, *, counts: bool) -> None:
        """Let a host send early views from now on, or no longer."""
        if early.begun:
            self._needed = max(NEEDED, self._needed - 1) if counts else 2 * self._needed
        self._expected = self._expected + 1 if counts and early.host == self._host else int(counts)
        self._host = early.host
        if not counts and early.host == self._sender:
            self._tell(early.host, wanted=False)
        # Also a host that has joined again since it was told.
        elif (
            counts and not early.begun and self._expected >= self._needed and self._may(self._host)
        ):
            if self._sender and self._algorithm.members.get(self._sender).active:
                self._tell(self._sender, wanted=False)
            self._tell(early.host, wanted=True)

    def _may(self, host: str) -> bool:
        algorithm = self._algorithm
        hello, rules = algorithm.members.get(host).hello, algorithm.world.policy.rules
        able = hello is not None and hello.early_views and not hello.plain
        return able and not (rules.makes_copies or rules.without_events)

    def _tell(self, host: str, *, wanted: bool) -> None:
        self._sender = host if wanted else ""
        self._algorithm.out.send(host, m.EarlyViews(wanted))
