"""Base classes of generators and devices: C^d(t) of 3.3 and the output g of Table 2.

    class Rain(Generator, events=("eRain",)):
        def __init__(self, chance: float = 0.1) -> None:
            self.chance = chance

        def generate(self, tick: Tick) -> Iterator[Event]:
            if tick.random.random() < self.chance:
                yield eRain()

The keyword arguments of the constructor are the options of the process in the world file. A class
may be both a generator and a device. Its text `when` says in which frames it takes part:

    in step          a generator: each frame asks it and waits for its events
    on orders        a generator: its first frame asks it, and frames with orders for it
    freely           a generator: no frame asks it, it sends events at any time
    each frame       a device: its view is made in each frame
    each N frames    a device: its view is made in each frame that N divides;
                     a generator in step that draws nothing: only these frames ask it
    at N Hz          a device: its view is made at most N times per second

A generator without a term of the first three is in step. A device without a term of the last three
gets a view when another member or an agent sends the visual event.
"""

from __future__ import annotations

import math
import re
import threading
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Final, Protocol, TypeAlias, cast

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene, fill
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.class_declaration import check_overridden
from minerva_bus.world.context import Context
from minerva_bus.world.operator import NoOperator, Operator
from minerva_bus.world.readings import Reading

_POSSIBLE: Final = (
    '"in step", "on orders", "freely", "each frame", "each N frames" and "at N Hz", with a comma'
    ' between two of them, as in "freely, each 2 frames"'
)
_EACH: Final = re.compile(r"each (?:frame|([0-9]{1,18}) frames)")
_RATE: Final = re.compile(r"at ([0-9]+(?:\.[0-9]+)?(?:e[+-]?[0-9]+)?) Hz")


class Participation(StrEnum):
    """When frames ask a generator for its events; `NEVER` if the member is none."""

    NEVER = ""
    IN_STEP = "in step"
    ON_ORDERS = "on orders"
    FREELY = "freely"


@dataclass(frozen=True, slots=True)
class When:
    """When a member takes part in frames; `str` makes its text.

    `asked`: when it is asked for events. `every` > 0: the frames from one view of a device to the
    next, or from one request of a generator that draws nothing to the next. `rate` > 0: the most
    views of a device per second.
    """

    asked: Participation = Participation.NEVER
    every: int = 0
    rate: float = 0.0

    def __str__(self) -> str:
        terms = [str(self.asked)] if self.asked else []
        if self.every:
            terms.append("each frame" if self.every == 1 else f"each {self.every} frames")
        if self.rate:
            short = f"{self.rate:g}"
            terms.append(f"at {short if float(short) == self.rate else repr(self.rate)} Hz")
        return ", ".join(terms)

    @classmethod
    def read(cls, text: str) -> When:
        """The value of a text. Raises MisuseError."""
        when = cls()
        for term in text.split(", ") if text else ():
            when = when._with(term, text)
        return when

    def _with(self, term: str, text: str) -> When:
        where = f'when = "{text:.80}"'
        if term in (Participation.IN_STEP, Participation.ON_ORDERS, Participation.FREELY):
            if self.asked:
                raise MisuseError(f'{where}: choose one of "{self.asked}" and "{term}"')
            return replace(self, asked=Participation(term))
        each, at = _EACH.fullmatch(term), _RATE.fullmatch(term)
        if (each or at) and (self.every or self.rate):
            before = replace(self, asked=Participation.NEVER)
            raise MisuseError(f'{where}: choose one of "{before}" and "{term}"')
        every, rate = int(each[1] or 1) if each else 0, float(at[1]) if at else 0.0
        if every or 0 < rate < math.inf:
            return replace(self, every=every, rate=rate)
        if each or at:
            raise MisuseError(f'{where}: expected a number above 0 in "{term}"')
        raise MisuseError(f'{where}: "{term:.80}" is not possible; it may have {_POSSIBLE}')

    @property
    def is_awaited(self) -> bool:
        """Whether frames wait for the events of this generator."""
        return self.asked in (Participation.IN_STEP, Participation.ON_ORDERS)


