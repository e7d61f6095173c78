"""A member's process on the bus: hears, lets its `Member` answer, and sends."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, Final

import zenoh

from minerva_bus.blame import blamed, report, whole
from minerva_bus.errors import BusError, ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.frame.member import Member, Refusal
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.events import Event
from minerva_bus.runtime.asking import ask, question_key
from minerva_bus.runtime.inbox import Heard, Inbox, heard
from minerva_bus.runtime.name import Name
from minerva_bus.runtime.notices import Claim, Count, Leave, Published, Pulse, Ungreeted
from minerva_bus.runtime.operating import AskingOperator
from minerva_bus.runtime.own_threads import OwnThreads
from minerva_bus.runtime.reconnect import CheckConnection, Diagnosed, ReconnectMonitor
from minerva_bus.runtime.restraint import Restraint
from minerva_bus.runtime.session import not_let_in
from minerva_bus.runtime.system import REAL, System, Timer, run_through
from minerva_bus.security.credentials import Credentials
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.epochs import stamp, stamped
from minerva_bus.wire.keys import COORDINATOR, Keys, checked_name
from minerva_bus.world.services import Device

RAISED: Final = 70
"""The exit code of a member whose user code failed, and would so again by the same input."""

RAISED_BY_CHANCE: Final = 75
"""The same, where another try may help: input and output, and whatever runs by the clock."""

NAME_FREE_AGAIN = 4.0
SHOWN_WITHIN = 0.25
ANSWERED_WITHIN = 1.0
CLAIMED_EVERY = 0.1
BACK_WITHIN = 5.0
LOOKED_AGAIN = 0.02


@dataclass(frozen=True, slots=True)
class Arrival:
    """For how many seconds who comes looks for the world, for its name, and waits for a greeting.

    A busy coordinator is waited for longer, `greeted_at_most` seconds.
    """

    seen: float = 1.0
    named: float = 2.0
    greeted: float = 10.0
    greeted_at_most: float = 60.0


ARRIVAL: Final = Arrival()
STARTED_HERE: Final = Arrival(60.0, 60.0, inf, inf)
"""Who was started by the world's launcher is right here; the launcher ends it if it takes long."""


