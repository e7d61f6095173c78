"""Member side of the frame protocol as a pure state machine: messages in, messages out.

The same object is used on the bus, in one process and in tests. It calls the user code.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any, TypeAlias, cast

from minerva_bus.errors import MinervaError, UserCodeError
from minerva_bus.frame import messages as m
from minerva_bus.frame.device_side import DeviceSide
from minerva_bus.frame.generator_side import (
    GeneratorSide,
    generated_types,
    ordered_types,
)
from minerva_bus.frame.host_side import Host
from minerva_bus.frame.messages import PROTOCOL_VERSION
from minerva_bus.frame.service_calls import figures_by, made_events
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.user_code import blamed, handler_name
from minerva_bus.world.agent import Agent, kinds_of, with_own_fields
from minerva_bus.world.context import Frame
from minerva_bus.world.evolution import Policy
from minerva_bus.world.operator import NoOperator, Operator
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import Device, Generator, Service, When, WorldInfo, check_attributes

Outgoing: TypeAlias = m.FromMember | m.Readings


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
        self.endpoint = ""
        self.service = service
        self.when = When() if service is None else check_attributes(service)
        self.host = Host(name, kinds_of(agents))
        self.world: m.Welcome | None = None
        self.stopped = ""
        self.frame = -1
        self._generating = GeneratorSide(name, service, self.when)
        self._drawing = DeviceSide(service)
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
            m.Greet: self._on_greet,
            m.Welcome: self._on_welcome,
            m.Refused: self._on_refused,
            m.Sources: self._on_sources,
            m.Repeat: self._on_repeat,
            m.Stop: self._on_stop,
        }

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
        generator = service if isinstance(service, Generator) else None
        device = service if isinstance(service, Device) else None
        return m.Hello(
            self.name,
            PROTOCOL_VERSION,
            kinds=tuple(cls.kind for _, cls in sorted(self.host.kinds.items())),
            generates=generated_types(generator),
            when=self.when,
            orders=ordered_types(generator),
            draws=tuple(device.draws) if device is not None else (),
            coupled=device is not None and device.coupled,
            topics=self.topics,
            publishes=service.publishes if service is not None else (),
            people=generator is not None and generator.people,
            about={
                "service": type(service).__name__ if service is not None else "",
                "pid": os.getpid(),
                "host": platform.node(),
            },
        )

    def _on_greet(self, _: m.Greet) -> None:
        self._out.append(self.hello())

    def _on_welcome(self, welcome: m.Welcome) -> None:
        """Join a world, or rejoin it after the coordinator has lost this member."""
        if self.host.kinds:
            self._policy = self._known_policy(welcome.policy)
        rejoins = self.world is not None and self._is_same_run(self.world, welcome)
        vocabulary = with_own_fields(welcome.vocabulary, self.host.kinds)
        self.world = replace(welcome, vocabulary=vocabulary)
        # The coordinator that sent this may be a successor, which repeats the frame in progress.
        # All fragments are discarded, and the necessary ones arrive again.
        self._evolved = (-1, set())
        self._generating.clear()
        self.host.clear()
        self._drawing.rejoin()
        if self.service is None:
            return
        if rejoins:
            self._generating.rejoin(self.service, welcome)
            return
        self._join(self.service, welcome)
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
            self.endpoint,
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
        earlier = welcome.frame < self.frame and welcome.saved is None
        earlier = earlier and self.service is not None
        if not same or earlier:
            raise WorldRestarted(
                f"the world {welcome.world!r} has restarted, at frame {welcome.frame}"
            )
        return True

    def _on_refused(self, refused: m.Refused) -> None:
        raise Refusal(f"the world does not take {self.name}: {refused.reason}")

    def _on_stop(self, stop: m.Stop) -> None:
        self.stopped = stop.reason or "the world has ended"
        self.show()
        self._out.append(m.Report(self.name, self.figures()))

    def figures(self) -> m.Figures:
        """Finite metrics of its service; others, such as a mean without values, are left out."""
        figures = {} if self.service is None else figures_by(self.service)
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

    def _on_tick(self, request: m.TickRequest) -> None:
        answer = self._generating.repeated(request.frame)
        if answer is not None:
            self._out.extend(answer)
        else:
            self._tick_if_complete()

    def _tick_if_complete(self) -> None:
        """Answer a tick once all readings of its frame have arrived."""
        frame = self._generating.asked
        if frame is None or not self._generating.complete:
            return
        self.frame, world = frame, self._welcome
        moment = Frame(frame, world.dt, world.seed)
        self._out.extend(self._generating.answer(moment, world.vocabulary))

    def missing(self) -> Iterator[str]:
        """The publishers whose readings of the unanswered tick's frame have not arrived."""
        return self._generating.missing()

    def _on_repeat(self, repeat: m.Repeat) -> None:
        published = self._generating.last_published(repeat.topic)
        if published is not None:
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
        if request.frame > frame:
            parts = set[int]()
        parts.add(request.part)
        self._evolved = request.frame, parts
        return False

    @property
    def _welcome(self) -> m.Welcome:
        assert self.world is not None
        return self.world
