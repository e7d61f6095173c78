"""Members come and go: at a frame's edge, or in its midst where the frame waits for them."""

from __future__ import annotations

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.compatibility import incompatibility
from minerva_bus.frame.core import Phase
from minerva_bus.frame.members import MemberChange, MemberEntry, MemberState
from minerva_bus.frame.steps import Steps


class Attendance(Steps):
    """Who takes part, and who takes over from whom."""

    def _on_appeared(self, told: s.Appeared) -> None:
        member = self.members.get(told.member)
        if member.active:
            self._lose(member)
        member.blamed = False
        self.members.change(member, MemberChange.APPEARED)
        if self.phase in (Phase.STOPPING, Phase.ENDED):
            self._send(member.name, m.Stop(self._reason))
        else:
            self._send(member.name, m.Greet())

    def _on_hello(self, hello: m.Hello) -> None:
        member = self.members.get(hello.member)
        if member.state is not MemberState.JOINING or member.greeted:
            return
        reason = incompatibility(hello, self.world.vocabulary)
        if reason:
            self._blame(member, f"may not join: {reason}")
            self._send(member.name, m.Refused(reason))
            if member.expected and self.phase is Phase.WAITING:
                self._fail(f"{member.name} cannot take part: {reason}")
            return
        self.members.introduce(member, hello)
        between = self.phase in (Phase.WAITING, Phase.READY)
        in_time = self.phase is Phase.TICK and hello.kinds
        if between or in_time or member.name in self._pending or self._stranded:
            self._admit(member, hello)
        if self.phase is Phase.WAITING:
            self._ready_if_all_here()

    def _ready_if_all_here(self) -> None:
        if self.members.awaited():
            return
        if self.frame and self._why_over():  # A coordinator before this one did not come to that.
            self._end_or_go_on()
            return
        self.phase = Phase.READY
        self._out.append(s.Ready(self.frame))

    def _admit(self, member: MemberEntry, hello: m.Hello) -> None:
        self.members.change(member, MemberChange.ADMITTED)
        member.last_reply = self._stirred = self.frame
        world, saved = self.world, self._saved.get(member.name)
        self._send(
            member.name,
            m.Welcome(
                world.name, world.vocabulary, world.seed, world.dt, self.frame,
                world.policy.value, saved,
            ),
        )  # fmt: skip
        near = member.name in world.placement.neighbours
        self._rearrange = self._rearrange or near or bool(hello.kinds)
        self._tell_sources(member)
        for event_type in hello.draws:
            showing = self._showings.get(event_type)
            if showing is not None:
                self._send(member.name, showing.key())
        for topic in hello.topics:
            for publisher in self._sources.get(topic, ()):
                self._send(publisher, m.Repeat(topic))
        if self.phase is Phase.TICK and member.name in self._pending:
            self._give_orders(member)
            self._send(member.name, m.TickRequest(self.frame))
        if self._stranded and hello.kinds:
            self._ask_again(sorted(self._stranded))

    def _give_orders(self, member: MemberEntry) -> None:
        """Tell a generator what people order in this frame of the types that it takes."""
        taken = member.hello.orders if member.hello is not None else ()
        orders = tuple([one for one in self._permitted if one.type in taken])
        if orders:
            after = self._asked_ahead.get(member.name, -1) + 1
            self._send(member.name, m.Orders(max(self.frame, after), orders))

    def _tell_sources(self, newcomer: MemberEntry) -> None:
        sources = self.members.lockstep_publishers()
        if sources != self._sources:
            self._sources = sources
            self._send(s.EVERYONE, m.Sources(sources))
        else:
            self._send(newcomer.name, m.Sources(sources))

    def _on_vanished(self, told: s.Vanished) -> None:
        member = self.members.get(told.member)
        if member.state in (MemberState.LOST, MemberState.LEFT):
            return
        if self.phase is Phase.STOPPING:
            self._departed.setdefault(member.name, False)
        elif self.phase is not Phase.ENDED:
            self.members.change(member, MemberChange.VANISHED)
            self._say(member.name, f"is gone{self._outlook_without(member)}")
        self._lose(member)

    def _outlook_without(self, member: MemberEntry) -> str:
        """What becomes of a world without a member that is gone, as it is said."""
        waits = "; the world waits for it" if member.needed else ""
        hello, distribution = member.hello, self._distribution
        if self.phase is Phase.WAITING or hello is None or hello.ticks:
            return waits
        if not hello.kinds:
            return "; the world goes on" if member.needed else ""
        if not distribution.fragments_of(member.name):
            return "; no agents lived on it"
        if distribution.may_take_over(member.name, self.offers()):
            return "; other hosts take its agents over"
        return waits or "; no other host can take its agents over"

    def _on_leaving(self, told: m.Leaving) -> None:
        member = self.members.get(told.member)
        if member.state is not MemberState.LEFT:
            self.members.change(member, MemberChange.WENT)
            self._say(member.name, "has left")
            self._go_on_without(member)
            self._count_report(member.name, {})  # if it has not said it yet, it never will
        if self.phase is Phase.WAITING:
            self._ready_if_all_here()

    def _on_gave_up(self, told: s.Abandoned) -> None:
        member = self.members.get(told.member)
        self.members.stop_expecting(member)
        over = self.phase in (Phase.STOPPING, Phase.ENDED)
        if self.members.change(member, MemberChange.GAVE_UP) and not over:
            self._say(member.name, "will not come back; the world goes on without it")
            self._go_on_without(member)
        if self.phase is Phase.WAITING:
            self._ready_if_all_here()

    def _on_skip(self, told: s.Skip) -> None:
        """Wait no longer for an answer in this frame; it will be late, whenever it comes."""
        member = self.members.get(told.member)
        parts = [key for key in self._parts if key[0] == member.name]
        stranded = bool(self._stranded) and member.awaited
        if not (parts or stranded or (self.phase is Phase.TICK and member.name in self._pending)):
            return
        self._say(member.name, f"is left out of frame {self.frame}")
        if self.phase is Phase.TICK:
            self._pending.discard(member.name)
            if not self._pending:
                self._collect()
            return
        for key in parts:
            self._left_out.update(self._parts.pop(key))
        if stranded:
            self._left_out |= self._stranded
            self._stranded = set()
        self._distribution.forget(member.name)
        self._rearrange = True
        self._finish_if_done()

    def _on_violation(self, told: s.Violation) -> None:
        member = self.members.get(told.member)
        self._blame(member, f"broke the protocol: {told.reason}")
        self._send(member.name, m.Refused(told.reason))
        if member.active:
            self._lose(member)

    def _blame(self, member: MemberEntry, text: str) -> None:
        """Say what it has done wrong; of one that is out already, once until it comes anew.

        It may go on with that as often as it likes.
        """
        if member.active or not member.blamed:
            self._say(member.name, text)
        member.blamed = True

    def _lose(self, member: MemberEntry) -> None:
        self.members.change(member, MemberChange.VANISHED)
        if member.expected:
            self._reassign(member)
        else:
            self.members.change(member, MemberChange.GAVE_UP)
            self._go_on_without(member)

    def _go_on_without(self, member: MemberEntry) -> None:
        self._rearrange |= member.name in self.world.placement.neighbours
        self._tell_sources(member)
        self._forget_early(member)
        if self.phase is Phase.TICK and member.name in self._pending:
            self._pending.discard(member.name)
            if not self._pending:
                self._collect()
        else:
            self._reassign(member)

    def _forget_early(self, member: MemberEntry) -> None:
        """What it was asked ahead it will be asked again."""
        self._early.pop(member.name, None)
        self._asked_ahead.pop(member.name, None)

    def _reassign(self, member: MemberEntry) -> None:
        """Give the fragments of a host that is gone to others, or wait, or let them stand still."""
        self._distribution.forget(member.name)
        self._forget_early(member)
        self._changed_by = {one: by for one, by in self._changed_by.items() if by != member.name}
        self._rearrange = True
        if self.phase is Phase.TICK and member.awaited and member.name in self._ticked:
            # Others may still need what it published in this frame: its successor, which goes on
            # from before the frame, is asked for all of it again.
            del self._ticked[member.name]
            self._pending.add(member.name)
        if self.phase not in (Phase.EVOLVE, Phase.CLOSING):
            return
        lost = [key for key in self._parts if key[0] == member.name]
        orphans = {one for key in lost for one in self._parts.pop(key)} | self._stranded
        self._ask_again(sorted(orphans))
