"""Generator side of a member: answers ticks from readings, orders and its service.

It normalizes what a service's methods return. `generate` returns events, one event or None. `save`
returns any plain value. On the bus and in records that is always a mapping, so any other value is
sent as the only entry of one.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import deepcopy
from operator import attrgetter
from types import GeneratorType
from typing import Any, Final, TypeAlias, cast

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.frame import messages as m
from minerva_bus.frame.messages import SAVED_VALUE, Readings
from minerva_bus.frame.placement import placed
from minerva_bus.grammar.events import AnyEvent, Event, Events, check_number, chosen, in_columns
from minerva_bus.grammar.ids import no_id
from minerva_bus.grammar.scene import AGENT_ID
from minerva_bus.grammar.vocabulary import EventType, Vocabulary
from minerva_bus.user_code import blamed
from minerva_bus.world.context import Frame
from minerva_bus.world.event_order import by_receiver
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import Device, Generator, Service, Tick, When

MAX_DEPTH: Final = 100
"""Lists and mappings that may be nested in saved data."""

_SURROGATE: Final = re.compile("[\ud800-\udfff]")

MAX_READINGS: Final = 1000
"""Readings of one publisher that wait for a frame; the oldest are dropped."""


class ReadingBuffer:
    """Readings by topic and publisher, until a tick takes them.

    Of a publisher in step it keeps the readings of one frame. A free-running publisher may be
    faster than the frames: `takes` selects its newest reading, or all since the last frame, of
    which only every `nth` is used. `dropped` is the number of unused readings.
    """

    def __init__(self, takes: str = "newest", nth: int = 1) -> None:
        self.dropped: int = 0
        self._limit = MAX_READINGS if takes == "all" else 1
        self._nth = nth
        self._in_step: dict[tuple[str, str], Readings] = {}
        self._free: dict[tuple[str, str], deque[Reading]] = {}
        self._received: dict[tuple[str, str], int] = {}

    def put(self, readings: Readings) -> None:
        """Add readings that have arrived."""
        key = readings.topic, readings.member
        if readings.frame >= 0:
            kept = self._in_step.get(key)
            # Repeated readings of an earlier frame must not replace newer ones.
            if kept is None or kept.frame <= readings.frame:
                self._in_step[key] = readings
            return
        waiting = self._free.setdefault(key, deque())
        for reading in readings.readings:
            # Counted by publisher, so that every nth reading of each is
            # used, independent of their interleaving.
            number = self._received[key] = self._received.get(key, 0) + 1
            if number % self._nth:
                self.dropped += 1
                continue
            waiting.append(reading)
            if len(waiting) > self._limit:
                waiting.popleft()
                self.dropped += 1

    def missing(self, frame: int, sources: Mapping[str, tuple[str, ...]]) -> Iterator[str]:
        """The publishers in step whose readings of a frame have not arrived."""
        for topic, publishers in sorted(sources.items()):
            for publisher in publishers:
                readings = self._in_step.get((topic, publisher))
                if readings is None or readings.frame != frame:
                    yield publisher

    def taken(self, frame: int, serves: Callable[[str], bool]) -> tuple[Reading, ...]:
        """Remove and return the readings used in a frame, by robot, topic and publisher.

        Those of robots that another process `serves` are left out.
        """
        if not self._in_step and not self._free:
            return ()
        # Readings of an earlier frame are those of a publisher that has left, or repeated for a
        # newcomer: they were used in their own frame.
        taken = {
            key: message.readings
            for key, message in self._in_step.items()
            if message.frame == frame
        }
        taken |= {key: tuple(waiting) for key, waiting in self._free.items()}
        self._in_step = {
            key: message for key, message in self._in_step.items() if message.frame > frame
        }
        self._free = {}
        own = [each for _, sent in sorted(taken.items()) for each in sent if serves(each.robot)]
        # By robot first, because several processes may divide the robots of a publisher.
        return tuple(sorted(own, key=attrgetter("robot")))

    def clear(self) -> None:
        """Forget all readings, because the member rejoins."""
        self._in_step, self._free = {}, {}


Outgoing: TypeAlias = m.FromMember | m.Readings


class GeneratorSide:
    """Answers the ticks of one member.

    A tick is answered once the readings of all publishers in step for its frame have arrived.
    The latest answer is kept, because a successor of the coordinator requests it again.
    `asked` is the frame whose tick is not answered yet, or None; `publishers` are those in step, by
    topic. `processes` divide the agents of the generator `source`: this member is one of them, or
    the only one.
    """

    def __init__(self, name: str, service: Service | None, when: When) -> None:
        self._name = self.source = name
        self.processes: tuple[str, ...] = (name,)
        self._service = service
        self._is_awaited = when.is_awaited
        self._generates: frozenset[str] = frozenset()
        self._initial: Mapping[str, Any] | None = None
        self._answered = -1
        self._answer: tuple[Outgoing, ...] = ()
        self.publishers: dict[str, tuple[str, ...]] = {}
        self._published: dict[str, m.Readings] = {}
        self._orders: dict[int, tuple[AnyEvent, ...]] = {}
        self._obeyed: dict[int, int] = {}
        self.asked: int | None = None
        self.buffer = (
            ReadingBuffer() if service is None else ReadingBuffer(service.takes, service.nth)
        )

    # --- joining ---

    def join(self, saved: Mapping[str, Any] | None) -> None:
        """Continue from the data that an earlier process of this member saved, if any."""
        self._generates = frozenset(generated_types(self._service))
        if self._service is not None and saved is not None:
            # The state before the first frame, to which `rejoin` may return. A deep copy, because
            # the service may still change the objects that it saved.
            self._initial = deepcopy(saved_by(self._service))
            restore(self._service, saved)

    def clear(self) -> None:
        """Discard the requests and readings from before the member rejoined."""
        self.asked = None
        self.buffer.clear()

    def rejoin(self, service: Service, welcome: m.Welcome) -> None:
        """Return to the state before a frame; answers given in that frame can be repeated."""
        # A member that has answered the tick of this frame keeps its state and repeats that answer.
        if welcome.frame != self._answered:
            # Marks the frame before as answered, so that `repeated` does not accept an older tick.
            self._answered, self._answer = welcome.frame - 1, ()
            # Nothing is saved of a first frame that never ended: return to before it.
            saved = self._initial if welcome.saved is None else welcome.saved
            if saved is not None:
                restore(service, saved)

    # --- ticks ---

    def sources(self, sources: m.Sources, topics: Iterable[str]) -> None:
        """Note which members in step publish the topics of this generator."""
        if not isinstance(self._service, Generator):
            return  # Only generators answer for the readings of a frame.
        published = sources.publishers
        self.publishers = {topic: published[topic] for topic in topics if topic in published}

    def repeated(self, frame: int) -> tuple[Outgoing, ...] | None:
        """The answer to a tick that was answered before; None for a new one.

        A new tick becomes the unanswered one, unless it is older than those that were answered.
        """
        if frame == self._answered:
            return self._answer
        # A tick older than the latest answer cannot be answered: the state of its frame is gone.
        if frame > self._answered:
            self.asked = frame
        return None

    def missing(self) -> Iterator[str]:
        """The publishers whose readings of the unanswered tick's frame have not arrived."""
        return self.buffer.missing(-1 if self.asked is None else self.asked, self.publishers)

    def answer(self, frame: Frame, vocabulary: Vocabulary) -> tuple[Outgoing, ...]:
        """C^d(t): the events of a frame, and the readings that are published."""
        self.asked = None
        self._answer = self._made(frame, vocabulary)
        self._answered = frame.number
        return self._answer

    def _made(self, frame: Frame, vocabulary: Vocabulary) -> tuple[Outgoing, ...]:
        service = self._service
        # A coupled device without events answers as well: the frame
        # waits until it has acted on its view.
        if not (isinstance(service, Generator) and self._is_awaited):
            answers = isinstance(service, Device) and service.coupled
            return (m.TickReply(self._name, frame.number),) if answers else ()
        readings = self.buffer.taken(frame.number, self.serves)
        # Random streams are those of the generator, whatever its number of processes.
        tick = Tick(frame, self.source, readings=readings, orders=self._ordered(frame.number))
        with blamed(service.generate):
            made = service.generate(tick)
            # Most answers of a large world are empty.
            empty = made is None or (isinstance(made, tuple) and not made)
            checked = () if empty else self.checked(made_events(made), vocabulary)
            if self.processes[1:]:
                checked = tuple(by_receiver(self._own(checked, tick)))
            events = in_columns(checked) if checked else ()
            published = self._publish(service, tick) if service.publishes or tick.published else ()
        # Readings are sent before the reply. If the process dies between the two, it has not
        # answered, so its successor receives the request and publishes them again.
        return (*published, m.TickReply(self._name, frame.number, events, saved_by(service)))

    # --- orders ---

    def take_orders(self, orders: m.Orders) -> None:
        """Keep people's orders for a frame.

        A successor of the coordinator sends the orders of a frame again; those that have been
        executed are left out.
        """
        frame, obeyed = orders.frame, self._obeyed.get(orders.frame)
        if obeyed is None:
            self._orders[frame] = orders.events
        elif orders.events[obeyed:]:
            self._orders[frame + 1] = orders.events[obeyed:]

    def _ordered(self, frame: int) -> tuple[AnyEvent, ...]:
        """People's orders for a frame, and for earlier ones without a tick."""
        # Orders for a frame in which the member was away must not be lost.
        due: list[AnyEvent] = []
        self._obeyed = {frame: len(self._orders.get(frame, ()))}
        for number in sorted(self._orders):
            if number <= frame:
                due += self._orders.pop(number)
        return tuple(due)

    # --- events and readings ---

    def checked(self, events: Iterable[AnyEvent], vocabulary: Vocabulary) -> tuple[AnyEvent, ...]:
        """Events, checked against the vocabulary and the declaration. Raises MisuseError."""
        checked: list[AnyEvent] = []
        for made in events:
            event = vocabulary.check_any(made, self._name)
            checked.append(event)
            if event.type not in self._generates:
                service = type(self._service).__name__
                raise MisuseError(
                    f"it makes {event.type}, which it does not declare;"
                    f' write class {service}(Generator, events=("{event.type}",'
                    " ...))"
                )
        return tuple(checked)

    def serves(self, agent: str) -> bool:
        """Whether this process makes the events of an agent, which may not be in the string."""
        return placed(agent, self.processes) == self._name

    def _own(self, events: Iterable[AnyEvent], tick: Tick) -> Iterator[AnyEvent]:
        """The events for agents of this process; the others make those of the other agents.

        Raises MisuseError for what depends on the number of processes.
        """
        drawn = tick.streams is not None or tick._rng is not None  # pyright: ignore[reportPrivateUsage]
        for event in events:
            receivers = event.receivers or ()
            if drawn or len(receivers) != len(event):
                rule = "needs one receiver and no tick.random: several processes divide the agents"
                raise MisuseError(f"{event.type} {rule}; see Generator.by_agent")
            rows = np.flatnonzero([self.serves(agent) for agent in receivers])
            yield from chosen(event, rows)

    def _publish(self, service: Service, tick: Tick) -> list[m.Readings]:
        # A publisher in step sends one message on each of its topics per tick, even an empty one,
        # because subscribers wait for it.
        by_topic: dict[str, list[Reading]] = {topic: [] for topic in service.publishes}
        for topic, reading in tick.published:
            self._check_reading(service, topic, reading)
            if self.serves(reading.robot):
                by_topic[topic].append(reading)
        messages = {
            topic: m.Readings(self._name, topic, tick.number, tuple(readings))
            for topic, readings in by_topic.items()
        }
        self._published |= messages
        return list(messages.values())

    def _check_reading(self, service: Service, topic: str, reading: Reading) -> None:
        if topic not in service.publishes:
            raise MisuseError(f"{self._name} publishes on {topic!r}; declare it in `publishes`")
        # A generator such as `laser` sends its events to this agent, and would fail instead.
        if AGENT_ID.fullmatch(reading.robot) is None:
            kind = type(reading).__name__
            raise MisuseError(
                f"{self._name}: robot of a {kind} on {topic!r}: {no_id(reading.robot)}"
            )

    def last_published(self, topic: str) -> m.Readings | None:
        """The latest readings on a topic."""
        return self._published.get(topic)

    def published(self, topic: str, reading: Reading) -> m.Readings:
        """The message for a reading of a free-running publisher. Raises MisuseError."""
        assert self._service is not None
        self._check_reading(self._service, topic, reading)
        return m.Readings(self._name, topic, -1, (reading,))


