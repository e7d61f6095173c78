"""The system algorithm, Table 2, as a pure state machine: stimulus in, instructions out.

Two rules of this file: it does no input or output and reads no clock, and whatever it iterates
over is in an order that does not depend on who answered first.

    WAITING ─▶ READY ─Begin─▶ TICK ─▶ EVOLVE ─▶ READY ─▶ ...      one frame: steps 2 to 8
                                        └─▶ CLOSING ─▶ STOPPING ─▶ ENDED
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

from minerva_bus.errors import ProtocolError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.attendance import Attendance
from minerva_bus.frame.core import Phase
from minerva_bus.frame.description import World
from minerva_bus.frame.enforcement import PEOPLE
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.frame.members import MemberChange, MemberEntry, MemberState
from minerva_bus.frame.showing import check_all, patch_all
from minerva_bus.frame.steps import HANDED_OVER
from minerva_bus.grammar.batch import AnyEvent, count_of
from minerva_bus.grammar.columns import Columns, packed
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.scene import Piece, Scene, agents
from minerva_bus.world.evolution import Policy
from minerva_bus.world.lineage import copy_id

STRANGERS_NAMED = 3
REPORT_LINES = 10
"""Of what a member says of its failure, so many lines are shown; its traceback is for the log."""

MOST_WAITING = 100_000
"""Events of one free-running generator that wait for a frame; a paused world takes none."""


class FrameAlgorithm(Attendance):
    """Runs one world. `receive` takes a stimulus and returns what is to be done."""

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self._do: dict[type, Callable[[Any], None]] = {
            s.Begin: self._on_begin,
            m.TickReply: self._on_tick_reply,
            m.EvolveReply: self._on_evolve_reply,
            m.Emitted: self._on_emitted,
            s.Order: self._on_order,
            s.Drain: self._on_drain,
            s.Appeared: self._on_appeared,
            m.Hello: self._on_hello,
            s.Vanished: self._on_vanished,
            s.Abandoned: self._on_gave_up,
            s.Violation: self._on_violation,
            s.Silent: self._on_silent,
            s.Skip: self._on_skip,
            m.Failed: self._on_failed,
            m.Resync: self._on_resync,
            m.Leaving: self._on_leaving,
            m.MemberMetrics: self._on_doing,
            m.Report: self._on_report,
            s.End: self._on_end,
        }

    def receive(self, stimulus: s.Stimulus) -> list[s.Instruction]:
        """Take one stimulus; what is to be done because of it, in order."""
        self._out = []
        who: str = getattr(stimulus, "member", "")
        if who and not self.members.knows(who) and not isinstance(stimulus, s.Appeared):
            self._on_stranger(who)
        else:
            self._do[type(stimulus)](stimulus)
        return self._out

    def _on_stranger(self, who: str) -> None:
        """Somebody speaks who never appeared: nothing is kept of it but a count."""
        self.strangers += 1
        if self.strangers <= STRANGERS_NAMED:
            more = "" if self.strangers < STRANGERS_NAMED else "; further strangers are not named"
            self._say(who[:64], f"is no member and is not heard{more}")

    def waiting_for(self) -> list[str]:
        """The members that the world waits for now, sorted."""
        if self.phase in (Phase.WAITING, Phase.READY):
            return [member.name for member in self.members.awaited()]
        if self.phase in (Phase.TICK, Phase.STOPPING):
            return sorted(self._pending)
        names = {name for name, _ in self._parts}
        if self._stranded:
            names.update(member.name for member in self.members.awaited())
        return sorted(names)

    def awaits(self, member: str) -> bool:
        """Whether a frame waits for an answer of a member, this one or the next."""
        if member in self._asked_ahead and member not in self._early:
            return True
        if self.phase in (Phase.TICK, Phase.STOPPING):
            return member in self._pending
        if self.phase in (Phase.WAITING, Phase.READY) or self._stranded:
            return member in self.waiting_for()
        return any(name == member for name, _ in self._parts)

    def awaits_tick(self, member: str) -> bool:
        """Whether steps 1 to 4 of this frame wait for a member, whose answer counts once."""
        return self.phase is Phase.TICK and member in self._pending

    @property
    def in_frame(self) -> bool:
        """Whether a frame is under way."""
        return self.phase in (Phase.TICK, Phase.EVOLVE)

    @property
    def at_rest(self) -> bool:
        """Whether the next frame would change nothing, nor show anything new.

        Nobody generates in step with it, no event waits, and every device has seen the string. A
        world of a number of frames goes through them all the same.
        """
        if self.world.frames or self.phase is not Phase.READY or self._rearrange:
            return False
        attending = self.members.index
        unseen = self.frame - self._stirred < attending.every
        busy = unseen or attending.tickers or attending.joining or self._fading
        return not (busy or self._inbox or self._emitted or self._sanctions)

    @property
    def _fading(self) -> bool:
        """Whether a frame without events changes the string: to the letter, it leaves no agent."""
        literal = self.world.policy is Policy.LITERAL
        return literal and self._distribution.homeless < self.composition.count

    @property
    def scene(self) -> Scene:
        """The string w of the frame that runs or comes next."""
        return self.composition.scene

    def feed(self, inputs: FrameInputs) -> list[s.Instruction]:
        """Compute a frame from its logged inputs, before any member has appeared.

        Raises ProtocolError if the inputs are not those of the next frame, or do not fit.
        """
        if inputs.frame != self.frame:
            raise ProtocolError(f"expected inputs of frame {self.frame}, got frame {inputs.frame}")
        self._out = []
        self._begin_frame_state()
        self._take_logged(inputs)
        self._gather(inputs.due)
        try:
            self.composition.lay_out(inputs.layout)
            self._layout = inputs.layout
            self._left_out = set(inputs.left_out)
            self._feed_replies(inputs)
            self._inbox = {source: list(events) for source, events in inputs.waiting.items()}
            self._apply()
        except Unfit as unfit:
            raise ProtocolError(f"inputs of frame {inputs.frame}: {unfit}") from None
        self._rearrange = True
        return self._out

    def _take_logged(self, inputs: FrameInputs) -> None:
        """Let the logged events of a frame wait, and hand people's orders to generators here."""
        self._logged = inputs
        self._inbox = {source: list(events) for source, events in inputs.taken.items()}
        self._ticked |= inputs.ticked
        self._people = inputs.people
        self._hand_over(tuple(self._inbox.pop(HANDED_OVER, ())))

    def _feed_replies(self, inputs: FrameInputs) -> None:
        """Merge the replies of hosts, one request after another, then apply norms."""
        replies = iter(inputs.replies)
        for count in inputs.answers:
            for reply in islice(replies, count):
                self._merge(reply, self._patched(reply))
            self._hear()
            self._asked_by = next(self._fewer, ()), ()

    @property
    def ordered(self) -> Mapping[str, Sequence[AnyEvent]]:
        """The events that no whole frame has, by source, if people's are among them."""
        taken: dict[str, Sequence[AnyEvent]] = {}
        if self.phase is Phase.EVOLVE:
            taken |= self._taken
        if self.in_frame and self._handed_over:
            taken[PEOPLE] = [*self._handed_over, *taken.get(PEOPLE, ())]
        taken.pop(HANDED_OVER, None)
        if PEOPLE not in taken and PEOPLE not in self._inbox:
            return {}
        sources = sorted({*taken, *self._inbox})
        return {one: [*taken.get(one, ()), *self._inbox.get(one, ())] for one in sources}

    def wait_with(self, events: Mapping[str, Sequence[AnyEvent]]) -> None:
        """These events, by source, wait for the frame that comes next."""
        self._inbox = {source: list(some) for source, some in events.items()}

    def expect(self, members: Iterable[str]) -> None:
        """Wait for these too before the world goes on."""
        for name in sorted(members):
            self.members.expect(name)

    @property
    def over(self) -> bool:
        """Whether the world has come to its own end."""
        return bool(self._why_over())

    # --- steps 1 and 2: the frame begins, and generators answer ---

    def _on_begin(self, told: s.Begin) -> None:
        if self.phase is not Phase.READY:
            return
        self._glances = told.due
        for member in self.members.index.joining:
            if member.hello is not None:
                self._admit(member, member.hello)
        self._begin_frame_state()
        self.phase = Phase.TICK
        attending = self.members.index
        self._ticked, self._early = self._early, {}
        if told.inputs is None:
            self._hand_over_orders()
        else:
            self._take_logged(told.inputs)
        self._pending = set(attending.tickers - self._ticked.keys())
        if attending.anyone_ticks:
            self._send(s.TICKED, m.TickRequest(self.frame))
        self._ask_ahead(self.frame)
        if not self._pending:
            self._collect()

    def _hand_over_orders(self) -> None:
        """Judge those orders that a generator takes, and give it what may be.

        They are people's; what the generator makes of them counts as its own.
        """
        given = [one for one in self._inbox.get(PEOPLE, ()) if self.members.takers(one.type)]
        if not given:
            return
        left = [one for one in self._inbox.pop(PEOPLE) if not self.members.takers(one.type)]
        self._inbox |= {PEOPLE: left} if left else {}
        self._hand_over(tuple(given))

    def _hand_over(self, orders: tuple[AnyEvent, ...]) -> None:
        self._handed_over = orders
        self._permitted = self._orders_allowed(orders)
        for member in self.members.active():
            self._give_orders(member)

    def _on_tick_reply(self, reply: m.TickReply) -> None:
        member = self.members.get(reply.member)
        in_time = self.awaits_tick(reply.member) and reply.frame == self.frame
        ahead = reply.frame == self._asked_ahead.get(reply.member, -1)
        early = ahead and not (self.in_frame and reply.frame == self.frame)
        if not member.active or not (in_time or early) or reply.member in self._early:
            member.late += 1
            return
        if not self._may_generate(member, reply.events):
            return
        self._answered(member)
        if early:
            self._early[reply.member] = reply
            return
        self._pending.discard(reply.member)
        self._ticked[reply.member] = reply
        if not self._pending:
            self._collect()

    def _answered(self, member: MemberEntry) -> None:
        member.last_reply = self.frame
        if member.state is MemberState.LATE:
            self.members.change(member, MemberChange.ANSWERED)

    def _may_generate(self, member: MemberEntry, events: tuple[AnyEvent, ...]) -> bool:
        allowed = member.hello.generates if member.hello is not None else ()
        for event in events:
            if event.type not in allowed:
                self._on_violation(
                    s.Violation(member.name, f"it sent {event.type} but said it makes {allowed}")
                )
                return False
        objection = self._speaking.objection(member.name, events)
        if objection:
            self._on_violation(s.Violation(member.name, objection))
        return not objection

    def _on_emitted(self, told: m.Emitted) -> None:
        member = self.members.get(told.member)
        if not member.active or not self._may_generate(member, told.events):
            return
        member.last_reply = self.frame
        count = sum(map(count_of, told.events))
        waiting = self._inbox.setdefault(told.member, [])
        held = self._held.get(told.member)
        if held is None:  # The first since the last frame, or since the world went on.
            held = sum(map(count_of, waiting))
        if held < MOST_WAITING:
            self._held[told.member] = held + count
            waiting.extend(told.events)
            return
        if not member.dropped:
            self._say(
                member.name, f"has {MOST_WAITING} events waiting for a frame; more are dropped"
            )
        member.dropped += count

    def _on_order(self, order: s.Order) -> None:
        self._inbox.setdefault(PEOPLE, []).append(order.event)

    def _on_drain(self, told: s.Drain) -> None:
        member = self.members.get(told.member)
        if member.active and not member.drained:
            member.drained = self._rearrange = True
            self._say(member.name, "is emptied: its agents go to other hosts")

    # --- steps 5 and 6: hosts answer ---

    def _on_evolve_reply(self, reply: m.EvolveReply) -> None:
        member = self.members.get(reply.member)
        key = (reply.member, reply.part)
        if reply.frame != self.frame or key not in self._parts or not member.active:
            member.late += 1
            return
        wrong, changed = self._wrong_with(reply, frozenset(self._parts[key])), dict[str, Scene]()
        try:
            changed = {} if wrong else self._patched(reply)
            for event_type, patches in reply.view_patches.items():
                showing = self._showings.get(event_type)
                check_all({} if showing is None else showing.parts, patches)
        except Unfit as unfit:
            wrong = f"it sent {unfit}, not of what is there"
        if wrong:
            self._on_violation(s.Violation(reply.member, wrong))
            return
        del self._parts[key]
        self._answered(member)
        if reply.elapsed and not reply.part:
            self._distribution.took(reply.member, reply.elapsed)
        self._merge(reply, changed)
        self._changed_by.update(dict.fromkeys(changed, reply.member))
        self._finish_if_done()

    def _merge(self, reply: m.EvolveReply, changed: m.Parts) -> None:
        """Let what a host has answered count, with what it says has `changed`."""
        self._replies.append(reply)
        self._changed.update(changed)
        self._sent.update(reply.emitted)
        for event_type, parts in reply.views.items():
            self._views.setdefault(event_type, {}).update(parts)
        for event_type, patches in reply.view_patches.items():
            self._view_patches.setdefault(event_type, {}).update(patches)

    def _patched(self, reply: m.EvolveReply) -> dict[str, Scene]:
        """What became of a host's fragments. Raises Unfit for patches of what is not there."""
        changed = {
            name: Scene((self.composition.fragments[name],))
            for name in reply.patched
            if name in self.composition.fragments
        }
        patch_all(changed, reply.patched)
        parts = self.composition.parts
        whole = {
            name: packed(scene) if name in parts else scene for name, scene in reply.changed.items()
        }
        return {**whole, **changed}

    def _wrong_with(self, reply: m.EvolveReply, mine: frozenset[str]) -> str:
        """What a host has no right to say, or the empty text."""
        named = set(reply.changed).union(reply.patched, *reply.views.values())
        for fragment in sorted(named.union(*reply.view_patches.values()) - mine):
            return f"it answered for #{fragment}, not its own"
        for name, events in sorted(reply.emitted.items()):
            part = self.composition.parts.get(name)
            if (name if part is not None else self.composition.home(name)) not in mine:
                return f"it sent events of #{name}, not its own"
            senders = self._names_of(name)
            if not all(_from(event, senders, part) for event in events):
                return f"it sent events of #{name} in another's name"
        born = dict(self._born)
        for fragment, scene in sorted(reply.changed.items()):
            for agent in agents(Scene(tuple(_loose(scene)))):
                if born.get(agent.id, self.composition.home(agent.id) or fragment) != fragment:
                    return f"it made a second agent #{agent.id}"
                born[agent.id] = fragment
        self._born = born
        return ""

    def _names_of(self, agent: str) -> frozenset[str]:
        """The ids under which an agent sends; under the literal policy its copies' too."""
        if self.world.policy is not Policy.LITERAL:
            return frozenset((agent,))
        copies = range(2, 1 + sum(map(count_of, self._evolving)))
        return frozenset((agent, *(copy_id(agent, self.frame, number) for number in copies)))

    # --- what may come at any time ---

    def _on_silent(self, _: s.Silent) -> None:
        if self.phase is Phase.STOPPING:
            self._miss_reports()
            return
        for name in self.waiting_for():
            self.members.change(self.members.get(name), MemberChange.SILENT)

    def _on_resync(self, told: m.Resync) -> None:
        showing = self._showings.get(told.event_type)
        if showing is not None and self.members.get(told.member).active:
            self._send(told.member, showing.key())

    def _on_failed(self, told: m.Failed) -> None:
        """Say it, once until it comes anew: one that has failed is about to end."""
        member = self.members.get(told.member)
        if not member.blamed:
            member.blamed = True
            when = f"failed in frame {told.frame}" if told.frame >= 0 else "failed"
            lines = told.problem.split("\n")[:REPORT_LINES]
            self._say(member.name, f"{when}: {chr(10).join(lines)}", told.traceback)

    def _on_doing(self, told: m.MemberMetrics) -> None:
        self.members.get(told.member).figures = told.figures

    def _on_report(self, report: m.Report) -> None:
        self._count_report(report.member, report.figures)

    def _on_end(self, told: s.End) -> None:
        if self.phase is Phase.ENDED:
            return
        self.failed = self.failed or told.failed
        if self.phase is Phase.STOPPING:
            self._over()
        else:
            self._end(told.reason)


def _from(event: AnyEvent, senders: Container[str], part: Columns | None) -> bool:
    """Whether events come from whom they are said to: one agent, or some of a part."""
    if part is None or part.ids is None:
        return isinstance(event, Event) and event.sender in senders
    if isinstance(event, Event):
        return part.ids.row_of(event.sender) >= 0
    return event.senders is not None and bool((part.ids.rows_of(event.senders) >= 0).all())


def _loose(scene: Scene) -> Iterator[Piece]:
    """The nodes of a string that are not in columns; those of columns are looked at together."""
    return (piece for piece in scene.pieces if not isinstance(piece, Columns))


__all__ = ["FrameAlgorithm", "Phase"]
