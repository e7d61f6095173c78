"""Table 2 of the paper as a pure state machine: stimulus in, instructions out.

It has no I/O and reads no clock. Every iteration order is independent of the order in which
members answer. The phases and their transitions are in `world_state.py`.

`FrameAlgorithm` runs the frames. `WorldGoal` has the agents that have reached the end of the world,
and `MemberLifecycle` (member_lifecycle.py) handles members that join and leave. `CollectionStep`
and `EvolutionStep` take the events and results of frames from members, `RecordedSource` from a
record.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, Final

from minerva_bus.errors import ProtocolError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection_step import CollectionStep, FrameInbox, visual_events
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.evolution_step import EvolutionStep
from minerva_bus.frame.member_lifecycle import MemberLifecycle, Shutdown
from minerva_bus.frame.member_table import MemberChange, Members
from minerva_bus.frame.norm_rejections import Norms
from minerva_bus.frame.placement import Placement
from minerva_bus.frame.sender_rights import EVENTS, EventWork, OrderRules
from minerva_bus.frame.stimuli import Checkpoint, FrameInputs, Instructions, is_people, is_set_aside
from minerva_bus.frame.view_streams import Views
from minerva_bus.frame.world_state import (
    Awaited,
    FrameInFlight,
    InputSteps,
    OutcomeSteps,
    Phase,
    Progress,
    WorldSpec,
)
from minerva_bus.grammar.events import AnyEvent, Events
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.types import Unfit
from minerva_bus.wording import counted
from minerva_bus.world.event_collection import collect
from minerva_bus.world.norms import SOURCE

MAX_NAMED_STRANGERS: Final = 3
MAX_PROBLEM_LINES: Final = 10
"""Maximum lines of a member's failure that are shown; its traceback is for the log file."""

# Each frame compares its phase a dozen times, and to find a member of an enum takes like a call.
_WAITING, _READY, _TICK, _EVOLVE = Phase.WAITING, Phase.READY, Phase.TICK, Phase.EVOLVE
_CLOSING, _STOPPING = Phase.CLOSING, Phase.STOPPING
_BEGIN, _EVENTS, _RESULTS = Awaited.BEGIN, Awaited.EVENTS, Awaited.RESULTS