class BusMember:
    """A participant with a Zenoh session of its own."""

    def __init__(
        self,
        participant: Member,
        world: str,
        endpoint: str,
        tell: Callable[[str], None],
        *,
        shared: bool = False,
        own: Credentials | None = None,
        ends: bool = False,
        back_within: float = BACK_WITHIN,
        arrival: Arrival = ARRIVAL,
        system: System = REAL,
    ) -> None:
        """A participant, the world of some name at an endpoint, and who shows that it is.

        `ends`: a free-running service that has said all there is to say leaves the world.
        `back_within`: seconds for which a world is looked for that is out of sight.
        """
        checked_name(participant.name, "a member")
        self._system = system
        self._arrival = arrival
        self.participant = participant
        self.keys = Keys(world)
        self.inbox = Inbox()
        self._endpoint = endpoint
        self._shared = shared
        self._own = own
        self._tell = tell
        self._decoder = Decoder()
        self._topics = f"{self.keys.base}/topic/"
        self._alive = self.keys.alive(COORDINATOR)
        self._name = Name(participant.name, self.keys.alive(participant.name))
        self._control = question_key(world, own)
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._shown_at = 0.0
        self._epoch = -1
        self._restraint = Restraint()
        self._stamp = b""
        self._monitor = ReconnectMonitor(
            f"{participant.name}: the world {world!r}",
            back_within,
            lambda: system.obstacle(endpoint, own),
            tell,
            self.inbox.put,
            system,
        )
        self._claimed_at = self._declared_at = 0.0
        self._greeting: Timer | None = None
        self._unheard = 0
        self._figures: m.Figures = {}
        self.failure: Exception | None = None
        self._threads = OwnThreads(participant.name, self.inbox.put, tell, system, ends=ends)
        self._deeds: dict[type, Callable[[Any], bool | None]] = {
            bytes: self._heard_first,
            Heard: self._heard_aside,
            Event: self._emit,
            Events: self._emit,
            Published: self._publish,
            Pulse: self._pulse,
            Count: self._tell_figures,
            Leave: self._leave,
            CheckConnection: self._look,
            Diagnosed: self._monitor.diagnosed,
            Claim: self._claim,
            Ungreeted: self._miss_greeting,
        }

    def leave(self) -> None:
        """Leave the world; may be called from a signal handler or another thread."""
        self.inbox.put(Leave())

    def run(self) -> int:
        """Take part until the world ends; the process's exit code.

        Raises BusError where the world cannot be reached and Refusal where it refuses.
        """
        return run_through(self.life())

    def life(self) -> Generator[None, None, int]:
        """The same, turn by turn: whoever drives it decides when the next one comes."""
        name, system = self.participant.name, self._system
        own, shared = self._own, self._shared
        with system.client(name, self._endpoint, shared=shared, own=own) as session:
            for _ in self._arrive(session):
                system.sleep(LOOKED_AGAIN)
                yield
            declared = self._declare(session)
            try:
                return (yield from self._take_part())
            finally:
                self._threads.stop()
                self._monitor.close()
                self.inbox.close()
                self._close_service()
                self._name.give_back()
                for one in declared:
                    one.undeclare()

    def _close_service(self) -> None:
        service = self.participant.service
        if service is not None:
            with blamed(service.close):
                service.close()

    def _ask(self, question: str, **details: Any) -> Mapping[str, Any]:
        answer = ask(self._session, self._control, question, ANSWERED_WITHIN, details)
        if answer is None:
            raise BusError(f"the world {self.keys.world!r} has not answered for a second")
        return answer

    def _arrive(self, session: zenoh.Session) -> Iterator[None]:
        """CheckConnection for the world, and wait for its own name, with a pause at each turn."""
        yield from self._find_world(session)
        self._session = session
        self.participant.operator = AskingOperator(self._ask)
        yield from self._name.until_free(session, self._system.monotonic, self._arrival.named)

    def _find_world(self, session: zenoh.Session) -> Iterator[None]:
        """A coordinator that is there can be seen at once; others would be waited for in vain."""
        key, until = self.keys.alive(COORDINATOR), self._system.monotonic() + self._arrival.seen
        while not list(session.liveliness().get(key, timeout=1.0)):
            if self._system.monotonic() > until:
                raise BusError(
                    f"there is no world {self.keys.world!r} at {self._endpoint};"
                    f" is that its name (minerva list)?{not_let_in(self._own)}"
                )
            yield

    def _declare(self, session: zenoh.Session) -> list[Any]:
        """Subscribers first, then publishers, the token last: so that nothing is missed."""
        name, keys, service = self.participant.name, self.keys, self.participant.service
        handler = self.inbox.handler
        first, *others = self._listens()
        declared = self.inbox.open(session, first)
        declared += [session.declare_subscriber(key, handler(heard)) for key in others]
        self._first = first
        self._answers = self._publisher(session, keys.sent_by(name))
        for topic in service.publishes if service is not None else ():
            key = keys.topic(topic, name)
            self._publishers[topic] = self._publisher(session, key)
        declared += [self._answers, *self._publishers.values()]
        liveliness = session.liveliness()
        declared.append(liveliness.declare_subscriber(self._alive, handler(heard), history=True))
        self._name.take(session)
        return list(reversed(declared))

    def _listens(self) -> list[str]:
        """The keys that it listens to, first the one on which most comes and is waited for."""
        participant, keys, service = self.participant, self.keys, self.participant.service
        listens = [keys.to(participant.name), keys.all, *map(keys.topic, participant.topics)]
        if isinstance(service, Device) and not service.coupled:
            listens += map(keys.view, service.draws)
        if participant.host.kinds:
            listens.insert(0, keys.evolve)
        hello = participant.hello()
        if hello.ticks and not hello.ahead:
            listens.insert(0, keys.tick)
        return listens

    def _publisher(self, session: zenoh.Session, key: str) -> zenoh.Publisher:
        return session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)

    def _take_part(self) -> Generator[None, None, int]:
        service = self.participant.service
        self._declared_at = self._system.monotonic()
        self._await_greeting()
        try:
            observes = isinstance(service, Device) and not service.coupled
            while not self.participant.stopped:
                item = self._shown_first() if observes else self.inbox.wait()
                if not self._handle(item):
                    return 0
                yield
        except (Refusal, BusError):
            raise
        except Exception as error:
            return self._report_failure(error)
        finally:
            self._cancel_greeting()
        return 0

    def _await_greeting(self) -> None:
        if self._arrival.greeted < inf:
            self._greeting = self._system.later(
                self._arrival.greeted, lambda: self.inbox.put(Ungreeted())
            )

    def _cancel_greeting(self) -> None:
        if self._greeting is not None:
            self._greeting.cancel()

    def _shown_first(self) -> Any:
        """The next item for an observer, who shows a view that nothing newer replaces.

        And one now and then also where something newer always comes.
        """
        item = self.inbox.ready()
        if item is None:
            self._show()
            return self.inbox.wait()
        if self._system.monotonic() > self._shown_at + SHOWN_WITHIN:
            self._show()
        return item

    def _show(self) -> None:
        self.participant.show()
        self._shown_at = self._system.monotonic()

    def _handle(self, item: Any) -> bool:
        """Deal with one item; False when it is time to go."""
        if isinstance(item, Exception):
            raise item
        deed = self._deeds.get(type(item))  # pyright: ignore[reportUnknownArgumentType]
        return deed is None or deed(item) is not False

    def _emit(self, event: AnyEvent) -> None:
        self._unheard += not self._stamp
        self._send(self.participant.emitted(event))
        self._threads.taken()

    def _publish(self, told: Published) -> None:
        self._send(self.participant.published(told.topic, told.reading))
        self._threads.taken()

    def _leave(self, _: Leave) -> bool:
        self._send(m.Leaving(self.participant.name))
        return False

    def _miss_greeting(self, _: Ungreeted) -> None:
        """A coordinator that answers, but does not greet, never will; a busy one does later."""
        if self.participant.world is not None:
            return
        waited = self._system.monotonic() - self._declared_at
        if waited < self._arrival.greeted_at_most and not self._is_answered():
            self._tell(f"{self.participant.name}: the world is busy; waiting for its greeting")
            self._await_greeting()
            return
        raise BusError(
            f"the world {self.keys.world!r} does not greet {self.participant.name};"
            " is that its name (minerva list)?"
        )

    def _is_answered(self) -> bool:
        """Whether the coordinator answers questions."""
        try:
            return ask(self._session, self._control, "status", ANSWERED_WITHIN, {}) is not None
        except BusError:
            return True  # It refuses, so it has heard.

    def _pulse(self, _: Pulse) -> bool:
        """Let the service look about; False when it wants to leave."""
        service = self.participant.service
        self._threads.felt()
        if service is None:
            return True
        with blamed(service.pulse):
            service.pulse()
        with blamed(service.leaves):
            leaves = service.leaves()
        return self._leave(Leave()) if leaves else True

    def _tell_figures(self, _: Count) -> None:
        """Tell how the member does, where that has changed."""
        figures = self.participant.figures()
        if figures != self._figures:
            self._figures = figures
            self._send(m.MemberMetrics(self.participant.name, figures))

    def _heard_first(self, data: bytes) -> None:
        body = self._of_my_coordinator(data)
        if body is not None:
            self._heard(self._first, body)

    def _heard_aside(self, item: Heard) -> bool:
        key = item.key
        if key.startswith(self._topics):
            self._heard(key, item.data)
        elif key != self._alive:
            body = self._of_my_coordinator(item.data)
            if body is not None:
                self._heard(key, body)
        elif item.there:
            self._find_again()
        else:
            self._lose()
        return True

    def _of_my_coordinator(self, data: bytes) -> bytes | None:
        """A message without its epoch; None where it is not from the coordinator that counts.

        That is the last one that has greeted, refused or stopped this member.
        """
        if self._stamp and data.startswith(self._stamp):
            return data[len(self._stamp) :]
        try:
            epoch, body = stamped(data)
        except ProtocolError:
            return None
        if epoch <= self._epoch or not _begins(self._decoder.to_member, body):
            return None
        self._epoch, self._stamp = epoch, stamp(epoch)
        return body

    # --- a world out of sight ---

    def _lose(self) -> None:
        """The world cannot be seen: it has ended, or the link to it has, for now.

        Whatever the coordinator says before it greets anew is not for this member: another may
        have taken its place. So it takes its name back when it is free, and not before.
        """
        if self._monitor.away:
            return
        self._monitor.lost()
        self._name.give_back()
        if self._stamp:
            self._epoch, self._stamp = self._epoch - 1, b""

    def _look(self, _: CheckConnection) -> bool:
        return self._monitor.check()

    def _find_again(self) -> None:
        if self._monitor.away:
            self._claimed_at = self._system.monotonic()
            self._claim(Claim())

    def _claim(self, _: Claim) -> None:
        """Take part again under its name. Raises BusError where another one has it now."""
        if not self._monitor.away:
            return
        if not self._name.taken(self._session):
            self._name.take(self._session)
            self._monitor.found()
            if self._unheard:
                self._tell(f"{self.participant.name}: {self._unheard} events of it were not heard")
                self._unheard = 0
        elif self._system.monotonic() < self._claimed_at + NAME_FREE_AGAIN:
            self._system.later(CLAIMED_EVERY, lambda: self.inbox.put(Claim()))
        else:
            raise BusError(
                f"the world {self.keys.world!r} is back, but there is another"
                f" {self.participant.name!r} in it by now: this one ends"
            )

    def _heard(self, key: str, data: bytes) -> None:
        message = self._decode(key, data)
        if message is None:
            return
        joining = self.participant.world is None
        for answer in self.participant.receive(message):
            self._send(answer)
        if joining and self.participant.world is not None:
            self._cancel_greeting()
            self._decoder = Decoder(self.participant.world.vocabulary)
            self._threads.start(self.participant.service)

    def _decode(self, key: str, data: bytes) -> m.ToMember | m.Readings | None:
        topic = key.split("/")[3:] if key.startswith(self._topics) else None
        try:
            if topic is not None:
                return self._decoder.readings(topic[0], topic[1], data)
            return self._decoder.to_member(data)
        except (ProtocolError, SceneError) as error:
            if self.participant.world is None:
                return None  # Before the welcome nothing with symbols in it can be read.
            if topic is None:
                raise  # Without what the coordinator says there is no taking part.
            self._drop_reading(topic[1], str(error))
            return None

    def _drop_reading(self, publisher: str, error: str) -> None:
        """Say that a reading is none, unless that was just said of its publisher very often."""
        now, name = self._system.monotonic(), self.participant.name
        for who, text in self._restraint.left_out(now):
            self._tell(f"{name}: from {who}: {text}")
        if self._restraint.lets(publisher, now):
            self._tell(f"{name}: from {publisher}: {error}; dropped")

    def _send(self, message: m.FromMember | m.Readings) -> None:
        """Send something; before the coordinator has greeted, nobody could know whom it is for."""
        if isinstance(message, m.Readings):
            self._publishers[message.topic].put(encode(message))
        elif self._stamp:
            self._answers.put(self._stamp + encode(message))

    def _report_failure(self, error: Exception) -> int:
        """Tell the coordinator that user code failed; the exit code."""
        self.failure = error
        frame = self.participant.frame
        self._send(m.Failed(self.participant.name, frame, report(error), whole(error)))
        outside = isinstance(error.__cause__ or error, OSError)
        return RAISED_BY_CHANCE if outside or frame < 0 else RAISED


def _begins(read: Callable[[bytes], m.ToMember], body: bytes) -> bool:
    """Whether a message is one that a coordinator begins, or ends, with."""
    try:
        return isinstance(read(body), m.Greet | m.Refused | m.Stop)
    except (ProtocolError, SceneError):
        return False
