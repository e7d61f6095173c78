"""Process of a member: a loop around its `Member`, its inbox and its link to the world."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import zenoh

from minerva_bus.blame import WORLD_CODE, blamed, report, whole
from minerva_bus.errors import BusError, UserCodeError
from minerva_bus.frame import messages as m
from minerva_bus.frame.member import Member, Refusal
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.runtime.arrival import ARRIVAL, Arrival, GreetingTimer, Ungreeted
from minerva_bus.runtime.asking import AskingOperator, ask, question_key
from minerva_bus.runtime.diagnosis import not_let_in
from minerva_bus.runtime.inbox import Inbox, KeyedSample, keyed_sample
from minerva_bus.runtime.memory import keep_freed_memory
from minerva_bus.runtime.own_threads import Leave, OwnThreads, Published, Pulse, ReportFigures
from minerva_bus.runtime.predecessor import Predecessor
from minerva_bus.runtime.reconnect import CheckConnection, Diagnosed, ReconnectMonitor
from minerva_bus.runtime.rejoin import ReclaimName, Rejoin
from minerva_bus.runtime.system import REAL, System, run_through
from minerva_bus.runtime.world_link import WorldLink
from minerva_bus.security.credentials import Credentials
from minerva_bus.wire.keys import COORDINATOR, Keys, checked_name
from minerva_bus.world.services import Device

RAISED: Final = 70
"""Exit code after an exception in user code that the same input would cause again."""

RAISED_BY_CHANCE: Final = 75
"""Exit code after an exception that a retry may avoid: I/O and anything that uses the clock."""

SHOWN_WITHIN: Final = 0.25
"""Seconds after which an observer shows a view, although newer ones keep arriving."""

ANSWERED_WITHIN: Final = 1.0
"""Seconds within which the coordinator answers a question of a member."""

# Longer than the lease, and shorter than the time that a successor waits for its guests
# (`monitor.BACK_WITHIN`): a member that still runs is back before it is given up.
BACK_WITHIN: Final = 5.0
"""Seconds after which a member gives up a world that it has lost."""

MAX_LOSSES: Final = 3
"""Consecutive losses of a secured link without a greeting after which a member gives up."""

POLL_SECONDS: Final = 0.02
"""Interval in seconds between checks for the world or for a free name."""


@dataclass(frozen=True, slots=True)
class MemberLinkOptions:
    """Connection options of a member: endpoint, shared memory for large messages, certificate."""

    endpoint: str
    shared: bool
    own: Credentials | None
    arrival: Arrival


class MemberProcess:
    """Runs a member with a Zenoh session of its own.

    Args:
        member: The protocol side, which is pure.
        world: Name of the world.
        endpoint: The endpoint of the world.
        notify: Called with lines for the user.
        shared: Whether large messages use shared memory.
        own: The member's certificate.
        ends: Whether a free-running service that has finished leaves the world.
        back_within: Seconds after which a lost world is given up.
        arrival: Time-outs while the member joins.
        system: Clock, threads and sessions.

    """

    def __init__(
        self,
        member: Member,
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
        name = checked_name(member.name, "a member")
        self.member = member
        self.inbox = Inbox()
        self.failure: Exception | None = None
        self.link = WorldLink(Keys(world), name, notify, system.monotonic)
        self._system = system
        self._connect = MemberLinkOptions(endpoint, shared, own, arrival)
        self._notify = notify
        self._shown_at = 0.0
        self._figures: m.Figures = {}
        self._greeting = GreetingTimer(arrival, system, self.inbox.put)
        self._threads = OwnThreads(name, self.inbox.put, self._send, notify, system, ends=ends)
        monitor = ReconnectMonitor(
            f"{name}: the world {world!r}",
            back_within,
            lambda: system.obstacle(endpoint, own),
            notify,
            self.inbox.put,
            system,
        )
        self._rejoin = Rejoin(
            name, monitor, self.link, notify, self.inbox.put, system, claims=arrival.claims
        )
        self._handlers: dict[type, Callable[[Any], bool | None]] = {
            bytes: self._on_message,
            KeyedSample: self._on_sample,
            Pulse: self._on_pulse,
            ReportFigures: self._on_figures,
            Leave: self._on_leave,
            CheckConnection: lambda _: monitor.check(),
            Diagnosed: monitor.diagnosed,
            ReclaimName: lambda _: self._rejoin.reclaim(self._session),
            Ungreeted: self._on_ungreeted,
        }

    def leave(self) -> None:
        """Leave the world; may be called from a signal handler or another thread."""
        self.inbox.put(Leave())

    def run(self) -> int:
        """Take part until the world ends; returns the exit code of the process.

        Raises BusError if the world cannot be reached and Refusal if it rejects the member.
        """
        return run_through(self.life())

    def life(self) -> Generator[None, None, int]:
        """`run` as a generator that yields after each iteration, for simulations."""
        system, connect = self._system, self._connect
        client = system.client(
            self.member.name, connect.endpoint, shared=connect.shared, own=connect.own
        )
        with client as session:
            # The name must be free before anything is declared, or messages for
            # its holder would arrive here, too.
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
                # session withdraws all declarations after the last message. If the token were
                # undeclared here, that would overtake it: Zenoh sends liveliness first.
                self._threads.stop()
                self._rejoin.monitor.close()
                self.inbox.close()
                self._close_service()

    def _close_service(self) -> None:
        service = self.member.service
        if service is not None:
            with blamed(service.close):
                service.close()

    # --- joining ---

    def _ask(self, question: str, **details: Any) -> Mapping[str, Any]:
        world = self.link.keys.world
        key = question_key(world, self._connect.own)
        reply = ask(self._session, key, question, ANSWERED_WITHIN, details)
        if reply is None:
            raise BusError(f"the world {world!r} has not answered for a second")
        return reply

    def _arrive(self, session: zenoh.Session) -> Iterator[None]:
        """Find the world, then wait for a free name; yields before each further attempt."""
        yield from self._find_world(session)
        self._session = session
        self.member.operator = AskingOperator(self._ask, self.member.name)
        self.member.endpoint = self._connect.endpoint
        within = self._connect.arrival.named
        if self._connect.arrival.standby:
            self._notify(f"{self.member.name}: stands by until the member of this name has gone")
            predecessor = Predecessor(self.member.name, self.link.keys, self._system)
            yield from self._rejoin.stand_by(session, predecessor)
        yield from self._rejoin.name.until_free(session, self._system.monotonic, within)

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
        """Declare subscribers first, then publishers, the token last, so that nothing is missed."""
        service, handler = self.member.service, self.inbox.handler
        first, *others = self._subscriptions()
        declared = self.inbox.open(session, first)
        declared += [session.declare_subscriber(key, handler(keyed_sample)) for key in others]
        declared += self.link.open(session, service.publishes if service is not None else ())
        liveliness, alive = session.liveliness(), self.link.keys.alive(COORDINATOR)
        declared.append(liveliness.declare_subscriber(alive, handler(keyed_sample), history=True))
        self._rejoin.name.declare(session)
        return declared

    def _subscriptions(self) -> list[str]:
        """The keys of the member; the first, which gets the lock-free channel, is the busiest."""
        member, keys, service = self.member, self.link.keys, self.member.service
        subscriptions = [keys.to(member.name), keys.all, *map(keys.topic, member.topics)]
        if isinstance(service, Device) and not service.coupled:
            subscriptions[:0] = map(keys.view, service.draws)
        if member.host.kinds:
            subscriptions.insert(0, keys.evolve)
        if member.hello().ticks_with_all:
            subscriptions.insert(0, keys.tick)
        return subscriptions

    # --- one iteration of the loop ---

    def _take_part(self) -> Generator[None, None, int]:
        service = self.member.service
        self._greeting.start()
        try:
            observes = isinstance(service, Device) and not service.coupled
            while not self.member.stopped:
                item = self._next_for_observer() if observes else self.inbox.wait()
                handler = self._handlers.get(item.__class__)
                if handler is None:
                    # Exceptions of the member's own threads arrive as
                    # items, so that all are handled here.
                    if isinstance(item, Exception):
                        raise item
                elif handler(item) is False:
                    return 0
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
            self._greeting.cancel()
        return 0

    def _next_for_observer(self) -> Any:
        """The next item; before it blocks, and every SHOWN_WITHIN seconds, the view is shown.

        An observer that is slower than the world shows the newest view instead of each.
        """
        item = self.inbox.ready()
        # The newest view is known once the inbox is empty.
        if item is None:
            self._show()
            return self.inbox.wait()
        if self._system.monotonic() > self._shown_at + SHOWN_WITHIN:
            self._show()
        return item

    def _show(self) -> None:
        self.member.show()
        self._shown_at = self._system.monotonic()

    def _on_message(self, data: bytes) -> None:
        """Process a message of the coordinator."""
        message = self.link.message(data)
        if message is None:
            return
        joining = self.member.world is None
        for reply in self.member.receive(message):
            self.link.send(reply)
        if joining and self.member.world is not None:
            self._greeting.cancel()
            self.link.joined(self.member.world.vocabulary)
            self._threads.start(self.member.service)

    def _on_sample(self, sample: KeyedSample) -> None:
        """Process a sample from the side queue: readings, a message or the coordinator's token."""
        if self.link.is_topic(sample.key):
            readings = self.link.readings(sample.key, sample.data)
            for reply in () if readings is None else self.member.receive(readings):
                self.link.send(reply)
        elif sample.key != self.link.keys.alive(COORDINATOR):
            self._on_message(sample.data)
        elif sample.there:
            self._rejoin.restored(self._session)
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

    def _send(self, output: AnyEvent | Published) -> None:
        """Send an event or a reading of a free-running generator; called in its thread."""
        if isinstance(output, Published):
            self.link.send(self.member.published(output.topic, output.reading))
        else:
            self.link.send(self.member.emitted(output))

    def _on_leave(self, _: Leave) -> bool:
        self.link.send(m.Leaving(self.member.name))
        return False

    def _on_ungreeted(self, _: Ungreeted) -> None:
        """Give up after the time-out, unless the coordinator is too busy to answer."""
        # The time-out and the greeting may have crossed.
        if self.member.world is not None:
            return
        if not self._greeting.expired and not self._is_status_answered():
            self._notify(f"{self.member.name}: the world is busy; waiting for its greeting")
            self._greeting.restart()
            return
        raise BusError(
            f"the world {self.link.keys.world!r} does not greet {self.member.name};"
            " is that its name (minerva list)?"
        )

    def _is_status_answered(self) -> bool:
        """Whether the coordinator answers questions. Raises BusError for a rejection."""
        key = question_key(self.link.keys.world, self._connect.own)
        return ask(self._session, key, "status", ANSWERED_WITHIN, {}) is not None

    def _on_pulse(self, _: Pulse) -> bool:
        """Call the service's `pulse`; False when the service leaves."""
        service = self.member.service
        self._threads.pulsed()
        if service is None:
            return True
        with blamed(service.pulse):
            service.pulse()
        with blamed(service.leaves):
            leaves = service.leaves()
        return self._on_leave(Leave()) if leaves else True

    def _on_figures(self, _: ReportFigures) -> None:
        """Send the member's metrics, if they have changed."""
        figures = self.member.figures()
        if figures != self._figures:
            self._figures = figures
            self.link.send(m.MemberMetrics(self.member.name, figures))

    def _described(self, error: Exception) -> str:
        return report(error)

    def _report_failure(self, error: Exception) -> int:
        """Report that user code raised; returns the exit code."""
        self.failure = error
        name, frame = self.member.name, self.member.frame
        self.link.send(m.Failed(name, frame, self._described(error), whole(error)))
        # UserCodeError wraps the exception of the user's code, which is its cause.
        outside = isinstance(error.__cause__ or error, OSError)
        return RAISED_BY_CHANCE if outside or frame < 0 else RAISED
