"""What a member passes to its service: the world, the ticks of C^d(t), the views of Table 2."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol, cast

from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.traversal import fill
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.context import Context
from minerva_bus.world.operator import NoOperator, Operator
from minerva_bus.world.readings import Reading


@dataclass(frozen=True, slots=True)
class WorldInfo:
    """The world that a member has joined.

    Attributes:
        world: its name.
        vocabulary: its symbols and event types.
        seed: its seed.
        dt: duration of a frame, simulated seconds.
        operator: pause, step, send events: for services with controls for people.
        ended: returns whether the world has ended. False in `close` means that the member leaves a
            world that continues, or has lost it.
        endpoint: where the member is connected to the bus, such as `tcp/127.0.0.1:40123`, for
            services through which others join; "" in a world in one process.

    """

    world: str
    vocabulary: Vocabulary
    seed: int
    dt: float
    operator: Operator = field(
        default_factory=lambda: cast("Operator", NoOperator()), compare=False
    )
    ended: Callable[[], bool] = field(default=lambda: False, compare=False, repr=False)
    endpoint: str = field(default="", compare=False)


@dataclass(slots=True)
class Tick(Context):
    """The context in which a generator in step produces C^d(t); a `Context` with inputs.

    Attributes:
        readings: this frame's readings of its topics, sorted by topic and publisher.
        orders: the events that people have sent through it since the previous tick.
        published: what it has published in this frame, as (topic, reading).

    """

    readings: tuple[Reading, ...] = ()
    orders: tuple[AnyEvent, ...] = ()
    published: list[tuple[str, Reading]] = field(default_factory=list[tuple[str, Reading]])

    def publish(self, topic: str, reading: Reading) -> None:
        """Publish a reading on a sensor topic, for this frame."""
        self.published.append((topic, reading))


# No slots: `cached_property` stores the string in `__dict__`.
@dataclass(frozen=True)
class View:
    """The view π of a frame's string for one visual event type: a string of L(E).

    Attributes:
        frame: the frame's number.
        event_type: the visual event type.
        skeleton: the string with a slot `A#name()` for each outermost agent, or part of a
            population.
        parts: the views of these, by name. A part that is the same object as in the previous view
            has not changed.
        halted: ids of agents whose step does not count in this frame, because a norm rejected it or
            their host is absent. A device that executes commands in a view, such as motors,
            executes none for these agents, because the string still has them at their former
            position.

    """

    frame: int
    event_type: str
    skeleton: Scene
    parts: Mapping[str, Scene] = field(default_factory=dict[str, Scene])
    halted: frozenset[str] = frozenset()

    @cached_property
    def scene(self) -> Scene:
        """The complete string v."""
        return fill(self.skeleton, self.parts)


class Emit(Protocol):
    """Output of a free-running generator, called from its own thread."""

    def __call__(self, event: AnyEvent) -> None:
        """Emit an event, which belongs to the next frame."""

    def publish(self, topic: str, reading: Reading) -> None:
        """Publish a reading on a sensor topic that `publishes` of the class lists."""
        ...
