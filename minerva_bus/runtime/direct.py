"""The direct transport: all members in this process, messages handed over as objects."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeAlias

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member import Member
from minerva_bus.frame.pace import Overruns
from minerva_bus.runtime.runner import Notice, Runner, Sink

Deliver: TypeAlias = Callable[
    [Member, m.ToMember | m.Readings], Iterable[m.FromMember | m.Readings]
]


def receivers(to: str, members: Iterable[Member]) -> list[Member]:
    """Those of `members` that receive a message for `to`, in the order of their names."""
    ordered = sorted(members, key=lambda member: member.name)
    if to == s.TICKED:
        return [member for member in ordered if member.hello().ticks_with_all]
    if to == s.HOSTS:
        return [member for member in ordered if member.host.kinds]
    return [member for member in ordered if to in (s.EVERYONE, member.name)]


def observers(event_type: str, members: Iterable[Member]) -> list[Member]:
    """Members that draw the views of an event type outside of the frames, ordered by name."""
    ordered = sorted(members, key=lambda member: member.name)
    hellos = [(member, member.hello()) for member in ordered]
    return [member for member, h in hellos if event_type in h.draws and not h.coupled]


def deliver(
    member: Member, message: m.ToMember | m.Readings
) -> Iterable[m.FromMember | m.Readings]:
    """Let a member process a message and draw; returns its answers."""
    answers = member.receive(message)
    # On the bus an observer draws when its inbox is empty, which it always is here.
    member.show()
    return answers


def timed(overruns: Overruns, clock: Callable[[], float]) -> Deliver:
    """As `deliver`; notes how long each member runs in frames with a given duration."""

    def deliver_timed(
        member: Member, message: m.ToMember | m.Readings
    ) -> Iterable[m.FromMember | m.Readings]:
        if not overruns.measures:
            return deliver(member, message)
        began = clock()
        answers = deliver(member, message)
        overruns.took(member.name, clock() - began)
        return answers

    return deliver_timed


class DirectTransport:
    """Delivers messages by calling the members, which are in this process.

    `running` is the member whose code runs, or ran last. `on_readings` is called with everything
    published on sensor topics. `deliver` replaces the function that passes one message to one
    member, for tests and benchmarks.
    """

    def __init__(
        self,
        members: Iterable[Member],
        on_readings: Callable[[m.Readings], None] | None = None,
        deliver: Deliver = deliver,
    ) -> None:
        self.members = {member.name: member for member in members}
        self.running: Member | None = None
        self._on_readings = on_readings
        self._deliver = deliver
        # A hello is costly to make, and the messages that a member receives do not change.
        self._receivers: dict[str, list[Member]] = {}
        self._observers: dict[str, list[Member]] = {}

    def add(self, member: Member) -> None:
        """Add a member, or replace the one of the same name."""
        self.members[member.name] = member
        self._receivers.clear()
        self._observers.clear()

    def send(self, to: str, message: m.ToMember) -> Iterator[s.Stimulus]:
        """Deliver a message; yields the answers one by one, as the members give them."""
        group = self._receivers.get(to)
        if group is None:
            group = self._receivers[to] = receivers(to, self.members.values())
        return self._deliver_to(group, message)

    def show(self, event_type: str, message: m.ToMember, to: str) -> Iterator[s.Stimulus]:
        """Deliver a view to its observers."""
        group = self._observers.get(event_type)
        if group is None:
            group = self._observers[event_type] = observers(event_type, self.members.values())
        return self._deliver_to(group, message)

    def publish(self, readings: m.Readings) -> Iterator[s.Stimulus]:
        """Deliver a publisher's readings to the members that subscribe to their topic."""
        if self._on_readings is not None:
            self._on_readings(readings)
        subscribed = [member for member in self.members.values() if readings.topic in member.topics]
        return self._deliver_to(subscribed, readings)

    def _deliver_to(
        self, members: Iterable[Member], message: m.ToMember | m.Readings
    ) -> Iterator[s.Stimulus]:
        for member in members:
            # Set before the call, so that an error in the member's code can be attributed to it.
            self.running = member
            for answer in self._deliver(member, message):
                if isinstance(answer, m.Readings):
                    yield from self.publish(answer)
                else:
                    yield answer


class InProcessRunner(Runner):
    """A runner whose members are all in this process."""

    def __init__(
        self,
        algorithm: FrameAlgorithm,
        members: Iterable[Member],
        *sinks: Sink | Callable[[Notice], None],
        on_readings: Callable[[m.Readings], None] | None = None,
        deliver: Deliver = deliver,
    ) -> None:
        self.direct = DirectTransport(members, on_readings, deliver)
        super().__init__(algorithm, self.direct, sinks)

    def start(self) -> None:
        """Let all members join, in the order of their names."""
        for name in sorted(self.direct.members):
            self.handle(s.Appeared(name))

    def publish(self, readings: m.Readings) -> None:
        """Deliver the readings of a free-running publisher."""
        for stimulus in self.direct.publish(readings):
            self.handle(stimulus)
