"""A member's process on the bus: hears, lets its `Participant` answer, and sends."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable, Mapping
from typing import Any

import zenoh

from minerva_bus.bus.asking import ask
from minerva_bus.bus.inbox import Inbox
from minerva_bus.bus.notices import Count, Gone, Leave, Outlet, Published, Pulse, Ungreeted
from minerva_bus.bus.operating import AskingOperator
from minerva_bus.bus.session import open_client
from minerva_bus.bus.shortcut import nothing_to, says_nothing, tick
from minerva_bus.errors import BusError, MinervaError, ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.frame.participant import Participant, Refusal, Unready
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.events import Event
from minerva_bus.protocol.codec import Decoder, encode
from minerva_bus.protocol.keys import COORDINATOR, Keys, checked_name
from minerva_bus.world.services import Device, Generator

GREETING = 10.0
NAME_FREE = 2.0
WORLD_SEEN = 1.0
SHOWN_WITHIN = 0.25
ANSWERED_WITHIN = 1.0
BACK_WITHIN = 4.0
COUNTED_EVERY = 1.0


class BusMember:
    """A participant with a Zenoh session of its own."""

    def __init__(
        self,
        participant: Participant,
        world: str,
        endpoint: str,
        tell: Callable[[str], None],
        *,
        shared: bool = False,
    ) -> None:
        checked_name(participant.name, "a member")
        self.participant = participant
        self.keys = Keys(world)
        self.inbox = Inbox()
        self._endpoint = endpoint
        self._shared = shared
        self._tell = tell
        self._decoder = Decoder()
        self._topics = f"{self.keys.base}/topic/"
        self._alive = self.keys.alive(COORDINATOR)
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._stop = threading.Event()
        self._shown_at = 0.0
        self._pulsed = threading.Event()
        self._parting: threading.Timer | None = None
        self._figures: m.Figures = {}
        self._outlet = Outlet(self.inbox.put, self._stop)
        self._deeds: dict[type, Callable[[Any], bool | None]] = {
            bytes: self._heard_first,
            zenoh.Sample: self._heard_aside,
            Event: self._emit,
            Events: self._emit,
            Published: self._publish,
            Pulse: self._pulse,
            Count: self._tell_figures,
            Leave: self._leave,
            Gone: self._go,
            Ungreeted: self._miss_greeting,
        }

    def leave(self) -> None:
        """Leave the world; may be called from a signal handler or another thread."""
        self.inbox.put(Leave())

    def run(self) -> int:
        """Take part until the world ends; the process's exit code.

        Raises BusError where the world cannot be reached and Refusal where it refuses.
        """
        name = self.participant.name
        with open_client(name, self._endpoint, shared=self._shared) as session:
            self._find_world(session)
            self._session = session
            self.participant.operator = AskingOperator(self._ask)
            self._wait_for_name(session)
            declared = self._declare(session)
            try:
                return self._take_part()
            finally:
                self._stop.set()
                self.inbox.close()
                if self.participant.service is not None:
                    self.participant.service.close()
                for one in declared:
                    one.undeclare()

    def _ask(self, question: str, **details: Any) -> Mapping[str, Any]:
        answer = ask(self._session, self.keys.control, question, ANSWERED_WITHIN, details)
        if answer is None:
            raise BusError(f"the world {self.keys.world!r} has not answered for a second")
        return answer

    def _find_world(self, session: zenoh.Session) -> None:
        """A coordinator that is there can be seen at once; others would be waited for in vain."""
        key, until = self.keys.alive(COORDINATOR), time.monotonic() + WORLD_SEEN
        while not list(session.liveliness().get(key, timeout=1.0)):
            if time.monotonic() > until:
                raise BusError(
                    f"there is no world {self.keys.world!r} at {self._endpoint};"
                    " is that its name (minerva list)?"
                )
            time.sleep(0.02)

    def _wait_for_name(self, session: zenoh.Session) -> None:
        """A name is free some milliseconds after its last bearer has died."""
        key, until = self.keys.alive(self.participant.name), time.monotonic() + NAME_FREE
        while list(session.liveliness().get(key, timeout=1.0)):
            if time.monotonic() > until:
                raise BusError(
                    f"there is a member {self.participant.name!r} in the world already;"
                    " choose another name (--name)"
                )
            time.sleep(0.02)

    def _declare(self, session: zenoh.Session) -> list[Any]:
        """Subscribers first, then publishers, the token last: so that nothing is missed."""
        name, keys, service = self.participant.name, self.keys, self.participant.service
        handler = self.inbox.handler
        first, *others = self._listens()
        declared = self.inbox.open(session, first)
        declared += [session.declare_subscriber(key, handler()) for key in others]
        self._first = first
        self._answers = self._publisher(session, keys.sent_by(name))
        for topic in service.publishes if service is not None else ():
            key = keys.topic(topic, name)
            self._publishers[topic] = self._publisher(session, key)
        declared += [self._answers, *self._publishers.values()]
        liveliness = session.liveliness()
        declared.append(liveliness.declare_subscriber(self._alive, handler(), history=True))
        declared.append(liveliness.declare_token(keys.alive(name)))
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

    def _take_part(self) -> int:
        service = self.participant.service
        self._greeting = threading.Timer(GREETING, self.inbox.put, (Ungreeted(),))
        self._greeting.daemon = True
        self._greeting.start()
        try:
            observes = isinstance(service, Device) and not service.coupled
            while not self.participant.stopped:
                item = self._shown_first() if observes else self.inbox.wait()
                if not self._handle(item):
                    return 0
        except (Refusal, BusError):
            raise
        except Exception as error:
            self._report_failure(error)
            return 1
        finally:
            self._greeting.cancel()
        return 0

    def _shown_first(self) -> Any:
        """The next item for an observer, who shows a view that nothing newer replaces.

        And one now and then also where something newer always comes.
        """
        item = self.inbox.ready()
        if item is None:
            self._show()
            return self.inbox.wait()
        if time.monotonic() > self._shown_at + SHOWN_WITHIN:
            self._show()
        return item

    def _show(self) -> None:
        self.participant.show()
        self._shown_at = time.monotonic()

    def _handle(self, item: Any) -> bool:
        """Deal with one item; False when it is time to go."""
        if isinstance(item, Exception):
            raise item
        deed = self._deeds.get(type(item))  # pyright: ignore[reportUnknownArgumentType]
        return deed is None or deed(item) is not False

    def _emit(self, event: AnyEvent) -> None:
        self._send(self.participant.emitted(event))
        self._outlet.taken()

    def _publish(self, told: Published) -> None:
        self._send(self.participant.published(told.topic, told.reading))
        self._outlet.taken()

    def _leave(self, _: Leave) -> bool:
        self._send(m.Leaving(self.participant.name))
        return False

    def _go(self, _: Gone) -> bool:
        """The world was lost from sight; False unless it has come back."""
        if self._parting is None:
            return True
        self._tell(f"{self.participant.name}: the world {self.keys.world!r} is gone")
        return False

    def _miss_greeting(self, _: Ungreeted) -> None:
        if self.participant.world is None:
            raise BusError(
                f"the world {self.keys.world!r} does not greet {self.participant.name};"
                " is that its name (minerva list)?"
            )

    def _pulse(self, _: Pulse) -> bool:
        """Let the service look about; False when it wants to leave."""
        service = self.participant.service
        self._pulsed.clear()
        if service is None:
            return True
        service.pulse()
        return self._leave(Leave()) if service.leaves() else True

    def _tell_figures(self, _: Count) -> None:
        """Tell how the member does, where that has changed."""
        figures = self.participant.figures()
        if figures != self._figures:
            self._figures = figures
            self._send(m.Doing(self.participant.name, figures))

    def _count(self) -> None:
        while not self._stop.wait(COUNTED_EVERY):
            self.inbox.put(Count())

    def _give_pulses(self, every: float) -> None:
        """Knock every so many seconds, but not while a pulse still waits to be felt."""
        while not self._stop.wait(every):
            if not self._pulsed.is_set():
                self._pulsed.set()
                self.inbox.put(Pulse())

    def _heard_first(self, data: bytes) -> None:
        message = tick(data) if self.participant.world is not None else None
        if message is None:
            self._heard(self._first, data)
            return
        for answer in self.participant.receive(message):
            if says_nothing(answer, message.frame):
                self._answers.put(nothing_to(data))
            else:
                self._send(answer)

    def _heard_aside(self, sample: zenoh.Sample) -> bool:
        key = str(sample.key_expr)
        if key != self._alive:
            self._heard(key, sample.payload.to_bytes())
        elif sample.kind == zenoh.SampleKind.DELETE:
            self._lose()
        else:
            self._find_again()
        return True

    def _lose(self) -> None:
        """The world cannot be seen: it has ended, or the link to it has, for now."""
        if self._parting is None:
            self._tell(
                f"{self.participant.name}: the world {self.keys.world!r} cannot be seen;"
                f" it may come back within {BACK_WITHIN:.0f} s"
            )
            self._parting = threading.Timer(BACK_WITHIN, self.inbox.put, (Gone(),))
            self._parting.daemon = True
            self._parting.start()

    def _find_again(self) -> None:
        if self._parting is not None:
            self._parting.cancel()
            self._parting = None
            self._tell(f"{self.participant.name}: the world {self.keys.world!r} is back")

    def _heard(self, key: str, data: bytes) -> None:
        message = self._decode(key, data)
        if message is None:
            return
        joining = self.participant.world is None
        for answer in self.participant.receive(message):
            self._send(answer)
        if joining and self.participant.world is not None:
            self._greeting.cancel()
            self._decoder = Decoder(self.participant.world.vocabulary)
            self._run_freely()

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
            self._tell(f"{self.participant.name}: from {topic[1]}: {error}; dropped")
            return None

    def _send(self, message: m.FromMember | m.Readings) -> None:
        readings = isinstance(message, m.Readings)
        publisher = self._publishers[message.topic] if readings else self._answers
        publisher.put(encode(message))

    def _report_failure(self, error: Exception) -> None:
        frame = self.participant.frame
        shown = "".join(traceback.format_exception(error))
        problem = (
            str(error) if isinstance(error, MinervaError) else f"{type(error).__name__}: {error}"
        )
        self._send(m.Failed(self.participant.name, frame, problem, shown))

    def _run_freely(self) -> None:
        service = self.participant.service
        if isinstance(service, Generator) and not service.lockstep:
            threading.Thread(target=self._emit_all, args=(service,), daemon=True).start()
        if service is not None:
            threading.Thread(target=self._count, daemon=True).start()
        if service is not None and service.pulse_every > 0:
            every = service.pulse_every
            threading.Thread(target=self._give_pulses, args=(every,), daemon=True).start()

    def _emit_all(self, service: Generator) -> None:
        try:
            service.run(self._outlet, self._stop)
        except MinervaError as error:
            self.inbox.put(Unready(f"{self.participant.name} cannot go on: {error}"))
        except Exception as error:
            self.inbox.put(error)