def objection(
    when: When, *, draws: bool, generates: bool, topics: bool, publishes: bool, orders: bool
) -> str:
    """Why a member with these abilities cannot take part at these times, or an empty string."""
    if when.rate and not draws:
        return f'its `when` is "{when}", but it draws no views'
    if generates and not when.asked:
        return 'it sends events, so its `when` needs "in step", "on orders" or "freely"'
    if when.every and not draws and when.asked is not Participation.IN_STEP:
        return f'its `when` is "{when}", but it draws no views and is not in step'
    reasons = {"subscribes to topics": topics, "publishes on topics": publishes}
    if when.asked is Participation.ON_ORDERS:
        needs = {"draws views": draws, **reasons}
        what = "so it has events on orders only"
    elif when.every and not draws:
        needs, what = {**reasons, "takes orders": orders}, "so some frames do not ask it"
    else:
        return ""
    reason = next((reason for reason, applies in needs.items() if applies), "")
    return reason and f'its `when` is "{when}", {what}, but it {reason}'


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
        serves: returns whether this process makes the events of an agent: of the processes that
            divide a generator, exactly one does.
        endpoint: where the member is connected to the bus, such as `tcp/127.0.0.1:40123`, for
            services through which others join; "" in a world in one process.
        session: the name of the member and the Zenoh session of its process, for what services of
            an extension tell each other; None in a world in one process.

    """

    world: str
    vocabulary: Vocabulary
    seed: int
    dt: float
    operator: Operator = field(
        default_factory=lambda: cast("Operator", NoOperator()), compare=False
    )
    ended: Callable[[], bool] = field(default=lambda: False, compare=False, repr=False)
    serves: Callable[[str], bool] = field(default=lambda _: True, compare=False, repr=False)
    endpoint: str = field(default="", compare=False)
    session: Any = field(default=None, compare=False, repr=False)


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


CALLED: Final = {
    "Service": ("check", "joined", "save", "restore", "pulse", "leaves", "report", "close"),
    "Generator": ("generates", "takes_orders", "generate", "run"),
    "Device": ("heard", "show"),
}
"""The methods of a service that its member calls, by the class that declares them."""


class Service:
    """Base of generators and devices: processes of a world that are not hosts of agents.

    Its member calls `joined` first, then `restore` if there is saved state, the methods of
    `Generator` and `Device` in each frame, and `close` last.
    """

    when: str = ""
    """When it takes part in frames: terms such as "freely" or "each 5 frames", as in the module."""

    topics: tuple[str, ...] = ()
    """Sensor topics whose readings it receives."""

    publishes: tuple[str, ...] = ()
    """Sensor topics on which it publishes readings."""

    writes: tuple[Path, ...] = ()
    """Files that it writes; a world in which two services write one file does not start."""

    takes: str = "newest"
    """Which readings to use if several arrive within a frame: the "newest" or "all"."""

    nth: int = 1
    """Use only each n-th reading of a free-running publisher."""

    concerns: tuple[str, ...] = ()
    """Ids of agents that its options name; a world whose string lacks one warns at its start."""

    interactive: bool = False
    """Whether it has a user interface; a world with it as a view runs in real time, without end."""

    pulse_every: float = 0.0
    """Seconds between calls of `pulse`; 0 disables it."""

    def __init_subclass__(cls, when: str = "", **kwargs: Any) -> None:
        if kwargs and cls.__mro__[cls.__mro__.index(Service) + 1] is object:
            raise MisuseError(_unknown_arguments(cls, [*kwargs]))
        super().__init_subclass__(**kwargs)
        _check_once(cls, when=when)
        # Only arguments that are given are set, so that subclasses inherit the others.
        if when:
            cls.when = str(read_when(cls, when))
        # Here, and not when a frame calls them: a wrong signature then names the class, not a
        # frame.
        for base in cls.__mro__:
            if base is not cls and base.__module__ == __name__ and issubclass(base, Service):
                check_overridden(cls, base, CALLED.get(base.__name__, ()))

    def check(self, world: WorldInfo) -> Iterable[str] | None:
        """Compare the options with a world, without effects. Raises MinervaError.

        `minerva check` calls it, and `close`, and prints what it returns as warnings; of `world` it
        has the name, the vocabulary, the seed and dt.
        """

    def joined(self, world: WorldInfo) -> None:
        """Called once, first of all, when the member has joined a world; by default, `check`."""
        self.check(world)

    def save(self) -> Any:
        """State from which a successor continues after this frame; None if it needs none.

        A bool, number, text, bytes, or a list or mapping (with texts as keys) of these.
        """
        return None

    def restore(self, saved: Any) -> None:
        """Continue from the state that a predecessor saved; its tuples are lists here."""

    def pulse(self) -> None:
        """Called every `pulse_every` seconds between messages, for example to poll the keyboard."""

    def leaves(self) -> bool:
        """Whether it leaves the world, for example with its window closed; called after a pulse."""
        return False

    def report(self) -> Mapping[str, bool | int | float | str]:
        """Metrics for the summary of the run and for `minerva top`.

        Numbers that are not finite, such as the mean of no values, are left out.
        """
        return {}

    def close(self) -> None:
        """Called once, at the end."""


def _unknown_arguments(cls: type, names: list[str]) -> str:
    known = [
        *(("events",) if issubclass(cls, Generator) else ()),
        *(("draws", "coupled") if issubclass(cls, Device) else ()),
        "when",
    ]
    hint = nearest(names[0], known, f"it may have {', '.join(known)}")
    return f"{cls.__name__} has the unknown class argument {names[0]}{hint}"


def read_when(cls: type, when: object) -> When:
    """The value of a declaration `when`. Raises MisuseError."""
    if not isinstance(when, str):
        raise MisuseError(f'{cls.__name__}: when must be a text such as "freely", not {when!r:.60}')
    try:
        return When.read(when)
    except MisuseError as error:
        raise MisuseError(f"{cls.__name__}: {error}") from None


def _check_once(cls: type, **given: object) -> None:
    """Raise MisuseError for a class argument that is an attribute of the body, too."""
    for name, value in given.items():
        if value and name in vars(cls):
            raise MisuseError(
                f"{cls.__name__}: {name} is given twice, as the class argument {name}={value!r} and"
                f" in the body, {name} = {vars(cls)[name]!r:.60}; remove one of them"
            )


def _several(cls: type, what: str, event_types: tuple[str, ...] | str) -> tuple[str, ...]:
    if isinstance(event_types, str):
        raise MisuseError(f'{cls.__name__}: {what} are several, write {what}=("{event_types}",)')
    given = cast("tuple[object, ...]", (event_types,) if callable(event_types) else event_types)
    for each in given:
        if not isinstance(each, str):
            name = getattr(each, "name", "eName")
            raise MisuseError(f'{cls.__name__}: {what} are names, write {what}=("{name}",)')
    return tuple(event_types)


class Generator(Service):
    """An event generator, C^d(t).

    The keyword arguments of a subclass's constructor are options of the process in a world file.

    Class arguments: `events` are the event types that it generates. `when`: without it, `generate`
    is called in each frame, which waits for its events ("in step"). With "each 5 frames" it is
    called in the frames that 5 divides. With "on orders" it is called in the first frame of its
    process, and then in frames in which `tick.orders` has any: for generators whose other frames
    have no events. With "freely", `run` emits at any time, and a frame has the events that arrived
    before it began.

    Example:
        >>> class Rain(Generator, events=("eRain",)):
        ...     def __init__(self, probability: float = 0.1) -> None:
        ...         self.probability = probability
        ...
        ...     def generate(self, tick):
        ...         return eRain() if tick.random.random() < self.probability else None

    """

    events: ClassVar[tuple[str, ...]] = ()
    people: bool = False
    """Whether its events are actions of people, for norms."""

    by_agent: bool = False
    """Whether several processes may divide its agents (`processes` in a world file).

    Each event must then be for one agent, and not depend on what this service has made for others;
    random numbers are of `stream(seed, f"{tick.who}/{agent}", frame)`. `tick.readings` are those of
    the agents of this process; `WorldInfo.serves` tells for others.
    """

    def __init_subclass__(cls, events: tuple[str, ...] = (), **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        _check_once(cls, events=events)
        if events:
            cls.events = _several(cls, "events", events)

    def generates(self) -> tuple[str, ...]:
        """The event types that it generates; by default those of its class."""
        return self.events

    def takes_orders(self) -> tuple[str, ...]:
        """The event types that people may send through it; the events are in `tick.orders`."""
        return ()

    def generate(self, tick: Tick) -> Iterable[AnyEvent | None] | AnyEvent | None:
        """C^d(t): the events of one frame, a single event, or None."""
        return ()

    def run(self, emit: Emit, stop: threading.Event) -> None:
        """Emit events until `stop` is set; free-running generators run it in their own thread."""


class Device(Service):
    """An output device g with its own geometric system G.

    `draws` are the visual event types whose views it shows. With `when` "each 5 frames" it is
    itself the source of these events, in the frames that 5 divides, and shows no others; with
    "at 20 Hz", at most 20 times per second of real time. Otherwise a generator or an agent is their
    source. A *coupled* device has shown the view of frame t before the events of frame t+1 are
    collected. Any other device is an observer, for which frames never wait.

    Class arguments: `draws`, `coupled` and `when`.

    Example:
        >>> class Printer(Device, draws=("ePicture",), when="each 10 frames"):
        ...     def show(self, view):
        ...         print(view.frame, view.scene)

    """

    draws: tuple[str, ...] = ()
    coupled: bool = False

    def __init_subclass__(
        cls, draws: tuple[str, ...] = (), coupled: bool = False, **kwargs: Any
    ) -> None:
        super().__init_subclass__(**kwargs)
        _check_once(cls, draws=draws, coupled=coupled)
        if draws:
            cls.draws = _several(cls, "draws", draws)
        if coupled:
            cls.coupled = True

    def heard(self, reading: Reading, frame: int) -> None:
        """Called with each reading of `topics`, on arrival, if the device is not a generator.

        `frame` is the frame in which it was published; -1 from a free-running publisher.
        """

    @abstractmethod
    def show(self, view: View) -> None:
        """g = φ(v), step 7 of Table 2."""


def check_attributes(service: Service) -> When:
    """When a service takes part in frames, after a check of all attributes that its member reads.

    A constructor may overwrite them by accident, for example with an option of this name.

    Raises MisuseError for one that is not what the member expects.
    """
    names = ["topics", "publishes"]
    # A class with its own `generates` does not use the attribute.
    if isinstance(service, Generator) and type(service).generates is Generator.generates:
        names.append("events")
    if isinstance(service, Device):
        names.append("draws")
    for name in names:
        declared = getattr(service, name)
        names_only = isinstance(declared, tuple | list) and all(
            isinstance(event, str) for event in cast("Iterable[Any]", declared)
        )
        if not names_only:
            raise MisuseError(
                f"{type(service).__name__}: self.{name} must be a tuple of names, not"
                f" {declared!r:.60};"
                " call an attribute for something else, as an option's value, otherwise"
            )
    _check_settings(service)
    return when_of(service)


def when_of(service: Service) -> When:
    """When a service takes part in frames; a generator is in step unless it says otherwise.

    Raises MisuseError if it cannot take part at these times.
    """
    cls, generates = type(service), isinstance(service, Generator)
    when = read_when(cls, service.when)
    if generates and not when.asked:
        when = replace(when, asked=Participation.IN_STEP)
    if when.asked and not generates:
        raise MisuseError(f'{cls.__name__}: when = "{when}" is for generators, and it is a device')
    reason = objection(
        when,
        draws=isinstance(service, Device) and bool(service.draws),
        generates=generates,
        topics=bool(service.topics),
        publishes=bool(service.publishes),
        orders=isinstance(service, Generator) and bool(service.takes_orders()),
    )
    if reason:
        raise MisuseError(f"{cls.__name__}: {reason}")
    return when


def _check_settings(service: Service) -> None:
    for name, (is_valid, expected) in _OF_SERVICES.items():
        value = getattr(service, name)
        if not is_valid(value):
            problem = f"{type(service).__name__}: self.{name} must be {expected}, not {value!r:.60}"
            raise MisuseError(problem)


def _is_positive(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 1


def _is_amount(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value) and value >= 0


_Setting: TypeAlias = tuple[Callable[[Any], bool], str]

_OF_SERVICES: Final[dict[str, _Setting]] = {
    "takes": (lambda value: value in ("newest", "all"), "'newest' or 'all'"),
    "nth": (_is_positive, "a whole number from 1"),
    "pulse_every": (_is_amount, "a number of seconds from 0"),
    "when": (lambda value: isinstance(value, str), 'a text such as "freely"'),
}
