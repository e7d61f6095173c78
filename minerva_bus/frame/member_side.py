"""Member side of the frame protocol as a pure state machine: messages in, messages out.

The same object is used on the bus, in one process and in tests. It calls the user code.
`GeneratorSide` answers ticks from readings, orders and its service. `DeviceSide` assembles views
from keyframes and deltas, and shows them. `Host` evolves and visualizes the fragments that it
holds.

What a service's methods return is normalized. `generate` returns events, one event or None. `save`
returns any plain value. On the bus and in records that is always a mapping, so any other value is
sent as the only entry of one.
"""

from __future__ import annotations

import math
import os
import platform
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from operator import attrgetter
from types import GeneratorType
from typing import Any, Final, TypeAlias, cast

import numpy as np

from minerva_bus.errors import (
    MinervaError,
    MisuseError,
    ProtocolError,
    UserCodeError,
    VocabularyError,
)
from minerva_bus.frame import messages as m
from minerva_bus.frame.composition import Fragment, applied, fragment_in
from minerva_bus.frame.messages import (
    PROTOCOL_VERSION,
    SAVED_VALUE,
    Changes,
    EvolveReply,
    EvolveRequest,
    Fragments,
    Readings,
)
from minerva_bus.frame.placement import placed
from minerva_bus.grammar.columns import Delta, difference, has_columns, size
from minerva_bus.grammar.events import AnyEvent, Event, Events, check_number, chosen, in_columns
from minerva_bus.grammar.ids import RowDelta, no_id, row_delta_of_ids
from minerva_bus.grammar.scene import AGENT_ID, Scene, kind_counts
from minerva_bus.grammar.vocabulary import EventType, Vocabulary
from minerva_bus.user_code import blamed, handler_name
from minerva_bus.world.agent import Agent, Kinds, kinds_of, with_own_fields
from minerva_bus.world.context import Frame
from minerva_bus.world.event_collection import Addressed, by_receiver
from minerva_bus.world.evolution import Evolved, Policy, evolve
from minerva_bus.world.operator import NoOperator, Operator
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import (
    Device,
    Generator,
    Service,
    Tick,
    View,
    When,
    WorldInfo,
    check_attributes,
)
from minerva_bus.world.visualization import visualize

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
        orders = self._ordered(frame.number)
        # With empty lists, because the factories of their types would take as long as all else.
        tick = Tick(frame, self.source, [], readings=readings, orders=orders, published=[])
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
        for number in sorted(self._orders) if self._orders else ():
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
    if isinstance(made, (Event, Events)):
        yield made
        return
    # A text and a mapping are iterable, but their letters and keys are not what was meant.
    # Generators and lists are found without the checks of abstract classes.
    result: object = made
    if not isinstance(result, (GeneratorType, list, tuple)) and (
        isinstance(result, (str, bytes, Mapping)) or not isinstance(result, Iterable)
    ):
        raise TypeError(f"expected events, one event or None, not {_named(made)}")
    for number, item in enumerate(made):
        check_number(number)
        if item is not None:
            if not isinstance(item, (Event, Events)):
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


@dataclass(slots=True)
class _Picture:
    """The current view of one visual event type."""

    sequence: int
    skeleton: Scene
    parts: dict[str, Scene]
    halted: frozenset[str] = frozenset()


SHOWN_VIEWS: Final = "views of "
"""How the name of a figure begins that says how many views a device has shown."""