def generated_types(service: Service | None) -> tuple[str, ...]:
    """The event types that a service generates. Raises UserCodeError."""
    if not isinstance(service, Generator):
        return ()
    with blamed(service.generates):
        return tuple(service.generates())


def ordered_types(service: Service | None) -> tuple[str, ...]:
    """The event types whose orders a service takes. Raises UserCodeError."""
    if not isinstance(service, Generator):
        return ()
    with blamed(service.takes_orders):
        return tuple(service.takes_orders())


# --- what a service's methods return ---


def made_events(made: Any) -> Iterator[AnyEvent]:
    """The events in the result of `generate`: None, an event, or an iterable of both.

    Raises TypeError, and MisuseError for more than `check_number` allows.
    """
    if made is None:
        return
    # Checked before Iterable, because an event and a batch are iterable themselves.
    if isinstance(made, Event | Events):
        yield made
        return
    # A text and a mapping are iterable, but their letters and keys are not what was meant.
    # Generators and lists are found without the checks of abstract classes.
    result: object = made
    if not isinstance(result, GeneratorType | list | tuple) and (
        isinstance(result, str | bytes | Mapping) or not isinstance(result, Iterable)
    ):
        raise TypeError(f"expected events, one event or None, not {_named(made)}")
    for number, item in enumerate(cast("Iterable[object]", result)):
        check_number(number)
        if item is not None:
            if not isinstance(item, Event | Events):
                raise TypeError(f"expected events, not {_named(item)}")
            yield item


