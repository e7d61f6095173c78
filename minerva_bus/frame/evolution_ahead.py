"""Evolution of the next frame by a host, before this frame is complete.

The coordinator then checks and commits a frame while the host evolves the next one. This requires
that the results of a frame cannot change the events of the next one: the host's agents send no
events (they are `ahead`), and nothing else is on its way. A request that proves void costs time,
but does not change the string: the host receives its fragments again, with a further part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.early_views import EarlyViewsStep
from minerva_bus.frame.inbox import EarlyEvolution, are_same
from minerva_bus.frame.phases import Phase
from minerva_bus.frame.views import due_views
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.world.order import collect

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm


class EvolutionAhead:
    """Requests the next frame of a host, and judges in that frame whether the request counts."""

    def __init__(self, algorithm: FrameAlgorithm) -> None:
        self._algorithm = algorithm
        self.views = EarlyViewsStep(algorithm)
        # Frames without an early request after one that was void: twice as many each time, and
        # fewer after those that count.
        self._pause = 1
        self._resumes: int = 0

    def ask(self) -> None:
        """Request the next frame, if all that it depends on is known."""
        algorithm = self._algorithm
        early = algorithm.inbox.early
        if early.evolution is not None:
            return
        host = self._only_host()
        if host is None or not self._is_predictable():
            return
        frame = algorithm.frame + 1
        sources = self._sources(frame)
        events = collect(algorithm.world.order, sources) if sources else ()
        types = algorithm.world.vocabulary.events
        if not events or any(types[event.type].visual for event in events):
            return
        if algorithm.placement.concerned(events, ()) != [host]:
            return
        requests = algorithm.in_flight.requests
        requests.timed = False
        fragments = requests.outstanding[host, 0]
        early.evolution = EarlyEvolution(frame, host, fragments, sources, events)
        algorithm.out.send(s.HOSTS, m.EvolveRequest(frame, (host,), events, ()))

    def _only_host(self) -> str | None:
        """The host that alone evolves this frame and holds what it is to evolve in the next one."""
        algorithm, in_flight = self._algorithm, self._algorithm.in_flight
        requests = in_flight.requests
        if not in_flight.at_once or algorithm.phase is not Phase.EVOLVE or in_flight.logged:
            return None
        if len(requests.outstanding) != 1 or in_flight.result.replies or requests.repeats:
            return None
        if requests.unassigned or requests.left_out or in_flight.events.visual:
            return None
        host, _ = next(iter(requests.outstanding))
        placement = algorithm.placement
        held = host in placement.silent and placement.is_current(host)
        return host if held and not algorithm.members.declines_columns(host) else None

    def _is_predictable(self) -> bool:
        """Whether nothing but the answers of generators can be an event of the next frame."""
        algorithm, index = self._algorithm, self._algorithm.members.index
        world, frame, rules = algorithm.world, algorithm.frame, self._algorithm.world.policy.rules
        if frame < self._resumes or (world.frames and frame + 1 >= world.frames):
            return False
        if world.norms or rules.makes_copies or rules.without_events:
            return False
        if algorithm.inbox or index.joining or index.rates or not index.tickers:
            return False
        return not due_views(index, frame + 1, ()) and index.tickers.isdisjoint(world.speaks_for)

    def _sources(self, frame: int) -> Mapping[str, Sequence[AnyEvent]]:
        """The events of a frame by generator; none before all have answered."""
        replies, members = self._algorithm.inbox.early.of(frame), self._algorithm.members
        if not members.index.tickers - members.resting <= replies.keys():
            return {}
        return {name: reply.events for name, reply in replies.items() if reply.events}

    # --- in the frame that was requested early ---

    def keep(self, reply: m.EvolveReply) -> bool:
        """Keep a reply to an early request until its frame requests it; False for another one."""
        early = self._algorithm.inbox.early.evolution
        if early is None or early.reply is not None or reply.part:
            return False
        if (reply.member, reply.frame) != (early.host, early.frame):
            return False
        early.reply = reply
        return True

    def note(self, reply: m.EvolveReply, fragments: tuple[str, ...]) -> None:
        """Note a reply about these fragments, which may have views of the next frame with it."""
        early = self.views.after(reply, fragments)
        if early is not None:
            self._algorithm.inbox.early.evolution = early

    def take(self) -> EarlyEvolution | None:
        """The early evolution for this frame, if there is one, which is then an ordinary one."""
        answers = self._algorithm.inbox.early
        early, answers.evolution = answers.evolution, None
        return early

    def counts(self, early: EarlyEvolution, hosts: Sequence[str]) -> bool:
        """Whether an early evolution is the one that this frame needs of these hosts."""
        algorithm, placement = self._algorithm, self._algorithm.placement
        events = algorithm.in_flight.events
        counts = (
            algorithm.phase is Phase.EVOLVE
            and early.frame == algorithm.frame
            and early.host in hosts
            and are_same((*events.evolving, *events.visual), early.events)
            and placement.fragments_of(early.host) == early.fragments
            and placement.is_current(early.host)
        )
        if not early.asked:
            self.views.judge(early, counts=counts)
        elif counts:
            self._pause = max(1, self._pause - 1)
        else:
            self._pause *= 2
            self._resumes = algorithm.frame + self._pause
        return counts
