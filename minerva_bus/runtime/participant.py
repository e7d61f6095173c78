"""One member of a process: its messages, its name, and its timers and threads."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import zenoh

from minerva_bus.blame import blamed
from minerva_bus.errors import BusError
from minerva_bus.frame import messages as m
from minerva_bus.frame.member import Member
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.runtime.arrival import Arrival, GreetingTimer, Ungreeted
from minerva_bus.runtime.asking import AskingOperator, ask, question_key
from minerva_bus.runtime.own_threads import Leave, OwnThreads, Published, Pulse, ReportFigures
from minerva_bus.runtime.reconnect import CheckConnection, Diagnosed, ReconnectMonitor
from minerva_bus.runtime.rejoin import ReclaimName, Rejoin
from minerva_bus.runtime.system import System
from minerva_bus.runtime.world_link import WorldLink
from minerva_bus.security.credentials import Credentials
from minerva_bus.wire.keys import Keys, checked_name
from minerva_bus.world.services import Device

ANSWERED_WITHIN: Final = 1.0
"""Seconds within which the coordinator answers a question of a member."""

MAX_LOSSES: Final = 3
"""Consecutive losses of a secured link without a greeting after which a member gives up."""


@dataclass(frozen=True, slots=True)
class MemberLinkOptions:
    """Connection options of a process: endpoint, shared memory for large messages, certificate.

    `arrival`: time-outs while its members join. `back_within`: seconds after which a lost world is
    given up. `ends`: whether a free-running service that has finished leaves the world.
    """

    endpoint: str
    shared: bool
    own: Credentials | None
    arrival: Arrival
    back_within: float
    ends: bool


@dataclass(frozen=True, slots=True)
class ForParticipant:
    """An item of the inbox for one of the members of the process."""

    participant: Participant
    item: Any


class Participant:
    """A member of the process with its link to the world; handles items that are for it alone.

    `has_left`: it takes part no more, though its process may. `put` adds to the inbox of the
    process, from any thread. `hear` receives the readings that it publishes, for the members of the
    process, and whether this is another thread than the main one.
    """

    def __init__(
        self,
        member: Member,
        world: str,
        connect: MemberLinkOptions,
        notify: Callable[[str], None],
        put: Callable[[Any], None],
        hear: Callable[[m.Readings, bool], None],
        system: System,
    ) -> None:
        name = checked_name(member.name, "a member")
        self.member = member
        self.link = WorldLink(Keys(world), name, notify, system.monotonic)
        self.has_left = False
        self.figures: m.Figures = {}
        self._connect = connect
        self._notify = notify
        self._put = put
        self._hear = hear
        self._system = system
        self.greeting = GreetingTimer(connect.arrival, system, self._add)
        self._threads = OwnThreads(
            name, self._add, self._send_aside, notify, system, ends=connect.ends
        )
        monitor = ReconnectMonitor(
            f"{name}: the world {world!r}",
            connect.back_within,
            lambda: system.obstacle(connect.endpoint, connect.own),
            notify,
            self._add,
            system,
        )
        self._rejoin = Rejoin(
            name, monitor, self.link, notify, self._add, system, claims=connect.arrival.claims
        )
        self._handlers: dict[type, Callable[[Any], bool | None]] = {
            Pulse: self._on_pulse,
            ReportFigures: lambda _: self.report_figures(),
            Leave: lambda _: self.leave(),
            CheckConnection: lambda _: monitor.check(),
            Diagnosed: monitor.diagnosed,
            ReclaimName: lambda _: self._rejoin.reclaim(self._session),
            Ungreeted: lambda _: self._on_ungreeted(),
        }

    @property
    def present(self) -> bool:
        """Whether it takes part, or is about to."""
        return not (self.has_left or self.member.stopped)

    @property
    def observes(self) -> bool:
        """Whether it shows the newest view instead of each."""
        service = self.member.service
        return isinstance(service, Device) and not service.coupled

    def _add(self, item: Any) -> None:
        self._put(ForParticipant(self, item))

    def take(self, item: Any) -> None:
        """Handle an item for this member. Raises the exceptions of its own threads."""
        if isinstance(item, Exception):
            raise item
        if self._handlers[item.__class__](item) is False:
            self.has_left = True

    # --- joining ---

    def _ask(self, question: str, **details: Any) -> Mapping[str, Any]:
        world = self.link.keys.world
        key = question_key(world, self._connect.own)
        reply = ask(self._session, key, question, ANSWERED_WITHIN, details)
        if reply is None:
            raise BusError(f"the world {world!r} has not answered for a second")
        return reply

    def arrive(self, session: zenoh.Session) -> Iterator[None]:
        """Wait until the name is free; yields before each further attempt."""
        self._session = session
        self.member.operator = AskingOperator(self._ask, self.member.name)
        self.member.endpoint = self._connect.endpoint
        within = self._connect.arrival.named
        if self._connect.arrival.standby:
            self._notify(f"{self.member.name}: stands by until the member of this name has gone")
            yield from self._rejoin.stand_by(session)
        yield from self._rejoin.name.until_free(session, self._system.monotonic, within)

    def subscriptions(self) -> list[str]:
        """The keys of the member, the busiest first."""
        member, keys, service = self.member, self.link.keys, self.member.service
        subscriptions = [keys.to(member.name), keys.all, *map(keys.topic, member.topics)]
        if self.observes and isinstance(service, Device):
            subscriptions[:0] = map(keys.view, service.draws)
        if member.host.kinds:
            subscriptions.insert(0, keys.evolve)
        if member.hello().ticks_with_all:
            subscriptions.insert(0, keys.tick)
        return subscriptions

    def declare(self) -> list[Any]:
        """Declare its publishers; returns the declarations."""
        service = self.member.service
        return self.link.open(self._session, service.publishes if service is not None else ())

    def declare_name(self) -> None:
        """Reserve its name, from which the coordinator knows it."""
        self._rejoin.name.declare(self._session)

    # --- messages ---

    def receive(self, data: bytes) -> None:
        """Process a message of the coordinator."""
        message = self.link.message(data)
        if message is None:
            return
        joining = self.member.world is None
        self.process(message)
        if joining and self.member.world is not None:
            self.greeting.cancel()
            self.link.joined(self.member.world.vocabulary)
            self._threads.start(self.member)

    def receive_readings(self, key: str, data: bytes) -> None:
        """Process readings of a member in another process."""
        readings = self.link.readings(key, data)
        if readings is not None:
            self.process(readings)

    def process(self, message: m.ToMember | m.Readings) -> None:
        """Let the member process a message, and send its replies."""
        for reply in self.member.receive(message):
            self.link.send(reply)
            if isinstance(reply, m.Readings):
                self._hear(reply, False)

    def _send_aside(self, output: AnyEvent | Published) -> None:
        """Send an event or a reading of a free-running generator; called in its thread."""
        if isinstance(output, Published):
            readings = self.member.published(output.topic, output.reading)
            self.link.send(readings)
            self._hear(readings, True)
        else:
            self.link.send(self.member.emitted(output))

    # --- the coordinator's token ---

    def token(self, session: zenoh.Session, *, there: bool) -> None:
        """The coordinator's token has appeared or disappeared."""
        if there:
            self._rejoin.restored(session)
        else:
            self._rejoin.lost()
            self._check_admitted()

    def _check_admitted(self) -> None:
        """Raise BusError if the coordinator cuts each link of this member.

        A revoked certificate receives no message with the reason, because it must receive nothing.
        """
        if self._connect.own is not None and self._rejoin.losses >= MAX_LOSSES:
            raise BusError(
                f"the world {self.link.keys.world!r} cuts each link of {self.member.name}: its"
                " certificate was probably revoked (minerva keys list, where the world runs)"
            )

    def _on_ungreeted(self) -> None:
        """Give up after the time-out, unless the coordinator is too busy to answer."""
        # The time-out and the greeting may have crossed.
        if self.member.world is not None:
            return
        if not self.greeting.expired and not self._is_status_answered():
            self._notify(f"{self.member.name}: the world is busy; waiting for its greeting")
            self.greeting.restart()
            return
        raise BusError(
            f"the world {self.link.keys.world!r} does not greet {self.member.name};"
            " is that its name (minerva list)?"
        )

    def _is_status_answered(self) -> bool:
        """Whether the coordinator answers questions. Raises BusError for a rejection."""
        key = question_key(self.link.keys.world, self._connect.own)
        return ask(self._session, key, "status", ANSWERED_WITHIN, {}) is not None

    # --- timers, and the end ---

    def _on_pulse(self, _: Pulse) -> None:
        """Call the service's `pulse`; the member leaves if the service does."""
        service = self.member.service
        self._threads.pulsed()
        if service is None:
            return
        with blamed(service.pulse):
            service.pulse()
        with blamed(service.leaves):
            leaves = service.leaves()
        if leaves:
            self.leave()

    def report_figures(self) -> None:
        """Send the member's metrics, if they have changed."""
        figures = self.member.figures()
        if figures != self.figures:
            self.figures = figures
            self.link.send(m.MemberMetrics(self.member.name, figures))

    def leave(self) -> None:
        """Leave the world."""
        self.link.send(m.Leaving(self.member.name))
        self.has_left = True

    def stop(self) -> None:
        """Stop threads and timers, which put into the inbox."""
        self._threads.stop()
        self._rejoin.monitor.close()

    def close_service(self) -> None:
        """Let the service release its resources."""
        service = self.member.service
        if service is not None:
            with blamed(service.close):
                service.close()