def _named(made: object) -> str:
    if isinstance(made, EventType):
        return f"the event type {made.name}; an event is {made.name}(...)"
    return f"{made!r:.100}"


def saved_by(service: Service) -> Mapping[str, Any] | None:
    """A service's saved data as a mapping, or None. Raises UserCodeError if they are not plain."""
    if getattr(service.save, "__func__", None) is Service.save:
        return None  # as most services do
    with blamed(service.save):
        saved: Any = service.save()
        _check_plain(saved, "it")
    if saved is None:
        return None
    if isinstance(saved, Mapping):
        names = cast("Mapping[str, Any]", saved)
        # A mapping that has this as its only key is wrapped too, or `restore` would unwrap it.
        return {SAVED_VALUE: names} if set(names) == {SAVED_VALUE} else names
    return {SAVED_VALUE: saved}


def restore(service: Service, saved: Mapping[str, Any]) -> None:
    """Restore a service from the data that its predecessor saved, if any. Raises UserCodeError."""
    value: Any = saved[SAVED_VALUE] if set(saved) == {SAVED_VALUE} else saved
    if value is None:
        return
    with blamed(service.restore):
        service.restore(value)


def figures_by(service: Service) -> dict[str, bool | int | float | str]:
    """The figures that a service reports. Raises UserCodeError for invalid ones.

    Numbers that are not finite are omitted: the protocol forbids them.
    """
    with blamed(service.report):
        returned: Any = service.report()
        if not isinstance(returned, Mapping | None):
            raise MisuseError(
                f"it returns {returned!r:.60}; figures are a mapping of names to values, such as"
                ' {"distance": 1.5}'
            )
        reported = cast("Mapping[Any, Any]", returned or {})
        named = [(name, _figure(name, value)) for name, value in reported.items()]
    return {
        name: value for name, value in named if not isinstance(value, float) or math.isfinite(value)
    }


