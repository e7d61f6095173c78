"""Members that appear, join, vanish, leave, are given up or misbehave, while frames go on.

`Shutdown` has the reports of members at the end of the world. What a frame does with the changes is
its course: `FrameCourse`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Protocol

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member_table import (
    MemberChange,
    MemberEntry,
    Members,
    MemberState,
    incompatibility,
)
from minerva_bus.frame.messages import Figures
from minerva_bus.frame.placement import Placement
from minerva_bus.frame.sender_rights import OrderRules
from minerva_bus.frame.stimuli import Instructions
from minerva_bus.frame.view_streams import Views
from minerva_bus.frame.world_state import InputSteps, OutcomeSteps, Phase, Progress, WorldSpec

MAX_DEATHS: Final = 2
"""Ends of a host in one frame after which the frame is tried without the events of guests."""


class FrameCourse(Protocol):
    """The frames of the world, which members that come and go let advance."""

    def advance(self) -> None:
        """Execute Table 2 as far as the answers received so far allow."""
        ...

    def start_if_complete(self) -> None:
        """Begin once all expected members are present."""
        ...

    def members_changed(self, hello: m.Hello | None) -> None:
        """Note that a member has joined, with its hello, or has left."""
        ...

    def fail(self, reason: str) -> None:
        """End the world because of an error."""
        ...


class Shutdown:
    """The reason for the end of the world, and the reports of its members.

    `failed`: it ends prematurely because of an error. `pending`: members that have
    not reported yet. `figures`: what each member has reported.
    """

    def __init__(self) -> None:
        self.reason = ""
        self.failed = False
        self.pending: set[str] = set()
        self.figures: dict[str, Figures] = {}
        self._departed: dict[str, bool] = {}

    def begin(self, members: Iterable[str]) -> None:
        """Wait for the reports of these members."""
        self.pending = set(members)

    def report(self, report: m.Report) -> None:
        """Note a member's report; empty figures mean that it can no longer report."""
        if report.member in self.pending:  # A member that was dropped does not count.
            self.pending.discard(report.member)
            self.figures[report.member] = report.figures

    def depart(self, member: str) -> None:
        """Note that a member is gone; its report may still arrive."""
        self._departed.setdefault(member, False)

    def drop_departed(self) -> None:
        """Stop waiting for members that were already gone at the last call of this method.

        A token's departure may overtake the last message, so they get one more interval.
        """
        for member, missed in sorted(self._departed.items()):
            self._departed[member] = True
            if missed:
                self.report(m.Report(member, {}))

    def add_figures(self, source: str, figures: Figures) -> None:
        """Add figures that no member reported."""
        self.figures[source] = figures

    def total(self) -> Figures:
        """The figures of all members; numbers of the same name are added."""
        total: dict[str, bool | int | float | str] = {}
        # Sorted, because floating-point sums and the texts that remain depend on the order.
        for _, figures in sorted(self.figures.items()):
            for name, value in figures.items():
                old = total.get(name)
                both = isinstance(old, int | float) and isinstance(value, int | float)
                total[name] = old + value if both and old is not None else value  # pyright: ignore
        return total


