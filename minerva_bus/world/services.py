"""Base classes of generators and devices: C^d(t) of 3.3 and the output g of Table 2.

    class Rain(Generator, events=("eRain",)):
        def __init__(self, chance: float = 0.1) -> None:
            self.chance = chance

        def generate(self, tick: Tick) -> Iterator[Event]:
            if tick.random.random() < self.chance:
                yield eRain()

The keyword arguments of the constructor are the options of the process in the world file. A class
may be both a generator and a device.
"""

from __future__ import annotations

import threading
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Final, cast

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.world.readings import Reading
from minerva_bus.world.service_inputs import Emit, Tick, View, WorldInfo
from minerva_bus.world.signatures import check_overridden
from minerva_bus.world.when import When

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
    """When it takes part in frames: terms such as "freely" or "each 5 frames" (world/when.py)."""

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

    def check(self, world: WorldInfo) -> None:
        """Compare the options with a world, without effects. Raises MinervaError.

        `minerva check` calls it, and `close`; of `world` it has the name, the vocabulary, the seed
        and dt.
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
    itself the source of these events, in the frames that 5 divides; with "at 20 Hz", at most 20
    times per second of real time. Otherwise a generator or an agent is their source. A *coupled*
    device has shown the view of frame t before the events of frame t+1 are collected. Any other
    device is an observer, for which frames never wait.

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