class FrameAlgorithm:
    """Runs one world. `receive` takes a stimulus and returns the instructions that follow.

    `now` is the phase, and the frame in flight. Each part receives what it needs of the others;
    replies that violate the protocol come back as reasons.

    A replay runs the same table from a record. It replaces `make_steps`, `has_next`, `why_over`,
    `announce`, `members_changed` and `on_seek`, and nothing else.
    """

    def __init__(self, world: WorldSpec) -> None:
        past, rules = world.past, world.policy.rules
        self.world = world
        self.now = Progress(past.frame)
        self.members = Members(world.expected, world.shares.values())
        # The norms and the goal keep entries of their own in `saved`, so
        # it is filled before they read it.
        self.members.saved.update(past.saved)
        self.composition = Composition(world.scene, columns=not rules.makes_copies)
        limit = world.placement.agents_per_host
        self.placement = Placement(world.vocabulary, self.composition, limit)
        self.views = Views(world)
        work = EventWork(self.composition, world.vocabulary)
        self.inbox = FrameInbox(past, world.scene, work)
        counts = past.saved.get(SOURCE, {})
        self.norms = Norms(world.norms, self.composition, world.vocabulary, counts)
        self.orders = OrderRules(world, self.now, self.members, self.composition)
        self.goal = WorldGoal(world, self.composition, self.members.saved)
        self.out = Instructions(self.members.declines_columns)
        self.collection, self.evolution = self.make_steps()
        self.lifecycle = MemberLifecycle(
            world, self.now, self.members, self.placement, self.views, self.out, self.collection,
            self.evolution, self.orders, self,
        )  # fmt: skip

    @cached_property
    def _handlers(self) -> dict[type, Callable[[Any], str | None]]:
        """Handlers by type of stimulus; those of members' answers return the reason of a violation.

        Bound methods, because a frame has a stimulus for each member.
        """
        collection, lifecycle = self.collection, self.lifecycle
        return {
            s.Begin: self.on_begin,
            m.TickReply: collection.tick_reply,
            m.EvolveReply: self.evolution.reply,
            m.Emitted: collection.emitted,
            s.Publish: collection.order,
            s.Seek: self.on_seek,
            s.Appeared: lifecycle.appeared,
            m.Hello: lifecycle.hello,
            s.Vanished: lifecycle.vanished,
            s.Abandoned: lifecycle.gave_up,
            m.Leaving: lifecycle.leaving,
            s.Violation: lifecycle.violation,
            s.Skip: lifecycle.skip,
            s.Drain: self.on_drain,
            s.Silent: self.on_silent,
            m.Failed: self.on_failed,
            m.Resync: self.on_resync,
            m.MemberMetrics: self.on_metrics,
            m.Report: lifecycle.shutdown.report,
            s.End: self.on_end,
        }

    def receive(self, stimulus: s.Stimulus) -> list[s.Instruction]:
        """Process one stimulus and return the resulting instructions, in order."""
        out = self.out
        out.pending = []  # An exception may have left instructions of the previous stimulus.
        sender: str = getattr(stimulus, "member", "")
        # Only a token makes a member known. `Members.get` creates entries, so a message under an
        # invented name must not reach a handler.
        if sender and sender not in self.members.entries and not isinstance(stimulus, s.Appeared):
            self._note_stranger(sender)
        else:
            reason = self._handlers[stimulus.__class__](stimulus)
            if reason:
                self.lifecycle.violation(s.Violation(sender, reason))
            self.advance()
        return out.pending

    def _note_stranger(self, sender: str) -> None:
        # A sender that never appeared can use any number of names, so only a count is kept.
        self.members.strangers += 1
        strangers = self.members.strangers
        if strangers <= MAX_NAMED_STRANGERS:
            more = "" if strangers < MAX_NAMED_STRANGERS else "; further ones are not logged"
            self.out.log(sender[:64], f"unknown member: message ignored{more}")

    # --- what a replay replaces ---

    def make_steps(self) -> tuple[InputSteps, OutcomeSteps]:
        """The steps that take events and results from members; called by the constructor."""
        collection = CollectionStep(
            self.world, self.now, self.members, self.composition, self.inbox, self.norms,
            self.orders, self.out,
        )  # fmt: skip
        evolution = EvolutionStep(
            self.world, self.now, self.members, self.composition, self.placement, self.views,
            self.inbox, self.norms, self.out,
        )  # fmt: skip
        return collection, evolution

    def has_next(self) -> bool:
        """Whether a frame may begin."""
        return True

    def why_over(self) -> str:
        """Step 9: reason why no frame follows, or an empty string."""
        if self.composition.empty:
            return "the string is empty"
        if finished := self.goal.finished:
            return finished
        # Last, because an empty string or a reached goal is the more specific reason.
        if self.world.frames and self.now.frame >= self.world.frames:
            return "the frames are over"
        return ""

    def announce(self) -> None:
        """Step 10: announce that the next frame may begin."""
        self.out.pending.append(s.Ready(self.now.frame))

    def members_changed(self, hello: m.Hello | None) -> None:
        """Note that a member has joined with this hello, or, for None, has left."""

    def on_seek(self, seek: s.Seek) -> None:
        """Continue with another frame; only a replay can."""

    # --- Table 2 ---

    def advance(self) -> None:
        """Execute Table 2 as far as the answers received so far allow.

        A phase ends when no answer is outstanding; the next call continues from there. Step 1,
        w = w₀ and t = 0, is the constructor; step 2 begins with the requests of `on_begin`.
        """
        now, in_flight = self.now, self.now.in_flight
        # These are consecutive ifs because one call may end several phases: a frame that no
        # generator and no host has to answer runs through all of its steps here.
        if now.phase is _TICK:
            if in_flight.pending:
                return  # Most replies are not the last one.
            self.collection.collect()  # 2: e* = E(G*, t); 3: e^v of views; 4: e^u of evolution
            # Repeated frames have reported theirs.
            if in_flight.events.ordered and in_flight.logged is None:
                ordered = in_flight.events.ordered
                for problem in self.inbox.unknown.problems(ordered, self.composition):
                    self.out.log(EVENTS, problem)
            now.enter(_EVENTS)
            self.evolution.evolve()  # 5: w_next = η(w, e^u); 6: v = π(w, e^v)
        # `settle` is the last condition because it has effects: it applies the norms, and may
        # repeat requests to hosts.
        if now.phase is _EVOLVE and in_flight.requests.complete and self.evolution.settle():
            # Views are sent with the results and not before: a coupled device acts on a view, and a
            # frame that its coordinator never commits must not move anything. They are sent
            # before the commit, because they show the string with which the frame began.
            if in_flight.events.visual:
                self.show()  # 7: g = φ(v)
            self._commit()  # 8: w = w_next; t = t + 1
            self.continue_or_close()  # 9: if w = ε, go to 11; 10: go to 2
        # Not the local variable: `close` has replaced the frame in flight by now.
        if now.phase is _CLOSING and now.in_flight.requests.complete:
            self.show()  # the last w, which no further frame shows
            self._stop(_RESULTS)
        if now.phase is _STOPPING and not self.shutdown.pending:
            self._finish(Awaited.REPORTS)  # 11: end

    def continue_or_close(self) -> None:
        """Steps 9 and 10: announce the next frame, or show the last string once more."""
        reason = self.why_over()
        if self.now.phase is _STOPPING:  # The frame has failed.
            return
        if reason:
            self.close(reason)
            return
        if self.now.phase is _EVOLVE:
            self.now.enter(_RESULTS)
        self.announce()

    def _commit(self) -> None:
        # Before the string changes, because the sender of such an event may be gone then.
        if self.now.in_flight.result.sent:
            self.goal.note(self.now.in_flight.result.sent, self.out)
        self.evolution.commit()

    def start_if_complete(self) -> None:
        """Announce the first frame once all expected members are present."""
        if self.now.phase is not _WAITING or self.members.index.awaited:
            return
        # Step 9 follows a frame, so a world cannot end before frame 0. A resumed
        # world or a successor begins after a frame, and its predecessor may have
        # died before it could end the world.
        reason = self.why_over() if self.now.frame else ""
        if reason:
            self.close(reason)
        else:
            self.now.enter(Awaited.MEMBERS)
            self.announce()

    def show(self) -> None:
        """Step 7: send every device its view of w, the string that this frame began with."""
        last = self.now.phase is _CLOSING
        self.views.show(
            self.now.frame, self.now.in_flight, self.composition, self.members, self.out, last=last
        )

    def close(self, reason: str) -> None:
        """End a world after its last frame: devices show its last string before it stops."""
        self.shutdown.reason = reason
        due = self.members.index.due_views(self.now.frame, (), closing=True)
        self.now.in_flight = FrameInFlight()
        types = self.world.vocabulary.events
        self.now.in_flight.events.visual = visual_events(types, due)
        # The phase changes before the request: in EVOLVE a policy may evolve agents without events,
        # and here hosts only make views.
        self.now.enter(Awaited.OVER)
        self.evolution.evolve()

    def fail(self, reason: str) -> None:
        """End the world prematurely, because of an error."""
        self.shutdown.failed = True
        self.shutdown.reason = reason
        self._stop(Awaited.END)

    def _stop(self, awaited: Awaited) -> None:
        """Request the reports of all members."""
        self.now.enter(awaited)
        # The interrupted frame is never committed, so its replies are no longer needed.
        self.now.in_flight.pending = set()
        self.now.in_flight.requests.cancel()
        self.shutdown.begin(member.name for member in self.members.index.active)
        stopping = s.Stopping(self.shutdown.reason, self.now.frame, self.closing_events)
        self.out.pending.append(stopping)
        self.out.send(s.EVERYONE, m.Stop(self.shutdown.reason))

    def _finish(self, awaited: Awaited) -> None:
        """Step 11: the world is over."""
        self.now.enter(awaited)
        if self.norms.broken:
            counts = sorted(self.norms.broken.items())
            self.shutdown.add_figures(SOURCE, {f"norm_{name}": count for name, count in counts})
        self.out.pending.append(s.Ended(self.shutdown.reason, self.shutdown.total()))

    # --- handlers ---

    def on_begin(self, begin: s.Begin) -> None:
        """Begin a frame: step 2 requests the events of all generators.

        A world that expects no members becomes ready by its first `Begin`.
        """
        if begin.inputs is not None and begin.inputs.complete:
            self._repeat(begin.inputs)
            return
        if self.now.phase is _WAITING:
            self.start_if_complete()
            return
        if self.now.phase is not _READY or not self.has_next():
            return
        # Before the new frame is made, so that newcomers answer its tick and host its agents.
        if self.members.index.joining:
            self.lifecycle.admit_joining()
        self.now.in_flight = FrameInFlight(begin.due, begin.inputs)
        self.now.enter(_BEGIN)
        self.collection.begin()

    def _repeat(self, inputs: FrameInputs) -> None:
        """Run a frame from its complete inputs, which succession does before any member appears.

        It awaits nothing, so the phase stays. Raises ProtocolError if the inputs are not those
        of the next frame, or do not fit.
        """
        if inputs.frame != self.now.frame:
            raise ProtocolError(
                f"expected inputs of frame {self.now.frame}, got frame {inputs.frame}"
            )
        self.now.in_flight = FrameInFlight(logged=inputs)
        try:
            self.collection.begin()
            self.now.in_flight.pending = set()
            self.collection.collect()
            self.evolution.evolve()
            self.evolution.settle()
            # No device is present yet, but logged views are deltas of earlier ones, and devices
            # that join receive the latest view.
            self.show()
            self._commit()
        except Unfit as unfit:
            raise ProtocolError(f"inputs of frame {inputs.frame}: {unfit}") from None

    def on_drain(self, drain: s.Drain) -> None:
        """Move a host's agents to other hosts when the next frame begins."""
        member = self.members.get(drain.member)
        if member.active and not member.drained:
            member.drained = self.placement.outdated = True
            self.out.log(member.name, "draining: its agents move to other hosts")

    def on_silent(self, _: s.Silent) -> None:
        """Mark the members that the world waits for as late."""
        if self.now.phase is _STOPPING:
            self.shutdown.drop_departed()
            return
        for name in self.waiting_for():
            self.members.change(self.members.get(name), MemberChange.SILENT)

    def on_resync(self, resync: m.Resync) -> None:
        """Send a keyframe to an observer that has missed a view."""
        keyframe = self.views.keyframe(resync.event_type)
        if keyframe is not None and self.members.get(resync.member).active:
            self.out.send(resync.member, keyframe)

    def on_failed(self, failed: m.Failed) -> None:
        """Log a member's failure, once per process, because the process ends after it."""
        member = self.members.get(failed.member)
        if not member.blamed:
            member.blamed = True
            when = f"failed in frame {failed.frame}" if failed.frame >= 0 else "failed"
            lines = failed.problem.split("\n")[:MAX_PROBLEM_LINES]
            self.out.log(member.name, f"{when}: {chr(10).join(lines)}", failed.traceback)

    def on_end(self, end: s.End) -> None:
        """End the world now; a second request does not wait for reports."""
        # An interrupt may still arrive after the end.
        if self.now.phase is Phase.ENDED:
            return
        self.shutdown.failed |= end.failed
        if self.now.phase is _STOPPING:
            self._finish(Awaited.END)
        else:
            self.shutdown.reason = end.reason
            self._stop(Awaited.END)

    def on_metrics(self, metrics: m.MemberMetrics) -> None:
        """Keep a member's metrics for displays."""
        self.members.get(metrics.member).figures = metrics.figures

    # --- outstanding answers ---

    def waiting_for(self) -> list[str]:
        """The members that the world waits for, sorted."""
        if self.now.phase in (_WAITING, _READY):
            return [member.name for member in self.members.index.awaited]
        if self.now.phase is _TICK:
            return sorted(self.now.in_flight.pending)
        if self.now.phase is _STOPPING:
            return sorted(self.shutdown.pending)
        requests = self.now.in_flight.requests
        names = {host for host, _ in requests.outstanding}
        if requests.unassigned:
            names.update(member.name for member in self.members.index.awaited)
        return sorted(names)

    def awaits(self, member: str) -> bool:
        """Whether this frame waits for an answer of a member."""
        if self.now.phase in (_TICK, _STOPPING):
            return member in self.now.in_flight.pending or member in self.shutdown.pending
        requests = self.now.in_flight.requests
        if self.now.phase in (_WAITING, _READY) or requests.unassigned:
            return member in self.waiting_for()
        return bool(requests.of(member))

    # --- state ---

    @property
    def frame(self) -> int:
        """The number of the frame in flight, or of the next one."""
        return self.now.frame

    @property
    def phase(self) -> Phase:
        """The phase of the world."""
        return self.now.phase

    @property
    def shutdown(self) -> Shutdown:
        """The end of the world, for which members report."""
        return self.lifecycle.shutdown

    @property
    def in_frame(self) -> bool:
        """Whether a frame is in progress."""
        return self.now.phase in (_TICK, _EVOLVE)

    @property
    def at_rest(self) -> bool:
        """Whether the next frame would change neither the string nor any view.

        There is no waiting event, no generator in step that has events without orders, and every
        device has shown the string. A world with a fixed number of frames never rests.
        """
        if self.world.frames or self.now.phase is not _READY or self.placement.outdated:
            return False
        if self.inbox:  # Before the rest, because the event that wakes the world waits for this.
            return False
        index = self.members.index
        # A device whose view is made every n frames shows the latest change only in one of these.
        unseen = self.now.frame - self.views.last_change < index.every
        busy = unseen or not index.tickers <= self.members.resting or index.joining
        # Under some policies a frame without events changes or removes agents that have a host.
        fades = self.world.policy.rules.without_events
        return not (busy or (fades and self.placement.unassigned_agents < self.composition.count))

    @property
    def failed(self) -> bool:
        """Whether the world ended prematurely because of an error."""
        return self.shutdown.failed

    @property
    def reached(self) -> bool:
        """Whether every agent of the kinds that send `until` has sent it."""
        return self.goal.met

    @property
    def scene(self) -> Scene:
        """The string w of the frame in flight, or of the next one."""
        return self.composition.scene

    @property
    def closing_events(self) -> tuple[AnyEvent, ...]:
        """What agents and norms sent in the last complete frame: events of the next one.

        Whoever counts, writes or prints the events of a run takes these at its end, because no
        frame follows.
        """
        return collect(self.world.order, self.inbox.sent)

    # --- checkpoints and logs ---

    @property
    def checkpoint(self) -> Checkpoint:
        """State besides the string from which the world can resume; valid between frames."""
        return Checkpoint(
            self.now.frame,
            dict(self.members.saved),
            tuple(self.inbox.emitted),
            self.inbox.waiting(),
            self.goal.reached,
            self.goal.striving,
        )

    @property
    def shown(self) -> list[m.ViewShown]:
        """The latest view of each visual event type, as a keyframe."""
        return self.views.keyframes()

    @property
    def ordered(self) -> Mapping[str, Sequence[AnyEvent]]:
        """Events outside of all complete frames, by source, if people have sent any of them."""
        events = self.now.in_flight.events
        # `collect` has moved the events of the frame out of the inbox, but they only count when the
        # frame is complete: until then a successor needs them from here.
        taken: dict[str, Sequence[AnyEvent]] = {}
        if self.now.phase is _EVOLVE:
            taken |= events.taken
        for source, orders in events.orders.items() if self.in_frame else ():
            taken[source] = [*orders, *taken.get(source, ())]
        # The same events as `events.orders`, which have been added as people's.
        taken = {name: each for name, each in taken.items() if not is_set_aside(name)}
        waiting = self.inbox.events
        if not any(map(is_people, (*taken, *waiting))):
            return {}
        sources = sorted({*taken, *waiting})
        return {name: [*taken.get(name, ()), *waiting.get(name, ())] for name in sources}

    def expect(self, members: Iterable[str]) -> None:
        """Also wait for these members before the next frame."""
        for name in sorted(members):
            self.members.expect(name)


