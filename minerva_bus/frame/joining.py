"""Members join and leave: between frames, or during a frame that waits for them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.compatibility import incompatibility
from minerva_bus.frame.member_states import MemberChange, MemberEntry, MemberState
from minerva_bus.frame.orders import refusal_of_guest
from minerva_bus.frame.phases import Phase

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm


MAX_DEATHS: Final = 2
"""Ends of a host in one frame after which the frame is tried without the events of guests."""


class MemberLifecycle:
    """Handles members that appear, join, vanish, leave, are given up or misbehave."""

    def __init__(self, algorithm: FrameAlgorithm) -> None:
        self._algorithm = algorithm

    # --- joining ---

    def appeared(self, appeared: s.Appeared) -> None:
        """Greet a new process, which may replace one that has not vanished yet."""
        algorithm = self._algorithm
        member = algorithm.members.get(appeared.member)
        if member.active:
            self._note_death(member)
            self._lose(member)
            algorithm.advance()
        member.blamed = False
        algorithm.members.change(member, MemberChange.APPEARED)
        if algorithm.phase in (Phase.STOPPING, Phase.ENDED):
            algorithm.out.send(member.name, m.Stop(algorithm.shutdown.reason))
        else:
            algorithm.out.send(member.name, m.Greet())

    def hello(self, hello: m.Hello) -> None:
        """Check a hello, and admit its member now or when the next frame begins."""
        algorithm = self._algorithm
        member = algorithm.members.get(hello.member)
        # Greetings are repeated, so a second hello of the same process may arrive; it counts once.
        if member.state is not MemberState.JOINING or member.greeted:
            return
        reason = incompatibility(hello, algorithm.world.vocabulary)
        reason = reason or refusal_of_guest(algorithm, hello, hello.generates)
        reason = reason or self._refusal_of_second_host(hello)
        if reason:
            self._refuse(member, reason)
            return
        algorithm.members.introduce(member, hello)
        between = algorithm.phase in (Phase.WAITING, Phase.READY)
        # A host that joins while the generators answer can evolve agents in this frame already.
        in_time = algorithm.phase is Phase.TICK and hello.kinds
        awaited = algorithm.awaits_answer(member.name) or algorithm.in_flight.requests.unassigned
        if between or in_time or awaited:
            self._admit(member, hello)
        algorithm.start_if_complete()

    def _refusal_of_second_host(self, hello: m.Hello) -> str:
        """Why a host of agents may not join another one, or an empty string."""
        policy, members = self._algorithm.world.policy, self._algorithm.members
        if not (policy.rules.makes_copies and hello.kinds):
            return ""
        others = (*members.awaited(), *members.active(), *members.index.joining)
        hosts = {each.name: each for each in others if each.hello is not None and each.hello.kinds}
        hosts.pop(hello.member, None)
        only = f'policy = "{policy.value}" evolves all agents on one host, which is'
        if self._algorithm.phase is Phase.WAITING and members.is_process(hello.member):
            # A guest may be faster than the world's own host, without which the world would end.
            for guest in [host for host in hosts.values() if not members.named(host)]:
                del hosts[guest.name]
                reason = f"{only} {hello.member} of the world file"
                self._exclude(guest, f"may not take part: {reason}", reason)
        return f"{only} {min(hosts)}: give it all classes of agents" if hosts else ""

    def _refuse(self, member: MemberEntry, reason: str) -> None:
        algorithm = self._algorithm
        self._blame(member, f"may not join: {reason}")
        algorithm.out.send(member.name, m.Refused(reason))
        # Otherwise the world would wait forever: a process of the world file
        # that is incompatible now stays incompatible. A missing guest is given up after a while.
        named = algorithm.members.named(member)
        if member.expected and named and algorithm.phase is Phase.WAITING:
            algorithm.fail(f"{member.name} cannot take part: {reason}")

    def admit_joining(self) -> None:
        """Admit the members that have joined during the last frame."""
        for member in self._algorithm.members.index.joining:
            if member.hello is not None:
                self._admit(member, member.hello)

    def _admit(self, member: MemberEntry, hello: m.Hello) -> None:
        algorithm, world = self._algorithm, self._algorithm.world
        # First, because the following code reads the active members.
        algorithm.members.change(member, MemberChange.ADMITTED)
        # A guest of the previous coordinator is expected until it returns. From here on it is a
        # guest like any other, which nothing restarts and for which the world does not wait.
        if not algorithm.members.named(member):
            algorithm.members.stop_expecting(member)
        # A newcomer has not shown the string, so the world is not at
        # rest even if nothing has changed.
        member.last_reply = algorithm.views.last_change = algorithm.frame
        saved = algorithm.members.saved.get(member.name)
        # The welcome is first, because a member ignores all messages that need a world before it.
        algorithm.out.send(
            member.name,
            m.Welcome(
                world.name, world.vocabulary, world.seed, world.dt, algorithm.frame,
                world.policy.value, saved,
            ),
        )  # fmt: skip
        # Rules may place agents near this member, whose machine is known only now.
        near = member.name in world.placement.neighbours
        algorithm.placement.outdated |= near or bool(hello.kinds)
        self._send_publishers(member)
        self._send_missed(member, hello)
        in_flight = algorithm.in_flight
        if algorithm.phase is Phase.TICK and member.name in in_flight.pending:
            algorithm.source.ask(member)
        if in_flight.requests.unassigned and hello.kinds:
            algorithm.source.ask_again(sorted(in_flight.requests.unassigned))
        algorithm.source.members_changed(hello)

    def _send_missed(self, member: MemberEntry, hello: m.Hello) -> None:
        """Send a newcomer the latest views, and request a repetition of the latest readings."""
        algorithm = self._algorithm
        for event_type in hello.draws:
            keyframe = algorithm.views.keyframe(event_type)
            if keyframe is not None:
                algorithm.out.send(member.name, keyframe)
        for topic in hello.topics:
            for publisher in algorithm.members.publishers.get(topic, ()):
                algorithm.out.send(publisher, m.Repeat(topic))

    def _send_publishers(self, newcomer: MemberEntry) -> None:
        """Send the publishers of sensor topics to all members, or unchanged to a newcomer."""
        members, out = self._algorithm.members, self._algorithm.out
        publishers = members.publishers_in_step()
        if publishers != members.publishers:
            members.publishers = publishers
            out.send(s.EVERYONE, m.Sources(publishers))
        else:
            out.send(newcomer.name, m.Sources(publishers))

    # --- leaving ---

    def vanished(self, vanished: s.Vanished) -> None:
        """Continue without a member, or wait for its return."""
        algorithm = self._algorithm
        member = algorithm.members.get(vanished.member)
        if member.state in (MemberState.LOST, MemberState.LEFT):
            return
        if algorithm.phase is Phase.STOPPING:
            # Its report is still awaited: the disappearance of the token may overtake it.
            algorithm.shutdown.depart(member.name)
        elif algorithm.phase is not Phase.ENDED:
            # The change precedes the log line, so that the offers are without this host. `_lose`
            # follows it, because the line is about the placement from before.
            algorithm.members.change(member, MemberChange.VANISHED)
            algorithm.out.log(member.name, f"is gone{self._outlook_without(member)}")
            self._note_death(member)
        self._lose(member)

    def _note_death(self, member: MemberEntry) -> None:
        requests = self._algorithm.in_flight.requests
        if self._algorithm.phase is Phase.EVOLVE and requests.of(member.name):
            requests.deaths[member.name] = requests.deaths.get(member.name, 0) + 1

    def _outlook_without(self, member: MemberEntry) -> str:
        """Text for the log: the consequences for the world while a member is gone."""
        algorithm, placement, hello = self._algorithm, self._algorithm.placement, member.hello
        waits = "; the world waits for it" if member.needed else ""
        if algorithm.phase is Phase.WAITING or hello is None or hello.ticks:
            return waits
        if not hello.kinds:
            return "; the world continues" if member.needed else ""
        if not placement.fragments_of(member.name):
            return "; no agents lived on it"
        if placement.may_take_over(member.name, algorithm.offers()):
            return "; other hosts take its agents over"
        return waits or "; no other host can take its agents over"

    def leaving(self, leaving: m.Leaving) -> None:
        """Continue without a member that leaves voluntarily."""
        algorithm = self._algorithm
        member = algorithm.members.get(leaving.member)
        if member.state is not MemberState.LEFT:
            algorithm.members.change(member, MemberChange.WENT)
            algorithm.out.log(member.name, "has left")
            self._continue_without(member)
            algorithm.shutdown.report(member.name, {})  # It sends no report.
        algorithm.start_if_complete()

    def gave_up(self, gave_up: s.Abandoned) -> None:
        """Continue without a member that will not be restarted."""
        algorithm = self._algorithm
        member = algorithm.members.get(gave_up.member)
        algorithm.members.stop_expecting(member)
        over = algorithm.phase in (Phase.STOPPING, Phase.ENDED)
        if algorithm.members.change(member, MemberChange.GAVE_UP) and not over:
            algorithm.out.log(member.name, "is not restarted; the world continues without it")
            self._continue_without(member)
        algorithm.start_if_complete()

    def skip(self, skip: s.Skip) -> None:
        """Stop waiting for a member in this frame; a later reply is late."""
        algorithm = self._algorithm
        in_flight, requests = algorithm.in_flight, algorithm.in_flight.requests
        member = algorithm.members.get(skip.member)
        outstanding = requests.of(member.name)
        unassigned = bool(requests.unassigned) and member.awaited
        if not (algorithm.awaits_tick(member.name) or outstanding or unassigned):
            return
        algorithm.out.log(
            member.name, f"timed out in frame {algorithm.frame}; skipped for this frame"
        )
        if algorithm.phase is Phase.TICK:
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
        algorithm.placement.forget(member.name)
        algorithm.placement.outdated = True

    def violation(self, violation: s.Violation) -> None:
        """Exclude a member that violated the protocol."""
        algorithm = self._algorithm
        member = algorithm.members.get(violation.member)
        self._exclude(member, f"broke the protocol: {violation.reason}", violation.reason)

    def _exclude(self, member: MemberEntry, text: str, reason: str) -> None:
        self._blame(member, text)
        self._algorithm.out.send(member.name, m.Refused(reason))
        if member.active:
            self._lose(member)

    def _blame(self, member: MemberEntry, text: str) -> None:
        # An excluded member can misbehave any number of times, so only its first violation is
        # logged until a new process of this name appears.
        if member.active or not member.blamed:
            self._algorithm.out.log(member.name, text)
        member.blamed = True

    def _lose(self, member: MemberEntry) -> None:
        self._algorithm.members.change(member, MemberChange.VANISHED)
        if member.expected:
            self._reassign(member)
        else:
            self._algorithm.members.change(member, MemberChange.GAVE_UP)
            self._continue_without(member)

    def _continue_without(self, member: MemberEntry) -> None:
        algorithm = self._algorithm
        neighbour = member.name in algorithm.world.placement.neighbours
        algorithm.placement.outdated |= neighbour
        self._send_publishers(member)
        if algorithm.phase is Phase.TICK and member.name in algorithm.in_flight.pending:
            algorithm.in_flight.pending.discard(member.name)
        else:
            self._reassign(member)
        algorithm.source.members_changed(None)

    def _reassign(self, member: MemberEntry) -> None:
        """Reassign the fragments of a host that is gone, wait for it, or leave them out."""
        algorithm, in_flight = self._algorithm, self._algorithm.in_flight
        algorithm.placement.forget(member.name)
        algorithm.placement.outdated = True
        result, requests = in_flight.result, in_flight.requests
        # Its replies still count, but it no longer holds what it reported, so the
        # next host must receive the result.
        result.changed_by = {n: by for n, by in result.changed_by.items() if by != member.name}
        on_orders = member.hello is not None and member.hello.is_on_orders
        asked = member.name in in_flight.ticked or on_orders
        if algorithm.phase is Phase.TICK and member.awaited and asked:
            # Other members may still need the readings that it published in this frame. Its
            # successor continues from before the frame and publishes them again. Without a member
            # that takes orders, those that have arrived meanwhile would count as they are.
            in_flight.ticked.pop(member.name, None)
            in_flight.pending.add(member.name)
        if algorithm.phase not in (Phase.EVOLVE, Phase.CLOSING):
            return
        if requests.deaths.get(member.name, 0) >= MAX_DEATHS:
            requests.deaths[member.name] = 0
            if algorithm.source.lighten(member.name):
                return
        lost = [name for key in requests.of(member.name) for name in requests.outstanding.pop(key)]
        algorithm.source.ask_again(sorted({*lost, *requests.unassigned}))