class DeviceSide:
    """Views of one member by visual event type, and which of them have not been shown.

    `every`: of so many frames it shows one view; others may ask for views of the same type.
    """

    def __init__(self, service: Service | None, every: int) -> None:
        self._service = service
        self._every = every
        self._pictures: dict[str, _Picture] = {}
        self._unshown: dict[str, int] = {}
        self._latest: dict[str, int] = {}
        self._due = self._views = 0

    def rejoin(self) -> None:
        """Accept the next keyframes regardless of their sequence number."""
        for picture in self._pictures.values():
            picture.sequence = -1

    def take(self, shown: m.ViewShown) -> bool:
        """Apply a keyframe or a delta; False if a view was missed, so that a keyframe is needed."""
        picture = self._pictures.get(shown.event_type)
        if shown.skeleton is not None:
            # Equal numbers count: a requested keyframe repeats the sequence of the latest view.
            if picture is None or shown.sequence >= picture.sequence:
                picture = _Picture(shown.sequence, shown.skeleton, applied({}, shown.parts))
                self._pictures[shown.event_type] = picture
                self._changed(shown)
            return True
        # Deltas cannot be applied after a gap; a keyframe replaces all missed views.
        if picture is None or shown.sequence > picture.sequence + 1:
            return False
        # A delta with a lower number is contained in the keyframe that arrived before it.
        if shown.sequence > picture.sequence:
            picture.sequence = shown.sequence
            picture.parts.update(applied(picture.parts, shown.parts))
            self._changed(shown)
        return True

    def _changed(self, shown: m.ViewShown) -> None:
        self._pictures[shown.event_type].halted = frozenset(shown.halted)
        self._unshown[shown.event_type] = shown.frame

    def show(self, begin: Callable[[int], None], *, last: bool = False) -> None:
        """Show the pending views on the device; `begin` gets the frame of each view.

        A coupled device shows each view at once. An observer that fell behind shows only the
        latest view of each event type, to catch up. `last`: no view follows.
        """
        for event_type, frame in sorted(self._unshown.items()) if self._unshown else ():
            latest, every = self._latest.get(event_type, frame), self._every
            # The same frame again, or an earlier one, comes from a record that is wound back.
            if every and latest < frame and latest // every == frame // every and not last:
                continue
            # Only "each frame" says that there was a view in each frame in between.
            self._due += max(1, frame - latest) if every == 1 else 1
            self._views += 1
            self._latest[event_type] = frame
            del self._unshown[event_type]
            begin(frame)
            if isinstance(self._service, Device):
                picture = self._pictures[event_type]
                # A copy, because the device may keep the view, and the next
                # delta changes the parts in place.
                view = View(
                    frame, event_type, picture.skeleton, dict(picture.parts), picture.halted
                )
                with blamed(self._service.show):
                    self._service.show(view)

    def figures(self, name: str) -> dict[str, bool | int | float | str]:
        """How many views of each frame it has shown, if not all and people do not look at it."""
        if self._views == self._due or self._service is None or self._service.interactive:
            return {}
        text = f"{self._views:,} of {self._due:,} shown; a coupled device misses none"
        return {f"{SHOWN_VIEWS}{name}": text}


_TYPE: Final = attrgetter("type")


@dataclass(frozen=True, slots=True)
class _Shown:
    """A view with its fragment and events, which determine it (equation 4)."""

    piece: Fragment
    events: tuple[AnyEvent, ...]
    view: Scene


