"""A member's side of the frame, as a pure state machine: what it is told in, what it says out.

The same object answers on the bus, in one process and in tests. User code runs in here.
"""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

from minerva_bus.blame import blamed
from minerva_bus.errors import MinervaError, MisuseError, UserCodeError
from minerva_bus.frame import messages as m
from minerva_bus.frame.calling import made_events, restore, saved_by
from minerva_bus.frame.compatibility import PROTOCOL_VERSION
from minerva_bus.frame.hosting import Host
from minerva_bus.frame.intake import Intake
from minerva_bus.frame.views import patch_all
from minerva_bus.grammar.batch import AnyEvent, in_columns
from minerva_bus.grammar.scene import Scene
from minerva_bus.source import handler_name
from minerva_bus.world.agent import Agent
from minerva_bus.world.context import Frame
from minerva_bus.world.evolution import Policy
from minerva_bus.world.kinds import kinds_of
from minerva_bus.world.operator import Nobody, Operator
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import (
    Device,
    Generator,
    Service,
    Tick,
    View,
    WorldInfo,
    checked_service,
)

Outgoing: TypeAlias = m.FromMember | m.Readings


class Refusal(MinervaError):
    """The world does not take this member."""


class Unready(Refusal):
    """The member cannot take part in this world, as its service says."""


class Anew(Refusal):
    """The world has begun anew: who took part before has to begin anew, too."""


@dataclass(slots=True)
class _Picture:
    """What a device has of one visual event type."""

    sequence: int
    skeleton: Scene
    parts: dict[str, Scene]
    halted: frozenset[str] = frozenset()