GIVEN_UP: Final = "~given up"
"""Key in `Checkpoint.saved` for the agents that have given up; no member can have this name."""

_MAX_REASONS: Final = 3
"""Maximum number of agents that are named at the end with their reasons for giving up."""


def all_sent(until: str) -> str:
    """Reason for an end by `until`."""
    return f"every agent has sent {until}"


class WorldGoal:
    """The agents that have sent `until`, and those that have sent `give_up`.

    `reached`: agents that have sent `until`; `striving`: the kinds of agents that send either.
    """

    def __init__(
        self, world: WorldSpec, composition: Composition, saved: dict[str, Mapping[str, Any]]
    ) -> None:
        """`saved` is the world's saved state, which keeps the agents that have given up."""
        self._until, self._give_up = world.until, world.give_up
        self._composition = composition
        self._saved = saved
        self.reached = world.past.reached
        self.striving = world.past.reaching

    @property
    def met(self) -> bool:
        """Whether every agent of the kinds that send `until` has sent it."""
        return bool(self.finished) and not self.given_up

    @property
    def finished(self) -> str:
        """Reason for the end if every agent has sent `until` or given up, otherwise empty."""
        if not self._until:
            return ""
        done = self.reached.union(self.given_up)
        # Kinds count once one of their agents has sent an event. Before that no agent strives for
        # the goal, and the empty set would seem complete.
        composition = self._composition
        striving = (who for who in composition.agents() if composition.kind(who) in self.striving)
        if not (done and done.issuperset(striving)):
            return ""
        given_up = self.given_up
        reasons = [f"#{agent} has given up: {given_up[agent]}" for agent in sorted(given_up)]
        over = len(reasons) - _MAX_REASONS
        more = [f"and {over} more"] if over > 0 else []
        return "; ".join([*reasons[:_MAX_REASONS], *more]) or all_sent(self._until)

    @property
    def given_up(self) -> Mapping[str, Any]:
        """Agents that have sent `give_up` and not `until` since, with the event as text."""
        return self._saved.get(GIVEN_UP, {})

    def note(self, sent: Mapping[str, tuple[AnyEvent, ...]], out: Instructions) -> None:
        """Note the agents that have sent `until` or `give_up`; `sent` is by agent or fragment.

        Kinds are noted before the frame's changes count, because the sender may be gone then.
        """
        ends = {self._until, self._give_up} - {""}  # A world without a goal has empty types.
        for name, events in sent.items() if ends else ():
            ending = [event for event in events if event.type in ends]
            for event in ending:
                self._note_event(event, out)
            if ending:
                part = self._composition.parts.get(name)
                kind = part.symbol if part is not None else self._composition.kind(name)
                self.striving = self.striving.union((kind,))

    def _note_event(self, event: AnyEvent, out: Instructions) -> None:
        batch = isinstance(event, Events)
        senders = tuple(event.senders or ()) if batch else (event.sender,)
        given_up = self.given_up
        if event.type == self._until:
            self.reached = self.reached.union(senders)
            # Reaching the goal later supersedes giving up.
            given_up = {name: why for name, why in given_up.items() if name not in senders}
        else:
            why = event.type if batch else f"{event.type}<{event.data_text()}>"
            given_up = {**given_up, **dict.fromkeys(senders, why)}
            who = senders[0] if len(senders) == 1 else counted(len(senders), "agent")
            out.log(who, f"gave up: {why}")
        if given_up or GIVEN_UP in self._saved:
            self._saved[GIVEN_UP] = given_up


__all__ = ["FrameAlgorithm", "Phase"]