class Host:
    """Steps 5 and 6 of Table 2 for the fragments of one host."""

    def __init__(self, name: str, kinds: Mapping[str, type[Agent]]) -> None:
        self.name = name
        self.kinds: Kinds = kinds
        self.fragments: dict[str, Fragment] = {}
        self._shown: dict[tuple[str, str], _Shown] = {}

    def clear(self) -> None:
        """Drop all fragments."""
        self.fragments, self._shown = {}, {}

    def take(self, given: Fragments) -> None:
        """Store given fragments and drop others. Raises ProtocolError."""
        for fragment in given.dropped:
            self._drop(fragment)
        for fragment, scene in given.given.items():
            # `_drop` also forgets the views, because the coordinator
            # expects whole ones of a given fragment.
            self._drop(fragment)
            piece = fragment_in(scene, fragment)
            if piece is None:
                raise ProtocolError(f"the fragment #{fragment} is not an agent of that name")
            self.fragments[fragment] = piece

    def _drop(self, fragment: str) -> None:
        self.fragments.pop(fragment, None)
        for key in [key for key in self._shown if key[1] == fragment]:
            del self._shown[key]

    def answer(
        self, request: EvolveRequest, frame: Frame, policy: Policy, vocabulary: Vocabulary
    ) -> EvolveReply:
        """η and π over the fragments that a request concerns. Raises ProtocolError.

        Without events agents keep their state, unless the policy says otherwise.
        """
        concerned = request.only or tuple(self.fragments)
        # Checked before anything evolves, since a fragment may evolve only once in a frame.
        for name in concerned:
            if name not in self.fragments:
                raise ProtocolError(f"frame {request.frame} is about #{name}, never given here")
        views: dict[str, Changes] = {}
        # Views are first: they show the string before the evolution, which replaces the fragments.
        for event_type in sorted(set(map(_TYPE, request.visual))) if request.visual else ():
            views[event_type] = self._views(event_type, concerned, request.visual, frame)
        events = Addressed(request.events)
        changed: dict[str, Scene | Delta] = {}
        emitted: dict[str, tuple[AnyEvent, ...]] = {}
        evolving = bool(request.events) or policy.rules.without_events
        for fragment in concerned if evolving else ():
            was = Scene((self.fragments[fragment],))
            result = evolve(was, events, self.kinds, frame, policy)
            try:
                if result.emitted or result.batches:
                    emitted.update(_checked(fragment, result, vocabulary))
                # Evolution shares unchanged objects, so identity detects changes at once.
                if result.scene is not was:
                    now = vocabulary.check(result.scene, f"#{fragment}")
                    changed[fragment] = _delta(was, now) or now
                    self._keep(fragment, now)
            except VocabularyError as error:
                raise self._unknown(was, events) from error
        return EvolveReply(self.name, request.frame, request.part, changed, emitted, views)

    def _unknown(self, scene: Scene, events: Addressed) -> UserCodeError:
        """The error of the methods whose result, or events, the vocabulary lacks."""
        classes = [
            self.kinds[name] for name in sorted(kind_counts(*scene.pieces)) if name in self.kinds
        ]
        types = dict.fromkeys(event.type for event in events.events)
        called = [
            cls.activities[each] for cls in classes for each in types if each in cls.activities
        ]
        names = " or ".join(dict.fromkeys(map(handler_name, called)))
        return UserCodeError(names or "its agents", called[-1] if called else None)

    def _keep(self, fragment: str, scene: Scene) -> None:
        """Store a fragment's result; one with newborns returns from the coordinator when placed."""
        now = fragment_in(scene, fragment)
        if now is None:
            self._drop(fragment)
        else:
            self.fragments[fragment] = now

    def _views(
        self, event_type: str, concerned: Sequence[str], visual: Sequence[AnyEvent], frame: Frame
    ) -> Changes:
        """The views for one event type that differ from the last ones.

        The first view of a fragment always counts as changed, even if it is ε, because its view on
        its former host is unknown here.
        """
        events = Addressed(tuple([event for event in visual if event.type == event_type]))
        views: dict[str, Scene | Delta] = {}
        for fragment in concerned:
            piece, shown = self.fragments[fragment], self._shown.get((event_type, fragment))
            if shown is not None and shown.piece is piece and shown.events == events.events:
                continue
            view = visualize(Scene((piece,)), events, self.kinds, frame.number)
            # Stored even if the view has not changed: the next
            # frame compares fragments by identity.
            self._shown[event_type, fragment] = _Shown(piece, events.events, view)
            delta = _view_delta(shown, piece, view) if shown is not None else None
            # An empty delta means that the fragment has changed and its
            # view has not, so nothing is sent.
            if delta is not None and not delta.empty:
                views[fragment] = delta
            # Views in columns without a common delta are sent: a comparison would need a digest.
            elif delta is None and (shown is None or has_columns(view) or shown.view != view):
                views[fragment] = view
        return views