class Participant:
    """One member: agents of some kinds, or a service, under a name."""

    def __init__(
        self, name: str, service: Service | None = None, agents: Iterable[type[Agent]] = ()
    ) -> None:
        self.name = name
        self.operator = cast("Operator", Nobody())
        self.service = checked_service(service)
        self.host = Host(name, kinds_of(agents))
        self.world: m.Welcome | None = None
        self.stopped = ""
        self.frame = -1
        self._asked: int | None = None
        self._initial: Mapping[str, Any] | None = None
        self._ticked: dict[int, tuple[Outgoing, ...]] = {}
        self._evolved: tuple[int, set[int]] = (-1, set())
        self._generates: frozenset[str] = frozenset()
        self._sources: dict[str, tuple[str, ...]] = {}
        self._intake = Intake() if service is None else Intake(service.takes, service.nth)
        self._published: dict[str, m.Readings] = {}
        self._orders: dict[int, tuple[AnyEvent, ...]] = {}
        self._obeyed: dict[int, int] = {}
        self._pictures: dict[str, _Picture] = {}
        self._unshown: dict[str, int] = {}
        self._out: list[Outgoing] = []
        self._do: dict[type, Callable[[Any], None]] = {
            m.TickRequest: self._on_tick,
            m.EvolveRequest: self._on_evolve,
            m.Readings: self._on_readings,
            m.ViewShown: self._on_view,
            m.Fragments: self.host.take,
            m.Orders: self._on_orders,
            m.Greet: self._on_greet,
            m.Welcome: self._on_welcome,
            m.Refused: self._on_refused,
            m.Sources: self._on_sources,
            m.Repeat: self._on_repeat,
            m.Stop: self._on_stop,
        }

    @property
    def topics(self) -> tuple[str, ...]:
        """The sensor topics that it listens to."""
        return self.service.topics if self.service is not None else ()

    def receive(self, message: m.ToMember | m.Readings) -> list[Outgoing]:
        """Take one message; what is to be sent because of it, in order.

        Raises Refusal where the world does not take the member, and whatever user code raises.
        """
        self._out = []
        if self.world is None and not isinstance(
            message, m.Greet | m.Welcome | m.Refused | m.Stop | m.Sources
        ):
            return self._out
        self._do[type(message)](message)
        return self._out

    # --- joining and leaving ---

    def hello(self) -> m.Hello:
        """Who this member is and what it can do."""
        service = self.service
        generator = service if isinstance(service, Generator) else None
        device = service if isinstance(service, Device) else None
        return m.Hello(
            self.name,
            PROTOCOL_VERSION,
            service=type(service).__name__ if service is not None else "",
            kinds=tuple(cls.kind for _, cls in sorted(self.host.kinds.items())),
            generates=_generates(generator),
            lockstep=generator is not None and generator.lockstep,
            ahead=generator is not None and generator.lockstep and generator.ahead,
            orders=_takes_orders(generator),
            draws=tuple(device.draws) if device is not None else (),
            coupled=device is not None and device.coupled,
            every=device.every if device is not None else 0,
            rate=device.rate if device is not None else 0.0,
            topics=self.topics,
            publishes=service.publishes if service is not None else (),
            pid=os.getpid(),
            host=platform.node(),
            people=generator is not None and generator.people,
        )

    def _on_greet(self, _: m.Greet) -> None:
        self._out.append(self.hello())

    def _on_welcome(self, welcome: m.Welcome) -> None:
        """The first time, or once more where it has been out of the world's sight."""
        again = self.world is not None and self._same_run(self.world, welcome)
        self.world = welcome
        self._asked, self._evolved = None, (-1, set())
        self._intake.clear()
        self.host.clear()
        for picture in self._pictures.values():
            picture.sequence = -1
        if self.service is None:
            return
        if again:
            self._go_back(self.service, welcome)
            return
        info = WorldInfo(welcome.world, welcome.vocabulary, welcome.seed, welcome.dt, self.operator)
        service = self.service
        try:
            service.joined(info)
        except MinervaError as error:
            raise Unready(f"{self.name} cannot take part: {error}") from error
        except (Exception, SystemExit) as error:
            raise UserCodeError(handler_name(service.joined), service.joined) from error
        self._generates = frozenset(_generates(service))
        if welcome.saved is not None:
            self._initial = deepcopy(saved_by(service))
            restore(service, welcome.saved)

    def _same_run(self, before: m.Welcome, welcome: m.Welcome) -> bool:
        """Whether it is still the run that it was in. Raises Anew where that cannot be."""
        same = (before.seed, before.dt) == (welcome.seed, welcome.dt)
        earlier = welcome.frame + 1 < self.frame and welcome.saved is None
        if not same or earlier:
            raise Anew(f"the world {welcome.world!r} has begun anew, at frame {welcome.frame}")
        return True

    def _go_back(self, service: Service, welcome: m.Welcome) -> None:
        """Be as it was before a frame; what it said in that frame already, it can say again."""
        if welcome.frame not in self._ticked:
            self._ticked = {welcome.frame - 1: ()}
            # Nothing is saved of a first frame that never ended: back to before it.
            saved = self._initial if welcome.saved is None else welcome.saved
            if saved is not None:
                restore(service, saved)

    def _on_refused(self, refused: m.Refused) -> None:
        raise Refusal(f"the world does not take {self.name}: {refused.reason}")

    def _on_stop(self, stop: m.Stop) -> None:
        self.stopped = stop.reason or "the world has ended"
        self.show()
        self._out.append(m.Report(self.name, self.figures()))

    def figures(self) -> m.Figures:
        """How it does; a number that is not finite, as a mean of nothing, is no figure."""
        told: m.Figures = {}
        if self.service is not None:
            with blamed(self.service.report):
                told = self.service.report() or {}
        figures = {name: one for name, one in told.items() if _is_figure(one)}
        if self._intake.dropped:
            figures["dropped"] = self._intake.dropped
        return figures

    # --- generators ---

    def _on_orders(self, orders: m.Orders) -> None:
        """Keep what people order for a frame.

        A successor of the coordinator gives the orders of a frame once more: those that count
        already are left out.
        """
        frame, obeyed = orders.frame, self._obeyed.get(orders.frame)
        if obeyed is None:
            self._orders[frame] = orders.events
        elif orders.events[obeyed:]:
            self._orders[frame + 1] = orders.events[obeyed:]

    def _on_sources(self, sources: m.Sources) -> None:
        if not isinstance(self.service, Generator):
            return  # Nobody else answers for the readings of a frame, so nobody waits for them.
        self._sources = {
            topic: sources.publishers[topic] for topic in self.topics if topic in sources.publishers
        }
        self._tick_if_complete()

    def _on_readings(self, readings: m.Readings) -> None:
        if isinstance(self.service, Device) and not isinstance(self.service, Generator):
            with blamed(self.service.heard):
                for reading in readings.readings:
                    self.service.heard(reading)
            return
        self._intake.put(readings)
        self._tick_if_complete()

    def _on_tick(self, request: m.TickRequest) -> None:
        said = self._ticked.get(request.frame)
        if said is not None:  # The coordinator, or a successor of it, has not heard it.
            self._out.extend(said)
        elif request.frame >= max(self._ticked, default=0):  # Else it was asked long ago.
            self._asked = request.frame
            self._tick_if_complete()

    def _tick_if_complete(self) -> None:
        """Answer a tick once this frame's readings of all lockstep publishers are there."""
        if self._asked is None or (self._sources and next(self.missing(), None)):
            return
        frame, self._asked = self._asked, None
        self.frame = frame
        said = len(self._out)
        self._tick(frame)
        self._ticked = {one: out for one, out in self._ticked.items() if one >= frame - 1}
        self._ticked[frame] = tuple(self._out[said:])

    def _tick(self, frame: int) -> None:
        service = self.service
        if not isinstance(service, Generator) or not service.lockstep:
            if isinstance(service, Device) and service.coupled:
                self._out.append(m.TickReply(self.name, frame))
            return
        tick = Tick(
            self._frame(frame),
            self.name,
            readings=self._intake.taken(),
            orders=self._ordered(frame),
        )
        with blamed(service.generate):
            events = in_columns(self._checked(made_events(service.generate(tick))))
            if service.publishes or tick.published:
                self._publish(service, tick)
        self._out.append(m.TickReply(self.name, frame, events, saved_by(service)))

    def _ordered(self, frame: int) -> tuple[AnyEvent, ...]:
        """What people have ordered for a frame, and for earlier ones in which it was not asked."""
        due = {one: self._orders.pop(one) for one in sorted(self._orders) if one <= frame}
        self._obeyed = {frame: len(due.get(frame, ()))}
        return tuple([event for events in due.values() for event in events])

    def missing(self) -> Iterator[str]:
        """The publishers whose readings of the frame that is asked for are not there yet."""
        return self._intake.missing(-1 if self._asked is None else self._asked, self._sources)

    def _checked(self, events: Iterable[AnyEvent]) -> tuple[AnyEvent, ...]:
        assert self.world is not None
        check = self.world.vocabulary.check_any
        checked = tuple([check(event, self.name) for event in events])
        for event in checked:
            if event.type not in self._generates:
                raise MisuseError(
                    f"it makes {event.type}, which it does not declare;"
                    f' write class {type(self.service).__name__}(Generator, events=("{event.type}",'
                    " ...))"
                )
        return checked

    def _publish(self, service: Service, tick: Tick) -> None:
        by_topic: dict[str, list[Reading]] = {topic: [] for topic in service.publishes}
        for topic, reading in tick.published:
            if topic not in by_topic:
                raise MisuseError(f"{self.name} publishes on {topic!r}; declare it in `publishes`")
            by_topic[topic].append(reading)
        for topic, readings in by_topic.items():
            message = m.Readings(self.name, topic, tick.number, tuple(readings))
            self._published[topic] = message
            self._out.append(message)

    def _on_repeat(self, repeat: m.Repeat) -> None:
        if repeat.topic in self._published:
            self._out.append(self._published[repeat.topic])

    def emitted(self, event: AnyEvent) -> m.Emitted:
        """The message for an event of a free-running generator."""
        assert isinstance(self.service, Generator)
        with blamed(self.service.run):
            return m.Emitted(self.name, self._checked(made_events(event)))

    def published(self, topic: str, reading: Reading) -> m.Readings:
        """The message for a reading of a free-running publisher. Raises MisuseError."""
        assert self.service is not None
        if topic not in self.service.publishes:
            raise MisuseError(f"{self.name} publishes on {topic!r}; declare it in `publishes`")
        return m.Readings(self.name, topic, -1, (reading,))

    # --- devices ---

    def _on_view(self, shown: m.ViewShown) -> None:
        picture = self._pictures.get(shown.event_type)
        if shown.skeleton is not None:
            if picture is None or shown.sequence >= picture.sequence:
                picture = _Picture(shown.sequence, shown.skeleton, dict(shown.parts))
                self._pictures[shown.event_type] = picture
                self._changed(shown)
        elif picture is None or shown.sequence > picture.sequence + 1:
            self._out.append(m.Resync(self.name, shown.event_type))
        elif shown.sequence <= picture.sequence:
            return
        else:
            picture.sequence = shown.sequence
            picture.parts.update(shown.parts)
            patch_all(picture.parts, shown.patches)
            self._changed(shown)

    def _changed(self, shown: m.ViewShown) -> None:
        self._pictures[shown.event_type].halted = frozenset(shown.halted)
        self._unshown[shown.event_type] = shown.frame
        if isinstance(self.service, Device) and self.service.coupled:
            self.show()

    def show(self) -> None:
        """Let the device show what it has not shown yet.

        A coupled one has each view shown at once. An observer that fell behind is shown the
        newest only: it catches up instead of drawing what is long past.
        """
        unshown, self._unshown = self._unshown, {}
        for event_type, frame in sorted(unshown.items()):
            self.frame = frame
            if isinstance(self.service, Device):
                picture = self._pictures[event_type]
                parts = dict(picture.parts)
                view = View(frame, event_type, picture.skeleton, parts, picture.halted)
                with blamed(self.service.show):
                    self.service.show(view)

    # --- agents ---

    def _on_evolve(self, request: m.EvolveRequest) -> None:
        if self.name not in request.asked or self._has_evolved(request):
            return
        assert self.world is not None
        self.frame = request.frame
        policy = Policy(self.world.policy)
        frame = self._frame(request.frame)
        self._out.append(self.host.answer(request, frame, policy, self.world.vocabulary))

    def _has_evolved(self, request: m.EvolveRequest) -> bool:
        """Whether this was asked before: fragments may evolve once only in a frame."""
        frame, parts = self._evolved
        if request.frame < frame or (request.frame == frame and request.part in parts):
            return True
        if request.frame > frame:
            parts = set[int]()
        parts.add(request.part)
        self._evolved = request.frame, parts
        return False

    def _frame(self, number: int) -> Frame:
        assert self.world is not None
        return Frame(number, self.world.dt, self.world.seed)


def _generates(service: Service | None) -> tuple[str, ...]:
    if not isinstance(service, Generator):
        return ()
    with blamed(service.generates):
        return tuple(service.generates())


def _takes_orders(service: Service | None) -> tuple[str, ...]:
    if not isinstance(service, Generator):
        return ()
    with blamed(service.takes_orders):
        return tuple(service.takes_orders())


def _is_figure(value: bool | int | float | str) -> bool:
    return not isinstance(value, float) or math.isfinite(value)
