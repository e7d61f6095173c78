"""The simulated world: small, but with every kind of member.

Herons stride, call and breed at random; eels flee; a bed of reeds is an agent that contains others.
The tide has state; the water is coupled and publishes readings of its view, from which the lookout
creates events. A clerk accepts orders of people, and gulls are free-running. In some histories one
process or several divide the agents of a ranger, which publishes readings, and of a warden.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any, Final

from minerva_bus import (
    EMPTY,
    Agent,
    Context,
    Device,
    Event,
    EventType,
    Generator,
    Metres,
    Primitive,
    Scene,
    Tick,
    Transformation,
    View,
    Vocabulary,
    on,
    view,
)
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import walk
from minerva_bus.launch.process_specs import ProcessSpec, names_of
from minerva_bus.launch.specs import Factory
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.settings.world_settings import BusSettings
from minerva_bus.world.context import stream
from minerva_bus.world.event_collection import Priority
from minerva_bus.world.norms import Norm, Then
from minerva_bus.world.readings import Sighting, Sightings
from minerva_bus.world.services import Emit, Service

NAME: Final = "shore"
STRING: Final = """
    AHeron#h1 · TAt<x=1>(AHeron#h2<x=2> · PDot<x=0>) · AEel#e1 · AReeds#r1(AHeron#h3) · PDot<x=9>
