"""Services that are attached to one region: they get the views of all regions, and answer for all.

Other generators have a copy in each region, which makes the same events. A device needs the whole
view of the string, and a service with sensor topics may depend on one, so these exist once, in the
region `HOME`:

    frame t      each region sends its views of w_t to HOME, in its parcel
    frame t + 1  HOME assembles them, shows them, and sends the events of its services to all
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Final

from minerva_bus.errors import ProtocolError
from minerva_bus.frame import messages as m
from minerva_bus.frame.member import Member
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.regions.halo_services import exchange
from minerva_bus.regions.nearby import NearbyServices
from minerva_bus.regions.replies import Answer, Replies, received
from minerva_bus.regions.views import ViewAssembly, ViewPart
from minerva_bus.world.services import Device, Generator, Service

if TYPE_CHECKING:
    from minerva_bus.regions.parcel import Parcel

HOME: Final = 0
"""The region of attached services, and of units without agents."""


def is_attached(service: Service | None) -> bool:
    """Whether a service exists in one region only."""
    if service is None:
        return False
    is_free = isinstance(service, Generator) and not service.lockstep
    return isinstance(service, Device) or is_free or bool(service.topics or service.publishes)


def beside(services: Mapping[str, Service | None]) -> frozenset[str]:
    """The services of a world, by name, for which no frame waits: members of its coordinator.

    They show views of the whole, or generate events for the frames that begin next. Those that
    exchange sensor topics with a service in a region are not among them, because topics do not
    leave it.
    """
    free = {name: each for name, each in services.items() if each and not _is_in_step(each)}
    inside = [each for each in services.values() if each and _is_in_step(each)]
    while linked := [name for name, each in free.items() if exchange(each, inside)]:
        inside += [free.pop(name) for name in linked]
    return frozenset(free)


def _is_in_step(service: Service) -> bool:
    lockstep = isinstance(service, Generator) and service.lockstep
    return lockstep or (isinstance(service, Device) and service.coupled)


class AttachedServices:
    """One region's view of the services attached to a world.

    `deliver` is between the region's algorithm and all of its members. At `HOME`, `send` is called
    with the replies for the other regions as soon as the services have answered.
    """

    def __init__(
        self,
        regions: int,
        nearby: NearbyServices,
        members: Iterable[Member],
        last: Iterable[m.ViewShown] = (),
    ) -> None:
        """`nearby` are the services with a halo, which are not among the attached ones.

        `last` are the last views of a run that continues, by which coupled devices act.
        """
        apart = nearby.names
        attached = [
            each for each in members if is_attached(each.service) and each.name not in apart
        ]
        hellos = [member.hello() for member in attached]
        self.send: Callable[[Sequence[Replies]], None] = lambda replies: None
        self.drawn = frozenset(name for hello in hellos for name in hello.draws)
        self.nearby = nearby
        nearby.send = lambda replies: self.send(replies)
        self._number = nearby.number
        self._others = [region for region in range(regions) if region != HOME]
        self._names = frozenset(hello.member for hello in hellos)
        self._tickers = frozenset(hello.member for hello in hellos if hello.ticks)
        self._drawn = {hello.member: frozenset(hello.draws) for hello in hellos}
        self._replies: dict[int, dict[str, tuple[AnyEvent, ...]]] = {}
        self._answered = -1
        self._running: Member | None = None
        self._last = {shown.event_type: shown for shown in last}
        # Devices ignore a view with a lower number than the last one.
        numbers = [shown.sequence for shown in self._last.values()]
        self._assembly = ViewAssembly(max(numbers, default=0))
        self._unshown: dict[str, list[m.ViewShown]] = {}
        if self.at_home:
            for shown in self._last.values():
                self._show(shown)

    @property
    def see(self) -> bool:
        """Whether services of this region see views."""
        return bool(self.nearby.halos or (self.at_home and self.drawn))

    @property
    def at_home(self) -> bool:
        """Whether the services are in this region."""
        return self._number == HOME

    def lacks(self, frame: int, *, last: bool = False) -> list[int]:
        """The regions whose replies for a frame have not arrived yet.

        `last`: it only has views, to which services do not reply.
        """
        waits = self._tickers and not self.at_home and frame not in self._replies and not last
        return sorted({*self.nearby.lacks(frame), *([HOME] if waits else [])})

    def receive(self, replies: Replies) -> bool:
        """Accept replies; returns False if they have arrived before.

        Raises ProtocolError for replies that are not those of all attached services, or of all with
        a halo.
        """
        if self.nearby.names and frozenset(replies.events) == self.nearby.names:
            return self.nearby.receive(replies)
        if replies.source != HOME or frozenset(replies.events) != self._tickers:
            raise ProtocolError(
                f"replies of {', '.join(sorted(replies.events))[:80] or 'no service'}"
            )
        if replies.frame <= self._answered or replies.frame in self._replies:
            return False
        self._replies[replies.frame] = dict(replies.events)
        return True

    def take(self, frame: int, parcels: Sequence[Parcel], *, again: bool = False) -> None:
        """Assemble the views of a frame; services get them before they are asked again.

        `again`: a process before this one has done so, and has sent the replies for other regions.
        """
        shown = {parcel.source: parcel.halo for parcel in parcels if parcel.halo}
        others = (parcel for parcel in parcels if parcel.source != self._number)
        movers = None if again else [parcel.source for parcel in others if parcel.units]
        if shown or not again:
            self.nearby.take(frame, shown, movers)
        for event_type in self.nearby.halos if shown else ():
            self._last.pop(event_type, None)
        parts = {parcel.source: parcel.views for parcel in parcels if parcel.views}
        if not self.at_home or not parts:
            return
        for shown in self._assembly.assemble(frame, parts):
            self._last.pop(shown.event_type, None)
            self._show(shown)

    def _show(self, shown: m.ViewShown) -> None:
        for name, drawn in self._drawn.items():
            if shown.event_type in drawn:
                self._unshown.setdefault(name, []).append(shown)

    @property
    def last(self) -> list[m.ViewShown]:
        """The views with which this run has continued, and which no other has replaced."""
        return [*self._last.values()]

    @property
    def shown(self) -> dict[int, dict[int, ViewPart]]:
        """The latest views by frame and region: `take` continues with them in another process."""
        return self._assembly.parts

    @property
    def arrived(self) -> list[Replies]:
        """The replies for frames that have not begun, in other regions."""
        number, replies = self._number, sorted(self._replies.items())
        return [*(Replies(frame, HOME, number, of) for frame, of in replies), *self.nearby.arrived]

    def elsewhere(self, member: Member) -> bool:
        """Whether a member is a service in another region, so that here it only stands for it."""
        return member.name in self._names and not self.at_home

    @property
    def running(self) -> str:
        """The name of the member whose code runs, or has failed; "" if none does."""
        running = self.nearby.running or self._running
        return "" if running is None else running.name

    def deliver(self, member: Member, message: m.ToMember | m.Readings) -> Iterable[Answer]:
        """Deliver a message to a member of this region; returns its answers."""
        self._running = member
        answers = [*self._deliver(member, message)]
        self._running = None
        return answers

    def _deliver(self, member: Member, message: m.ToMember | m.Readings) -> Iterable[Answer]:
        if member.name in self.nearby.names:
            return self.nearby.deliver(member, message)
        if member.name not in self._names:
            return received(member, message)
        # The view of this region alone: its parcel has it.
        is_view = isinstance(message, m.ViewShown)
        if not self.at_home:
            return () if is_view else self._stand_in(member, message)
        answers: list[Answer] = []
        # A member ignores views before its welcome.
        joins = isinstance(message, m.Greet | m.Welcome)
        for shown in () if joins else self._unshown.pop(member.name, ()):
            answers += received(member, shown)
        if not is_view:
            answers += received(member, message)
        self._note(answers)
        return answers

    def _stand_in(self, member: Member, message: m.ToMember | m.Readings) -> Iterable[Answer]:
        """The answer of a service in another region."""
        match message:
            case m.Greet():
                return (member.hello(),)
            case m.TickRequest(frame):
                self._answered = frame
                self._replies = {n: of for n, of in self._replies.items() if n >= frame}
                return (m.TickReply(member.name, frame, self._replies[frame][member.name]),)
            case m.Stop():
                return (m.Report(member.name, {}),)
            case _:
                return ()

    def _note(self, answers: Iterable[Answer]) -> None:
        """Keep the replies of services until all have answered, and send them then."""
        for reply in answers:
            if not isinstance(reply, m.TickReply):
                continue
            replies = self._replies.setdefault(reply.frame, {})
            replies[reply.member] = reply.events
            if frozenset(replies) == self._tickers:
                del self._replies[reply.frame]
                self.send([Replies(reply.frame, HOME, to, replies) for to in self._others])