def _delta(old: Scene, new: Scene, row_delta: RowDelta | None = None) -> Delta | None:
    """Delta between two strings, if each is one piece in columns with rows in the same order."""
    if len(old.pieces) != 1 or len(new.pieces) != 1:
        return None
    return difference(old.pieces[0], new.pieces[0], row_delta)


def _view_delta(shown: _Shown, piece: Fragment, view: Scene) -> Delta | None:
    """Delta between two views; rows were added and removed as in the fragment they show."""
    old, new = shown.piece, piece
    row_delta = None
    if old.ids is not None and new.ids is not None:
        # Only if each agent has exactly one piece of view do the rows of both correspond.
        whole = size(shown.view.pieces) == old.count and size(view.pieces) == new.count
        if old.ids is not new.ids and whole:
            row_delta = row_delta_of_ids(old.ids, new.ids)
    return _delta(shown.view, view, row_delta)


def _checked(
    fragment: str, result: Evolved, vocabulary: Vocabulary
) -> dict[str, tuple[AnyEvent, ...]]:
    """Checked events: by agent, or by fragment for agents in columns."""
    sent: dict[str, tuple[AnyEvent, ...]] = {
        agent: tuple([vocabulary.check_event(event, f"#{agent}") for event in events])
        for agent, events in result.emitted.items()
    }
    if result.batches:
        sent[fragment] = tuple([vocabulary.check_any(event, fragment) for event in result.batches])
    return sent


class Refusal(MinervaError):
    """The world does not accept this member."""


class Unready(Refusal):
    """The member cannot take part in this world, as its service reports."""


class WorldRestarted(Refusal):
    """The world has restarted, so the member must join it with its initial state."""