"""

PDot = Primitive("PDot", x=Metres)
TAt = Transformation("TAt", x=Metres)
eTide = EventType("eTide", count=int)
eCall = EventType("eCall", x=Metres)
eSeen = EventType("eSeen", figures=int)
eMark = EventType("eMark", n=int)
eNote = EventType("eNote", n=int)
eCry = EventType("eCry", n=int)
eShow = EventType("eShow", visual=True)


class Heron(Agent, symbol="AHeron"):
    """Strides, calls and breeds at random; too many calls kill it."""

    x: Metres = 0.0
    heard: int = 0
    births: int = 0

    @on("eTide")
    def stride(self, tide: Event, moment: Context) -> Scene | None:
        self.x += moment.random.normal() + 0.001 * tide.count
        if moment.random.random() < 0.4:
            moment.emit(eCall(self.x))
        if moment.random.random() < 0.08:
            return self.string + self.child(x=self.x)
        return None

    @on("eCall")
    def listen(self, call: Event, moment: Context) -> Scene | None:
        # Calls of other herons only.
        self.heard += call.sender != self.id
        return EMPTY if self.heard > 16 else None

    @on("eSeen")
    def hide(self, seen: Event, moment: Context) -> None:
        self.x -= 0.01 * seen.figures

    @view("eShow")
    def picture(self, event: Event) -> Scene:
        return TAt(self.x)(PDot(float(self.heard)))


class Eel(Agent, symbol="AEel"):
    """Flees from calls."""

    jumps: int = 0
    x: Metres = 0.0

    @on("eCall")
    def flee(self, call: Event, moment: Context) -> None:
        self.jumps += 1
        self.x = call.x + moment.random.random()

    @on("eMark")
    def note(self, mark: Event, moment: Context) -> None:
        self.x += mark.n

    @view("eShow")
    def picture(self, event: Event) -> Scene:
        return PDot(self.x)


class Reeds(Agent, symbol="AReeds"):
    """Has other agents in its scope."""

    total: int = 0

    @on("eTide")
    def sway(self, tide: Event, moment: Context) -> None:
        self.total += 1 + len(self.scope)

    @on("eNote")
    def note(self, note: Event, moment: Context) -> None:
        self.total = 3 * self.total + note.n

    @view("eShow")
    def picture(self, event: Event) -> Scene:
        return TAt(1.0)(self.scope)


class Tide(Generator, events=("eTide",)):
    """Has state that its successor must restore."""

    def __init__(self) -> None:
        self.count = 0

    def generate(self, tick: Tick) -> Iterable[Event]:
        self.count += int(tick.random.integers(1, 4))
        return (eTide(self.count),)

    def save(self) -> Mapping[str, Any]:
        return {"count": self.count}

    def restore(self, saved: Mapping[str, Any]) -> None:
        self.count = saved["count"]


class Water(Generator, Device, events=(), draws=("eShow",), coupled=True, when="each frame"):
    """Draws the view into its own state and publishes it; reports how much it has been shown."""

    publishes = ("sight",)

    def __init__(self) -> None:
        self.figures = 0
        self.ripples = 0

    def show(self, view: View) -> None:
        self.figures = sum(1 for opens, _ in walk(view.scene) if opens)

    def generate(self, tick: Tick) -> Iterable[Event]:
        self.ripples += self.figures
        seen = (Sighting("figure", float(self.ripples), 0.0),)
        # Depends on the view and on saved state, so a restart that loses either changes the string.
        tick.publish("sight", Sightings(NAME, seen, tick.time))
        return ()

    def save(self) -> Mapping[str, Any]:
        return {"ripples": self.ripples}

    def restore(self, saved: Mapping[str, Any]) -> None:
        self.ripples = saved["ripples"]


class Lookout(Generator, events=("eSeen",)):
    """Creates events from the readings of the water."""

    topics = ("sight",)

    def generate(self, tick: Tick) -> Iterable[Event]:
        return [
            eSeen(int(sighting.distance))
            for reading in tick.readings
            if isinstance(reading, Sightings)
            for sighting in reading.seen
        ]


class Ranger(Generator, events=()):
    """Publishes a reading for each agent; it has state."""

    by_agent = True
    publishes = ("echo",)

    def __init__(self) -> None:
        self.count = 0

    def generate(self, tick: Tick) -> Iterable[Event]:
        self.count += 1
        for who in ("h3", "h1", "e1", "h2"):
            drawn = stream(tick.frame.seed, f"{tick.who}/{who}", tick.number).random()
            tick.publish("echo", Sightings(who, (Sighting("m", self.count * drawn, 0.0),), 0.0))
        return ()

    def save(self) -> Mapping[str, Any]:
        return {"count": self.count}

    def restore(self, saved: Mapping[str, Any]) -> None:
        self.count = saved["count"]


class Warden(Generator, events=("eSeen",)):
    """Creates events from the readings of each agent."""

    by_agent = True
    topics = ("echo",)

    def generate(self, tick: Tick) -> Iterable[Event]:
        return [
            eSeen(int(100 * reading.seen[0].distance), receivers=(reading.robot,))
            for reading in tick.readings
            if isinstance(reading, Sightings)
        ]


class Clerk(Generator, events=("eMark",), when="on orders"):
    """Creates events from orders."""

    def takes_orders(self) -> tuple[str, ...]:
        return ("eMark",)

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        return tick.orders


class Gulls(Generator, events=("eCry",), when="freely"):
    """Cry after joining, each cry with a new number."""

    def __init__(self, numbers: Iterator[int], cries: int = 3) -> None:
        # Numbers are unique in the whole world, also after a restart, so an event that counts twice
        # is detectable.
        self.cries = [next(numbers) for _ in range(cries)]

    def run(self, emit: Emit, stop: threading.Event) -> None:
        for number in self.cries:
            emit(eCry(number))


class Screen(Device, draws=("eShow",)):
    """An observer that keeps the view of each frame in `shown`."""

    def __init__(self, shown: dict[int, str]) -> None:
        self._shown = shown

    def show(self, view: View) -> None:
        self._shown[view.frame] = str(view.scene)


VOCABULARY: Final = Vocabulary.of(
    PDot, TAt, eTide, eCall, eSeen, eMark, eNote, eCry, eShow, Heron, Eel, Reeds
)
ORDERS: Final = {event_type.name: event_type for event_type in (eMark, eNote)}
"""The event types that people send: one through the clerk, one directly."""

SHARING: Final = frozenset({"clerk", "gulls", "lookout", "tide", "water"})
"""Services that share a process in some histories."""

NORMS: Final = (
    Norm("far", ("AHeron",), when="x > 2", most=1, per=4, sanction=eSeen(40)),
    Norm("loud", on=("eCall",), when="event.x < 3", most=1, per=5, sanction=eSeen(20)),
    Norm("back", ("AHeron",), when="x < was.x and x < 1", then=Then.SANCTION, sanction=eSeen(-30)),
)
"""Norms of some histories."""

GUESTS: Final[Mapping[str, tuple[type[Agent], ...]]] = {
    "egret": (Heron, Eel),
    "stork": (Heron, Eel, Reeds),
}
"""Hosts that are attached during a run, with their agent classes."""


def processes(
    shown: dict[int, str], numbers: Iterator[int], divided: int = 0
) -> tuple[ProcessSpec, ...]:
    """The processes of the world file; so many are `divided` rangers, and as many wardens."""
    return (
        *_dividing("ranger", Ranger, divided),
        *_dividing("warden", Warden, divided),
        ProcessSpec("birds", agents=(Heron, Eel)),
        _service("clerk", Clerk),
        _service("gulls", Gulls, numbers=numbers),
        _service("lookout", Lookout),
        ProcessSpec("marsh", agents=(Reeds, Heron, Eel)),
        _service("screen", Screen, shown=shown),
        _service("tide", Tide),
        _service("water", Water),
    )


def _service(name: str, cls: type[Service], **options: Any) -> ProcessSpec:
    return ProcessSpec(name, Factory(cls, options, name))


def _dividing(table: str, cls: type[Generator], count: int) -> Iterator[ProcessSpec]:
    names = tuple(names_of(table, count)) if count else ()
    for name in names:
        yield replace(_service(name, cls), table=table, dividing=names)


def sharing(process: ProcessSpec) -> ProcessSpec:
    """The process, which shares one with others if it is a service in step."""
    if process.name not in SHARING:
        return process
    # Each of them may be killed as often as a process of its own.
    return replace(process, shared=True, restarts=len(SHARING) * process.restarts)


def world(frames: int, *, norms: bool = False, divided: int = 0) -> WorldSpec:
    """The world, with a number of frames, and perhaps with norms and divided generators."""
    own = processes({}, count(), divided)
    return WorldSpec(
        NAME,
        _scene(),
        VOCABULARY,
        order=Priority(("eTide", "eSeen", "eCall", "eMark", "eNote", "eCry")),
        frames=frames,
        seed=5,
        expected=frozenset(process.name for process in own),
        shares={process.name: process.table for process in own if process.dividing},
        norms=NORMS if norms else (),
    )


@cache
def _scene() -> Scene:
    return VOCABULARY.read(STRING)


def world_file(
    frames: int,
    rate: float,
    folder: Path,
    shown: dict[int, str],
    *,
    shared: bool = False,
    norms: bool = False,
    divided: int = 0,
) -> WorldFile:
    """The world file, with its journal in a folder; `shown` has the drawings of its screen.

    `shared`: services share a process.
    """
    bus = BusSettings(journal=str(folder))
    own = processes(shown, count(1), divided)
    if shared:
        own = tuple(map(sharing, own))
    return WorldFile(
        folder / f"{NAME}.toml", world(frames, norms=norms, divided=divided), rate, own, bus
    )
