"""The process of members: a loop around them, with one inbox and one session.

A participant is one member of a process: its messages, its name, and its timers and threads.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from operator import attrgetter
from typing import Any, Final

import zenoh

from minerva_bus.errors import BusError, MinervaError, UserCodeError
from minerva_bus.frame import messages as m
from minerva_bus.frame.member_side import Member, Refusal
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.runtime.endpoints import not_let_in
from minerva_bus.runtime.joining import (
    ARRIVAL,
    Arrival,
    GreetingTimer,
    ReconnectMonitor,
    Rejoin,
    WorldLink,
)
from minerva_bus.runtime.operator_client import AskingOperator, ask, question_key
from minerva_bus.runtime.runner import keep_freed_memory
from minerva_bus.runtime.session import REAL, System, Timer, run_through
from minerva_bus.runtime.session_inbox import Inbox, KeyedSample, keyed_sample
from minerva_bus.security.credentials import Credentials
from minerva_bus.user_code import WORLD_CODE, blamed, handler_name, report, whole
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.keys import COORDINATOR, Keys, checked_name
from minerva_bus.world import services
from minerva_bus.world.readings import Reading

# --- threads besides the main thread, and the items that they put into the inbox ---

STOP_SECONDS: Final = 1.0
"""Seconds that the end of a member waits for a message that another thread sends."""

FIGURES_SECONDS: Final = 1.0
"""Interval in seconds between two reports of a member's metrics."""


@fast_dataclass
class Leave:
    """Request: the member leaves its world."""


@fast_dataclass
class Published:
    """A reading of a free-running publisher."""

    topic: str
    reading: Reading


@fast_dataclass
class ReportFigures:
    """Timer: send the member's metrics."""


@fast_dataclass
class Pulse:
    """Timer: call the service's `pulse`."""


class Outlet:
    """Accepts the events and readings of a free-running generator, in the generator's thread."""

    def __init__(self, deliver: Callable[[AnyEvent | Published], None]) -> None:
        self._deliver = deliver

    def __call__(self, event: AnyEvent) -> None:
        """Emit an event."""
        self._deliver(event)

    def publish(self, topic: str, reading: Reading) -> None:
        """Publish a reading on a sensor topic."""
        self._deliver(Published(topic, reading))


class OwnThreads:
    """Threads and timers of a service: free-running generation, metrics and pulses.

    `put` adds items to the inbox of the member `name`. `send` sends an event or a reading at once,
    in the generator's thread: the main thread would take it only after another wake-up. With
    `ends`, a service whose generation has finished leaves the world, which `notify` reports.
    """

    def __init__(
        self,
        name: str,
        put: Callable[[Any], None],
        send: Callable[[AnyEvent | Published], None],
        notify: Callable[[str], None],
        system: System,
        *,
        ends: bool,
    ) -> None:
        self._system = system
        self._timers: list[Timer] = []
        self._name = name
        self._put = put
        self._send = send
        self._notify = notify
        self._ends = ends
        self._stop = threading.Event()
        self._sending = threading.Lock()
        self._pulse_pending = threading.Event()

    def start(self, member: Member) -> None:
        """Start the threads of a member's service after it has joined a world."""
        service = member.service
        if service is None:
            return
        # A thread, because the code of a free-running generator may block, for example on a device.
        if isinstance(service, services.Generator) and not member.when.is_awaited:
            self._system.aside(lambda: self._generate(service))
        report = ReportFigures()
        self._timers.append(self._system.every(FIGURES_SECONDS, lambda: self._put(report)))
        if service.pulse_every > 0:
            self._timers.append(self._system.every(service.pulse_every, self._add_pulse))

    def stop(self) -> None:
        """Request that all threads stop; from now on nothing is sent."""
        self._stop.set()
        for timer in self._timers:
            timer.cancel()
        # A thread that returns from Zenoh while the interpreter shuts down would abort the process.
        if self._sending.acquire(timeout=STOP_SECONDS):
            self._sending.release()

    def pulsed(self) -> None:
        """The main thread has processed a pulse: the next one may be added."""
        self._pulse_pending.clear()

    def _generate(self, service: services.Generator) -> None:
        try:
            service.run(Outlet(self._deliver), self._stop)
            if self._ends and not self._stop.is_set():
                self._notify(f"{self._name}: no more events; leaving the world")
                # The last figures are sent before the member leaves.
                self._put(ReportFigures())
                self._put(Leave())
        except MinervaError as error:
            self._put(MinervaError(f"{self._name} cannot continue: {error}"))
        # Raised in the main thread, which reports failures. SystemExit would end only this thread,
        # and so would a KeyboardInterrupt, which no signal raises here.
        except BaseException as error:
            failure = UserCodeError(handler_name(service.run), service.run)
            failure.__cause__ = error
            self._put(failure)

    def _deliver(self, output: AnyEvent | Published) -> None:
        try:
            with self._sending:
                if not self._stop.is_set():
                    self._send(output)
        # Raised in the main thread, which reports failures. A generator that catches exceptions
        # of its own code would hide it.
        except Exception as error:
            self._put(error)

    def _add_pulse(self) -> None:
        # Pulses do not queue up behind a slow one.
        if not self._pulse_pending.is_set():
            self._pulse_pending.set()
            self._put(Pulse())