def _figure(name: Any, value: Any) -> bool | int | float | str:
    """A figure as a value of Python. Raises MisuseError."""
    if isinstance(value, np.generic):
        value = cast("Any", value).item()
    if not isinstance(name, str) or not isinstance(value, bool | int | float | str):
        raise MisuseError(
            f"it reports {name!r:.60} as {type(value).__name__}; a figure is a boolean, a number"
            " or a text, and its name a text"
        )
    _check_scalar(name, "the name of a figure")
    _check_scalar(value, f"its figure {name!r:.60}")
    return value


def _check_plain(value: Any, where: str, depth: int = 0) -> None:
    """Raise MisuseError for a value that cannot be sent or recorded."""
    if depth > MAX_DEPTH:
        raise MisuseError(f"{where[:60]}... is nested more than {MAX_DEPTH} deep")
    if value is None or isinstance(value, bool | int | float | str | bytes):
        _check_scalar(value, where)
    elif isinstance(value, list | tuple):
        for place, item in enumerate(cast("Iterable[Any]", value)):
            _check_plain(item, f"{where}[{place}]", depth + 1)
    elif isinstance(value, Mapping):
        for key, item in cast("Mapping[object, Any]", value).items():
            if not isinstance(key, str):
                raise MisuseError(f"{where} has the key {key!r:.60}; keys are texts")
            _check_scalar(key, f"a key of {where}")
            _check_plain(item, f"{where}[{key!r}]", depth + 1)
    else:
        raise MisuseError(
            f"{where} is of type {type(value).__name__}; what is saved is None, a boolean, a"
            " number, a text, bytes, or a list or mapping of these"
        )


def _check_scalar(value: object, where: str) -> None:
    """Raise MisuseError for a number or a text that MessagePack cannot represent."""
    if isinstance(value, int) and not -(1 << 63) <= value < 1 << 64:
        raise MisuseError(f"{where} is a whole number of more than 64 bits; use a text instead")
    if isinstance(value, str) and not value.isascii() and _SURROGATE.search(value):
        raise MisuseError(f"{where} is a text with lone surrogates; expected valid Unicode")