class Member:
    """One member: agents of some kinds, or a service, under a name."""

    def __init__(
        self, name: str, service: Service | None = None, agents: Iterable[type[Agent]] = ()
    ) -> None:
        self.name = name
        self.operator = cast("Operator", NoOperator())
        self.bus: tuple[str, Any] = "", None
        self.service = service
        self.when = When() if service is None else check_attributes(service)
        self.host = Host(name, kinds_of(agents))
        self.world: m.Welcome | None = None
        self.stopped = ""
        self.frame = -1
        self._generating = GeneratorSide(name, service, self.when)
        self._drawing = DeviceSide(service, self.when.every)
        self._policy = Policy.SEQUENTIAL
        self._evolved: tuple[int, set[int]] = (-1, set())
        self._out: list[Outgoing] = []
        self._handlers: dict[type, Callable[[Any], None]] = {
            m.TickRequest: self._on_tick,
            m.EvolveRequest: self._on_evolve,
            m.Readings: self._on_readings,
            m.ViewShown: self._on_view,
            m.Fragments: self.host.take,
            m.Orders: self._generating.take_orders,
            m.Greet: lambda _: self._out.append(self.hello()),
            m.Welcome: self._on_welcome,
            m.Refused: self._on_refused,
            m.Sources: self._on_sources,
            m.Repeat: self._on_repeat,
            m.Stop: self._on_stop,
        }

    def divide(self, source: str, processes: tuple[str, ...]) -> None:
        """Serve the agents of this one of the processes that divide a generator."""
        self._generating.source, self._generating.processes = source, processes

    @property
    def topics(self) -> tuple[str, ...]:
        """The sensor topics to which it subscribes."""
        return self.service.topics if self.service is not None else ()

    def receive(self, message: m.ToMember | m.Readings) -> list[Outgoing]:
        """Process one message and return the messages to send, in order.

        Raises Refusal if the world does not accept the member, and any exception of user code.
        """
        self._out = []
        # Before its welcome a member ignores everything else: messages to all members reach
        # it as soon as it has subscribed.
        if self.world is None and not isinstance(
            message, m.Greet | m.Welcome | m.Refused | m.Stop | m.Sources
        ):
            return self._out
        self._handlers[type(message)](message)
        return self._out

    # --- joining and leaving ---

    def hello(self) -> m.Hello:
        """Name, roles and capabilities of this member."""
        service = self.service
        return m.Hello(
            self.name,
            PROTOCOL_VERSION,
            kinds=tuple(cls.kind for _, cls in sorted(self.host.kinds.items())),
            generates=generated_types(service),
            when=self.when,
            orders=ordered_types(service),
            draws=tuple(service.draws) if isinstance(service, Device) else (),
            coupled=isinstance(service, Device) and service.coupled,
            topics=self.topics,
            publishes=service.publishes if service is not None else (),
            people=isinstance(service, Generator) and service.people,
            about={
                "service": type(service).__name__ if service is not None else "",
                "pid": os.getpid(),
                "host": platform.node(),
            },
        )

    def _on_welcome(self, welcome: m.Welcome) -> None:
        """Join a world, or rejoin it after the coordinator has lost this member."""
        if self.host.kinds:
            self._policy = self._known_policy(welcome.policy)
        rejoins = self.world is not None and self._is_same_run(self.world, welcome)
        if self.service is not None and not rejoins:
            self._join(self.service, welcome)
        vocabulary = with_own_fields(welcome.vocabulary, self.host.kinds)
        self.world = replace(welcome, vocabulary=vocabulary)
        # The coordinator that sent this may be a successor, which repeats the frame in progress.
        # All fragments are discarded, and the necessary ones arrive again.
        self._evolved = (-1, set())
        self._generating.clear()
        self.host.clear()
        self._drawing.rejoin()
        if self.service is not None and rejoins:
            self._generating.rejoin(self.service, welcome)
        elif self.service is not None:
            self._generating.join(welcome.saved)

    def _known_policy(self, policy: str) -> Policy:
        known = [each.value for each in Policy]
        if policy not in known:
            raise Unready(
                f'{self.name} cannot take part: the world has policy = "{policy}", and this host'
                f" knows {' and '.join(known)} only; install the version of the coordinator"
            )
        return Policy(policy)

    def _join(self, service: Service, welcome: m.Welcome) -> None:
        info = WorldInfo(
            welcome.world,
            welcome.vocabulary,
            welcome.seed,
            welcome.dt,
            self.operator,
            lambda: bool(self.stopped),
            self._generating.serves,
            *self.bus,
        )
        try:
            service.joined(info)
        except MinervaError as error:
            raise Unready(f"{self.name} cannot take part: {error}") from error
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise UserCodeError(handler_name(service.joined), service.joined) from error

    def _is_same_run(self, before: m.Welcome, welcome: m.Welcome) -> bool:
        """Whether a welcome is from the run that the member took part in.

        Raises WorldRestarted if it is from another run, or from before this member's frame.
        """
        # A restarted world has the same name, so only the seed, the
        # step and the frame distinguish runs.
        same = (before.seed, before.dt) == (welcome.seed, welcome.dt)
        # From before its latest answer, a service can continue only with the data saved then, but
        # a host receives its agents.
        earlier = self.service and welcome.frame < self.frame and welcome.saved is None
        if not same or earlier:
            raise WorldRestarted(
                f"the world {welcome.world!r} has restarted, at frame {welcome.frame}"
            )
        return True

    def _on_refused(self, refused: m.Refused) -> None:
        raise Refusal(f"the world does not take {self.name}: {refused.reason}")

    def _on_stop(self, stop: m.Stop) -> None:
        self.stopped = stop.reason or "the world has ended"
        self._drawing.show(self._begin_view, last=True)
        self._out.append(m.Report(self.name, self.figures()))

    def close(self) -> None:
        """Let the service release its resources.

        Raises UserCodeError, but not if the service has not joined: then the cause is known.
        """
        silent = () if self.world is not None else (UserCodeError,)
        if self.service is not None:
            with suppress(*silent), blamed(self.service.close):
                self.service.close()

    def figures(self) -> m.Figures:
        """Finite metrics of its service; others, such as a mean without values, are left out."""
        figures = self._drawing.figures(self.name) if self.stopped else {}
        figures |= {} if self.service is None else figures_by(self.service)
        if self._generating.buffer.dropped:
            figures["dropped"] = self._generating.buffer.dropped
        return figures

    # --- generators ---

    def _on_sources(self, sources: m.Sources) -> None:
        self._generating.sources(sources, self.topics)
        self._tick_if_complete()

    def _on_readings(self, readings: m.Readings) -> None:
        # A device without ticks has no frame to wait for, so it processes readings on arrival.
        if isinstance(self.service, Device) and not isinstance(self.service, Generator):
            with blamed(self.service.heard):
                for reading in readings.readings:
                    self.service.heard(reading, readings.frame)
            return
        self._generating.buffer.put(readings)
        self._tick_if_complete()

    def clear_tick(self) -> None:
        """Discard an unanswered tick, because another coordinator has greeted the member.

        It requests the tick again after its welcome. Before that it does not know all publishers,
        so an answer would lack the readings of the others.
        """
        self._generating.asked = None

    def _on_tick(self, request: m.TickRequest) -> None:
        if (answer := self._generating.repeated(request.frame)) is not None:
            self._out.extend(answer)
        else:
            self._tick_if_complete()

    def _tick_if_complete(self) -> None:
        """Answer a tick once all readings of its frame have arrived."""
        generating, world, frame = self._generating, self.world, self._generating.asked
        if frame is None or world is None:
            return
        if generating.publishers and next(generating.missing(), None):
            return
        self.frame = frame
        moment = Frame(frame, world.dt, world.seed)
        self._out.extend(generating.answer(moment, world.vocabulary))

    def missing(self) -> Iterator[str]:
        """The publishers whose readings of the unanswered tick's frame have not arrived."""
        return self._generating.missing()

    def _on_repeat(self, repeat: m.Repeat) -> None:
        if (published := self._generating.last_published(repeat.topic)) is not None:
            self._out.append(published)

    def emitted(self, event: AnyEvent) -> m.Emitted:
        """The message for an event of a free-running generator. Raises UserCodeError."""
        assert isinstance(self.service, Generator)
        with blamed(self.service.run):
            events = self._generating.checked(made_events(event), self._welcome.vocabulary)
            return m.Emitted(self.name, events)

    def published(self, topic: str, reading: Reading) -> m.Readings:
        """The message for a reading of a free-running publisher. Raises MisuseError."""
        return self._generating.published(topic, reading)

    # --- devices ---

    def _on_view(self, shown: m.ViewShown) -> None:
        if not self._drawing.take(shown):
            self._out.append(m.Resync(self.name, shown.event_type))
        elif isinstance(self.service, Device) and self.service.coupled:
            self.show()

    def show(self) -> None:
        """Show the pending views on the device."""
        self._drawing.show(self._begin_view)

    def _begin_view(self, frame: int) -> None:
        self.frame = frame  # If the device raises, the error names the frame of the view.

    # --- agents ---

    def _on_evolve(self, request: m.EvolveRequest) -> None:
        # One publication reaches all hosts, including those that the frame does not concern.
        if self.name not in request.asked or self._has_evolved(request):
            return
        self.frame, world = request.frame, self._welcome
        moment = Frame(request.frame, world.dt, world.seed)
        self._out.append(self.host.answer(request, moment, self._policy, world.vocabulary))

    def _has_evolved(self, request: m.EvolveRequest) -> bool:
        """Whether this request is a repetition: fragments may evolve only once in a frame."""
        frame, parts = self._evolved
        if request.frame < frame or (request.frame == frame and request.part in parts):
            return True
        earlier = parts if request.frame == frame else ()
        self._evolved = request.frame, {request.part, *earlier}
        return False

    @property
    def _welcome(self) -> m.Welcome:
        assert self.world is not None
        return self.world