# --- one member ---

ANSWERED_WITHIN: Final = 1.0
"""Seconds within which the coordinator answers a question of a member."""

MAX_LOSSES: Final = 3
"""Consecutive losses of a secured link without a greeting after which a member gives up."""


@fast_dataclass
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


@fast_dataclass
class ForParticipant:
    """An item of the inbox for one of the members of the process."""

    participant: Participant
    item: Any


class Participant:
    """A member of the process with its link to the world; handles items that are for it alone.

    `present`: whether it takes part, or is about to; its process may outlast it. `put` adds to the
    inbox of the process, from any thread. `hear` receives the readings that it publishes, for the
    members of the process, and whether this is another thread than the main one.
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
        self.present = True
        self.figures: m.Figures = {}
        self._connect = connect
        self._notify = notify
        self._put = put
        self._hear = hear
        self._system = system
        self.greeting = GreetingTimer(
            connect.arrival, system, lambda: self._add(self._on_ungreeted)
        )
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
        self._handlers: dict[type, Callable[[Any], None]] = {
            Pulse: self._on_pulse,
            ReportFigures: lambda _: self.report_figures(),
            Leave: lambda _: self.leave(),
        }

    @property
    def observes(self) -> bool:
        """Whether it shows the newest view instead of each."""
        service = self.member.service
        return isinstance(service, services.Device) and not service.coupled

    def _add(self, item: Any) -> None:
        self._put(ForParticipant(self, item))

    def take(self, item: Any) -> None:
        """Handle an item for this member. Raises the exceptions of its own threads."""
        if isinstance(item, Exception):
            raise item
        handler = self._handlers.get(item.__class__)
        if (handler(item) if handler is not None else item()) is False:
            self.present = False

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
        self.member.bus = self._connect.endpoint, (self.member.name, session)
        within = self._connect.arrival.named
        if self._connect.arrival.standby:
            self._notify(f"{self.member.name}: stands by until the member of this name has gone")
            yield from self._rejoin.stand_by(session)
        yield from self._rejoin.name.until_free(session, self._system.monotonic, within)

    def subscriptions(self) -> list[str]:
        """The keys of the member, the busiest first."""
        member, keys, service = self.member, self.link.keys, self.member.service
        subscriptions = [keys.to(member.name), keys.all, *map(keys.topic, member.topics)]
        if self.observes and isinstance(service, services.Device):
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
        stamp = self.link.stamp
        message = self.link.message(data)
        if message is None:
            return
        if self.link.stamp != stamp:
            self.member.clear_tick()
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
        if self.member.stopped:
            self.present = False

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
        self.present = False

    def stop(self) -> None:
        """Stop threads and timers, which put into the inbox."""
        self._threads.stop()
        self._rejoin.monitor.close()


# --- the process ---

RAISED: Final = 70
"""Exit code after an exception in user code that the same input would cause again."""

RAISED_BY_CHANCE: Final = 75
"""Exit code after an exception that a retry may avoid: I/O and anything that uses the clock."""

SHOWN_WITHIN: Final = 0.25
"""Seconds after which an observer shows a view, although newer ones keep arriving."""

# Longer than the lease, and shorter than the time that a successor waits for its guests
# (`monitor.BACK_WITHIN`): a member that still runs is back before it is given up.
BACK_WITHIN: Final = 5.0
"""Seconds after which a member gives up a world that it has lost."""

POLL_SECONDS: Final = 0.02
"""Interval in seconds between checks for the world or for a free name."""


_PRESENT: Final = attrgetter("present")


class MemberProcess:
    """Runs members with a Zenoh session, each under its own name.

    Readings that they send each other do not leave the process. `member` and `link` are those of
    the first one, `running` is the one whose code runs, or ran last.

    Args:
        members: The protocol sides, which are pure.
        world: Name of the world.
        endpoint: The endpoint of the world.
        notify: Called with lines for the user.
        shared: Whether large messages use shared memory.
        own: The certificate of the only member.
        ends: Whether a free-running service that has finished leaves the world.
        back_within: Seconds after which a lost world is given up.
        arrival: Time-outs while the members join.
        system: Clock, threads and sessions.

    """

    def __init__(
        self,
        members: Iterable[Member],
        world: str,
        endpoint: str,
        notify: Callable[[str], None],
        *,
        shared: bool = False,
        own: Credentials | None = None,
        ends: bool = False,
        back_within: float = BACK_WITHIN,
        arrival: Arrival = ARRIVAL,
        system: System = REAL,
    ) -> None:
        keep_freed_memory()
        self.inbox = Inbox()
        self.failure: Exception | None = None
        self._system = system
        self._connect = MemberLinkOptions(endpoint, shared, own, arrival, back_within, ends)
        self._notify = notify
        self._shown_at = 0.0
        self._heard: deque[m.Readings] = deque()
        self._routes: dict[str, list[Participant]] = {}
        # By the order of names, in which they also process what is for several of them.
        self._participants = [
            Participant(member, world, self._connect, notify, self.inbox.put, self._hear, system)
            for member in sorted(members, key=lambda member: member.name)
        ]
        self._handlers: dict[type, Callable[[Any], bool | None]] = {
            bytes: self._on_message,
            KeyedSample: self._on_sample,
            ForParticipant: self._on_own,
            m.Readings: self._heard.append,
            Leave: self._on_leave,
        }
        self._first = self._running = self._participants[0]

    @property
    def member(self) -> Member:
        """The first member."""
        return self._first.member

    @property
    def link(self) -> WorldLink:
        """The link of the first member."""
        return self._first.link

    @property
    def running(self) -> Member:
        """The member whose code runs, or ran last."""
        return self._running.member

    def leave(self) -> None:
        """Leave the world; may be called from a signal handler or another thread."""
        self.inbox.put(Leave())

    def run(self) -> int:
        """Take part until the world ends; returns the exit code of the process.

        Raises BusError if the world cannot be reached and Refusal if it rejects a member.
        """
        return run_through(self.life())

    def life(self) -> Generator[None, None, int]:
        """`run` as a generator that yields after each iteration, for simulations."""
        system, connect = self._system, self._connect
        client = system.client(
            self.member.name, connect.endpoint, shared=connect.shared, own=connect.own
        )
        with client as session:
            # The names must be free before anything is declared, or messages for
            # their holders would arrive here, too.
            for _ in self._arrive(session):
                if isinstance(self.inbox.early(), Leave):
                    return 0
                system.sleep(POLL_SECONDS)
                yield
            self._declared = self._declare(session)
            try:
                return (yield from self._take_part())
            finally:
                # Threads and timers stop first, because they put into the inbox. The end of the
                # session withdraws all declarations after the last message. If a token were
                # undeclared here, that would overtake it: Zenoh sends liveliness first.
                for participant in self._participants:
                    participant.stop()
                self.inbox.close()
                for participant in self._participants:
                    participant.member.close()

    # --- joining ---

    def _arrive(self, session: zenoh.Session) -> Iterator[None]:
        """Find the world, then wait for free names; yields before each further attempt."""
        yield from self._find_world(session)
        self._session = session
        for participant in self._participants:
            yield from participant.arrive(session)

    def _find_world(self, session: zenoh.Session) -> Iterator[None]:
        """Wait for the coordinator's token: without one, no greeting would arrive."""
        keys, connect = self.link.keys, self._connect
        until = self._system.monotonic() + connect.arrival.seen
        while not list(session.liveliness().get(keys.alive(COORDINATOR), timeout=1.0)):
            if self._system.monotonic() > until:
                raise BusError(
                    f"there is no world {keys.world!r} at {connect.endpoint};"
                    f" is that its name (minerva list)?{not_let_in(connect.own)}"
                )
            yield

    def _declare(self, session: zenoh.Session) -> list[Any]:
        """Declare subscribers first, then publishers, tokens last, so that nothing is missed."""
        handler, keys = self.inbox.handler, self.link.keys
        for participant in self._participants:
            for key in participant.subscriptions():
                self._routes.setdefault(key, []).append(participant)
        # The lock-free channel is for the busiest key: that of most members, of the first keys of
        # each.
        busy = [key for key in self._routes if key != keys.all]
        first = max(busy, key=lambda key: len(self._routes[key]))
        self._by_channel = self._routes[first]
        declared = self.inbox.open(session, first)
        others = [key for key in self._routes if key != first]
        declared += [session.declare_subscriber(key, handler(keyed_sample)) for key in others]
        for participant in self._participants:
            declared += participant.declare()
        liveliness, alive = session.liveliness(), keys.alive(COORDINATOR)
        declared.append(liveliness.declare_subscriber(alive, handler(keyed_sample), history=True))
        for participant in self._participants:
            participant.declare_name()
        return declared

    # --- one iteration of the loop ---

    def _take_part(self) -> Generator[None, None, int]:
        for participant in self._participants:
            participant.greeting.start()
        observers = [each for each in self._participants if each.observes]
        try:
            while any(map(_PRESENT, self._participants)):
                item = self._next_for(observers) if observers else self.inbox.wait()
                handler = self._handlers.get(item.__class__)  # None for a wake-up without an item.
                if handler is not None and handler(item) is False:
                    break
                if self._heard:
                    self._pass_on()
                yield
        # Neither is a failure of user code, so no traceback is sent.
        except (Refusal, BusError):
            raise
        except Exception as error:
            return self._report_failure(error)
        except KeyboardInterrupt as error:
            # Signals have other handlers, so code of the world has raised it.
            failure = UserCodeError(WORLD_CODE)
            failure.__cause__ = error
            return self._report_failure(failure)
        finally:
            for participant in self._participants:
                participant.greeting.cancel()
        return 0

    def _next_for(self, observers: list[Participant]) -> Any:
        """The next item; before it blocks, and every SHOWN_WITHIN seconds, views are shown.

        An observer that is slower than the world shows the newest view instead of each.
        """
        item = self.inbox.ready()
        # The newest view is known once the inbox is empty.
        if item is None:
            self._show(observers)
            return self.inbox.wait()
        if self._system.monotonic() > self._shown_at + SHOWN_WITHIN:
            self._show(observers)
        return item

    def _show(self, observers: list[Participant]) -> None:
        for observer in observers:
            self._running = observer
            observer.member.show()
        self._shown_at = self._system.monotonic()

    def _each(self, participants: Iterable[Participant]) -> Iterator[Participant]:
        for participant in participants:
            if participant.present:
                # Set before the call, so that an error in the member's code can be attributed.
                self._running = participant
                yield participant

    def _on_message(self, data: bytes) -> None:
        """Process a message from the channel."""
        # As `_each`, without a generator for each message.
        for participant in self._by_channel:
            if participant.present:
                self._running = participant
                participant.receive(data)

    def _on_sample(self, sample: KeyedSample) -> None:
        """Process a sample from the side queue: readings, a message or the coordinator's token."""
        key, keys = sample.key, self.link.keys
        if self.link.is_topic(key):
            for participant in self._each(self._routes.get(f"{key.rpartition('/')[0]}/*", ())):
                participant.receive_readings(key, sample.data)
        elif key == keys.alive(COORDINATOR):
            for participant in self._each(self._participants):
                participant.token(self._session, there=sample.there)
        else:
            for participant in self._each(self._routes.get(key, ())):
                participant.receive(sample.data)

    def _hear(self, readings: m.Readings, aside: bool) -> None:
        """Keep readings for members of this process that subscribe to them."""
        if self.link.keys.topic(readings.topic) in self._routes:
            (self.inbox.put if aside else self._heard.append)(readings)

    def _pass_on(self) -> None:
        """Let members process the readings that others of this process have published."""
        while self._heard:
            readings = self._heard.popleft()
            listeners = self._routes.get(self.link.keys.topic(readings.topic), ())
            for participant in self._each(listeners):
                participant.process(readings)

    def _on_own(self, item: ForParticipant) -> None:
        self._running = item.participant
        item.participant.take(item.item)

    def _on_leave(self, _: Leave) -> bool:
        for participant in self._each(self._participants):
            participant.leave()
        return False

    def _report_failure(self, error: Exception) -> int:
        """Report that user code raised; returns the exit code."""
        self.failure = error
        member, link = self._running.member, self._running.link
        link.send(m.Failed(member.name, member.frame, report(error), whole(error)))
        # UserCodeError wraps the exception of the user's code, which is its cause.
        outside = isinstance(error.__cause__ or error, OSError)
        return RAISED_BY_CHANCE if outside or member.frame < 0 else RAISED