class MemberLifecycle:
    """Handles members that appear, join, vanish, leave, are given up or misbehave."""

    def __init__(
        self,
        world: WorldSpec,
        now: Progress,
        members: Members,
        placement: Placement,
        views: Views,
        out: Instructions,
        inputs: InputSteps,
        outcome: OutcomeSteps,
        orders: OrderRules,
        course: FrameCourse,
    ) -> None:
        self._world = world
        self._now = now
        self._members = members
        self._placement = placement
        self._views = views
        self.shutdown = Shutdown()
        self._out = out
        self._inputs = inputs
        self._outcome = outcome
        self._orders = orders
        self._course = course

    # --- joining ---

    def appeared(self, appeared: s.Appeared) -> None:
        """Greet a new process, which may replace one that has not vanished yet."""
        member = self._members.get(appeared.member)
        if member.active:
            self._note_death(member)
            self._lose(member)
            # The frame may have waited for it alone; its successor joins after what follows.
            self._course.advance()
        member.blamed = False
        self._members.change(member, MemberChange.APPEARED)
        if self._now.phase in (Phase.STOPPING, Phase.ENDED):
            self._out.send(member.name, m.Stop(self.shutdown.reason))
        else:
            self._out.send(member.name, m.Greet())

    def hello(self, hello: m.Hello) -> None:
        """Check a hello, and admit its member now or when the next frame begins."""
        member = self._members.get(hello.member)
        # Greetings are repeated, so a second hello of the same process may arrive; it counts once.
        if member.state is not MemberState.JOINING or member.greeted:
            return
        if reason := self._why_not(hello):
            self._refuse(member, reason)
            return
        self._members.introduce(member, hello)
        between = self._now.phase in (Phase.WAITING, Phase.READY)
        # A host that joins while the generators answer can evolve agents in this frame already.
        in_time = self._now.phase is Phase.TICK and hello.kinds
        in_flight = self._now.in_flight
        answers = member.name in in_flight.pending or member.name in self.shutdown.pending
        awaited = answers or in_flight.requests.unassigned
        if between or in_time or awaited:
            self._admit(member, hello)
        self._course.start_if_complete()

    def _why_not(self, hello: m.Hello) -> str:
        """Why a member may not join, or an empty string."""
        if hello.member in {*self._world.shares.values()} - self._world.expected:
            return "processes of the world divide the generator of this name; use another one"
        reason = incompatibility(hello, self._world.vocabulary)
        if not (reason or self._members.is_process(hello.member)):
            reason = self._orders.refusal_of_guest(hello, hello.generates)
        return reason or self._settle_single_host(hello)

    def _settle_single_host(self, hello: m.Hello) -> str:
        """Exclude guests before the world's own host; why this host may not join, or empty."""
        policy, members = self._world.policy, self._members
        if not (policy.rules.makes_copies and hello.kinds):
            return ""
        others = (*members.index.awaited, *members.index.active, *members.index.joining)
        hosts = {each.name: each for each in others if each.hello is not None and each.hello.kinds}
        hosts.pop(hello.member, None)
        only = f'policy = "{policy.value}" evolves all agents on one host, which is'
        if self._now.phase is Phase.WAITING and members.is_process(hello.member):
            # A guest may be faster than the world's own host, without which the world would end.
            for guest in [host for host in hosts.values() if not members.is_process(host.name)]:
                del hosts[guest.name]
                reason = f"{only} {hello.member} of the world file"
                self._exclude(guest, f"may not take part: {reason}", reason)
        return f"{only} {min(hosts)}: give it all classes of agents" if hosts else ""

    def _refuse(self, member: MemberEntry, reason: str) -> None:
        self._blame(member, f"may not join: {reason}")
        self._out.send(member.name, m.Refused(reason))
        # Otherwise the world would wait forever: a process of the world file
        # that is incompatible now stays incompatible. A missing guest is given up after a while.
        named = self._members.is_process(member.name)
        if member.expected and named and self._now.phase is Phase.WAITING:
            self._course.fail(f"{member.name} cannot take part: {reason}")

    def admit_joining(self) -> None:
        """Admit the members that have joined during the last frame."""
        for member in self._members.index.joining:
            if member.hello is not None:
                self._admit(member, member.hello)

    def _admit(self, member: MemberEntry, hello: m.Hello) -> None:
        world = self._world
        # First, because the following code reads the active members.
        self._members.change(member, MemberChange.ADMITTED)
        # A guest of the previous coordinator is expected until it returns. From here on it is a
        # guest like any other, which nothing restarts and for which the world does not wait.
        if not self._members.is_process(member.name):
            self._members.stop_expecting(member)
        # A newcomer has not shown the string, so the world is not at
        # rest even if nothing has changed.
        member.last_reply = self._views.last_change = self._now.frame
        saved = self._members.saved.get(member.name)
        # The welcome is first, because a member ignores all messages that need a world before it.
        self._out.send(
            member.name,
            m.Welcome(
                world.name, world.vocabulary, world.seed, world.dt, self._now.frame,
                world.policy.value, saved,
            ),
        )  # fmt: skip
        # Rules may place agents near this member, whose machine is known only now.
        near = member.name in world.placement.neighbours
        self._placement.outdated |= near or bool(hello.kinds)
        self._send_publishers(member)
        self._send_missed(member, hello)
        in_flight = self._now.in_flight
        if self._now.phase is Phase.TICK and member.name in in_flight.pending:
            self._inputs.ask(member)
        if in_flight.requests.unassigned and hello.kinds:
            self._outcome.ask_again(sorted(in_flight.requests.unassigned))
        self._course.members_changed(hello)

    def _send_missed(self, member: MemberEntry, hello: m.Hello) -> None:
        """Send a newcomer the latest views, and request a repetition of the latest readings."""
        for event_type in hello.draws:
            keyframe = self._views.keyframe(event_type)
            if keyframe is not None:
                self._out.send(member.name, keyframe)
        for topic in hello.topics:
            for publisher in self._members.publishers.get(topic, ()):
                self._out.send(publisher, m.Repeat(topic))

    def _send_publishers(self, newcomer: MemberEntry) -> None:
        """Send the publishers of sensor topics to all members, or unchanged to a newcomer."""
        members, out = self._members, self._out
        publishers = members.publishers_in_step()
        if publishers != members.publishers:
            members.publishers = publishers
            out.send(s.EVERYONE, m.Sources(publishers))
        else:
            out.send(newcomer.name, m.Sources(publishers))

    # --- leaving ---

    def vanished(self, vanished: s.Vanished) -> None:
        """Continue without a member, or wait for its return."""
        member = self._members.get(vanished.member)
        if member.state in (MemberState.LOST, MemberState.LEFT):
            return
        if self._now.phase is Phase.STOPPING:
            # Its report is still awaited: the disappearance of the token may overtake it.
            self.shutdown.depart(member.name)
        elif self._now.phase is not Phase.ENDED:
            # The change precedes the log line, so that the offers are without this host. `_lose`
            # follows it, because the line is about the placement from before.
            self._members.change(member, MemberChange.VANISHED)
            self._out.log(member.name, f"is gone{self._outlook_without(member)}")
            self._note_death(member)
        self._lose(member)

    def _note_death(self, member: MemberEntry) -> None:
        requests = self._now.in_flight.requests
        if self._now.phase is Phase.EVOLVE and requests.of(member.name):
            requests.deaths[member.name] = requests.deaths.get(member.name, 0) + 1

    def _outlook_without(self, member: MemberEntry) -> str:
        """Text for the log: the consequences for the world while a member is gone."""
        placement, hello = self._placement, member.hello
        waits = "; the world waits for it" if member.needed else ""
        if self._now.phase is Phase.WAITING or hello is None or hello.ticks:
            return waits
        if not hello.kinds:
            return "; the world continues" if member.needed else ""
        if not placement.fragments_of(member.name):
            return "; no agents lived on it"
        offers = self._members.allowed_offers(self._world.placement)
        if placement.may_take_over(member.name, offers):
            return "; other hosts take its agents over"
        return waits or "; no other host can take its agents over"

    def leaving(self, leaving: m.Leaving) -> None:
        """Continue without a member that leaves voluntarily."""
        member = self._members.get(leaving.member)
        if member.state is not MemberState.LEFT:
            self._members.change(member, MemberChange.WENT)
            self._out.log(member.name, "has left")
            self._continue_without(member)
            self.shutdown.report(m.Report(member.name, {}))  # It sends no report.
        self._course.start_if_complete()

    def gave_up(self, gave_up: s.Abandoned) -> None:
        """Continue without a member that will not be restarted."""
        member = self._members.get(gave_up.member)
        self._members.stop_expecting(member)
        over = self._now.phase in (Phase.STOPPING, Phase.ENDED)
        if self._members.change(member, MemberChange.GAVE_UP) and not over:
            self._out.log(member.name, "is not restarted; the world continues without it")
            self._continue_without(member)
        self._course.start_if_complete()

    def skip(self, skip: s.Skip) -> None:
        """Stop waiting for a member in this frame; a later reply is late."""
        in_flight, requests = self._now.in_flight, self._now.in_flight.requests
        member = self._members.get(skip.member)
        outstanding = requests.of(member.name)
        unassigned = bool(requests.unassigned) and member.awaited
        if not (member.name in in_flight.pending or outstanding or unassigned):
            return
        self._out.log(member.name, f"timed out in frame {self._now.frame}; skipped for this frame")
        if self._now.phase is Phase.TICK:
            member.rests = False
            in_flight.pending.discard(member.name)
            return
        for key in outstanding:
            requests.left_out.update(requests.outstanding.pop(key))
        if unassigned:
            requests.left_out |= requests.unassigned
            requests.unassigned = set()
        # The host may still evolve its fragments, and its late reply is dropped. Their state there
        # is unknown, and it receives its fragments again.
        self._placement.forget(member.name)
        self._placement.outdated = True

    def violation(self, violation: s.Violation) -> None:
        """Exclude a member that violated the protocol."""
        member = self._members.get(violation.member)
        self._exclude(member, f"broke the protocol: {violation.reason}", violation.reason)

    def _exclude(self, member: MemberEntry, text: str, reason: str) -> None:
        self._blame(member, text)
        self._out.send(member.name, m.Refused(reason))
        if member.active:
            self._lose(member)

    def _blame(self, member: MemberEntry, text: str) -> None:
        # An excluded member can misbehave any number of times, so only its first violation is
        # logged until a new process of this name appears.
        if member.active or not member.blamed:
            self._out.log(member.name, text)
        member.blamed = True

    def _lose(self, member: MemberEntry) -> None:
        self._members.change(member, MemberChange.VANISHED)
        if member.expected:
            self._reassign(member)
        else:
            self._members.change(member, MemberChange.GAVE_UP)
            self._continue_without(member)

    def _continue_without(self, member: MemberEntry) -> None:
        neighbour = member.name in self._world.placement.neighbours
        self._placement.outdated |= neighbour
        self._send_publishers(member)
        if self._now.phase is Phase.TICK and member.name in self._now.in_flight.pending:
            self._now.in_flight.pending.discard(member.name)
        else:
            self._reassign(member)
        self._course.members_changed(None)

    def _reassign(self, member: MemberEntry) -> None:
        """Reassign the fragments of a host that is gone, wait for it, or leave them out."""
        in_flight = self._now.in_flight
        self._placement.forget(member.name)
        self._placement.outdated = True
        result, requests = in_flight.result, in_flight.requests
        # Its replies still count, but it no longer holds what it reported, so the
        # next host must receive the result.
        result.changed_by = {n: by for n, by in result.changed_by.items() if by != member.name}
        on_orders = member.hello is not None and member.hello.is_on_orders
        asked = member.name in in_flight.ticked or on_orders
        if self._now.phase is Phase.TICK and member.awaited and asked:
            # Other members may still need the readings that it published in this frame. Its
            # successor continues from before the frame and publishes them again. Without a member
            # that takes orders, those that have arrived meanwhile would count as they are.
            in_flight.ticked.pop(member.name, None)
            in_flight.pending.add(member.name)
        if self._now.phase not in (Phase.EVOLVE, Phase.CLOSING):
            return
        if requests.deaths.get(member.name, 0) >= MAX_DEATHS:
            requests.deaths[member.name] = 0
            if self._outcome.lighten(member.name):
                return
        lost = [name for key in requests.of(member.name) for name in requests.outstanding.pop(key)]
        self._outcome.ask_again(sorted({*lost, *requests.unassigned}))
