"""A pond: a small world with all situations that the frame algorithm must handle.

Frogs move at random, croak, are born and die; flies react to frogs; a lily contains other agents.
Water is a coupled device and a generator with state, and publishes readings; an eye turns these
into events; steps have state, too.
"""

import re
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

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
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.stimuli import Abandoned
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.scene import walk
from minerva_bus.world.event_collection import Priority
from minerva_bus.world.readings import Sighting, Sightings
from tests.memory_bus import MemoryBus

PDot = Primitive("PDot", x=Metres)
TAt = Transformation("TAt", x=Metres)
eAdd = EventType("eAdd", n=int)
eStep = EventType("eStep", count=int)
eCroak = EventType("eCroak", x=Metres)
eSeen = EventType("eSeen", figures=int)
eDone = EventType("eDone")
eShow = EventType("eShow", visual=True)


class Counter(Agent, symbol="ACounter"):
    """The simplest agent, for traces that a person can follow."""

    n: int = 0

    @on("eAdd")
    def add(self, add: Event, moment: Context) -> Scene | None:
        self.n += add.n
        if self.n >= 100:
            return EMPTY
        if self.n == 7:
            moment.emit(eDone())
        return None

    @view("eShow")
    def picture(self, event: Event) -> Scene:
        return PDot(float(self.n))


class Mother(Agent, symbol="AMother"):
    """Creates a counter beside itself for every event."""

    births: int = 0

    @on("eAdd")
    def bear(self, add: Event, moment: Context) -> Scene:
        return self.string + self.child(Counter, n=add.n)


class Tadpole(Agent, symbol="ATadpole"):
    """Turns into a counter after some events."""

    n: int = 0

    @on("eAdd")
    def grow(self, add: Event, moment: Context) -> Scene | None:
        self.n += add.n
        return Counter(self.id, n=self.n).string if self.n >= 2 else None


class Frog(Agent, symbol="AFrog"):
    x: Metres = 0.0
    heard: int = 0
    births: int = 0

    @on("eStep")
    def hop(self, step: Event, moment: Context) -> Scene | None:
        self.x += moment.random.normal() + 0.001 * step.count
        if moment.random.random() < 0.4:
            moment.emit(eCroak(self.x))
        if moment.random.random() < 0.15:
            return self.string + self.child(x=self.x)
        return None

    @on("eCroak")
    def listen(self, croak: Event, moment: Context) -> Scene | None:
        self.heard += croak.sender != self.id
        return EMPTY if self.heard > 12 else None

    @on("eSeen")
    def hide(self, seen: Event, moment: Context) -> None:
        self.x -= 0.01 * seen.figures

    @view("eShow")
    def picture(self, event: Event) -> Scene:
        return TAt(self.x)(PDot(float(self.heard)))


class Fly(Agent, symbol="AFly"):
    jumps: int = 0
    x: Metres = 0.0

    @on("eCroak")
    def flee(self, croak: Event, moment: Context) -> None:
        self.jumps += 1
        self.x = croak.x + moment.random.random()

    @view("eShow")
    def picture(self, event: Event) -> Scene:
        return PDot(self.x)


class Lily(Agent, symbol="ALily"):
    """Contains other agents."""

    steps: int = 0

    @on("eStep")
    def count(self, step: Event, moment: Context) -> None:
        self.steps += 1 + len(self.scope)

    @view("eShow")
    def picture(self, event: Event) -> Scene:
        return TAt(1.0)(self.scope)


class Minnow(Agent, symbol="AMinnow"):
    """Member of a population: swims, splits, dies and croaks at random."""

    x: Metres = 0.0
    births: int = 0

    @on("eStep", population=True)
    def swim(self, step: Any, moment: Any) -> None:
        self.x += moment.chance.normal() + 0.001 * step.count
        moment.emit(eCroak(self.x, receivers=self.id), where=moment.chance.chance(0.4))
        self.bear(moment.chance.chance(0.15), x=self.x / 2)

    @on("eCroak", population=True)
    def startle(self, croak: Any, moment: Any) -> None:
        self.x += croak.x
        self.die(moment.chance.chance(0.3))

    @view("eShow", population=True)
    def show(self, event: Any) -> Scene:
        return TAt(self.x)(PDot(0))


class Add(Generator, events=("eAdd",)):
    """Emits one event per frame, always the same."""

    def __init__(self, n: int = 1) -> None:
        self.n = n

    def generate(self, tick: Tick) -> Iterable[Event]:
        return (eAdd(self.n),)

    def report(self) -> Mapping[str, int]:
        return {"adders": 1, "added": self.n}


class Steps(Generator, events=("eStep",)):
    """Has a state that a successor must inherit."""

    def __init__(self) -> None:
        self.count = 0

    def generate(self, tick: Tick) -> Iterable[Event]:
        self.count += int(tick.random.integers(1, 4))
        return (eStep(self.count),)

    def save(self) -> Mapping[str, Any]:
        return {"count": self.count}

    def restore(self, saved: Mapping[str, Any]) -> None:
        self.count = saved["count"]


class Water(Generator, Device, events=(), draws=("eShow",), coupled=True, when="each frame"):
    """Draws the view into its own state, and publishes the visible part."""

    publishes = ("sight",)

    def __init__(self) -> None:
        self.figures = 0
        self.ripples = 0

    def show(self, view: View) -> None:
        self.figures = sum(1 for opens, _ in walk(view.scene) if opens)

    def generate(self, tick: Tick) -> Iterable[Event]:
        self.ripples += self.figures
        seen = (Sighting("figure", float(self.ripples), 0.0),)
        tick.publish("sight", Sightings("pond", seen, tick.time))
        return ()

    def save(self) -> Mapping[str, Any]:
        return {"ripples": self.ripples}

    def restore(self, saved: Mapping[str, Any]) -> None:
        self.ripples = saved["ripples"]

    def report(self) -> Mapping[str, int]:
        return {"ripples": self.ripples}


class Eye(Generator, events=("eSeen",)):
    topics = ("sight",)

    def generate(self, tick: Tick) -> Iterable[Event]:
        return [eSeen(int(sighting.distance)) for r in tick.readings for sighting in r.seen]


class Screen(Device, draws=("eShow",)):
    """An observer that stores each view that it is shown as text."""

    def __init__(self, every: int = 1) -> None:
        self.when = f"each {every} frames" if every else ""
        self.shown: list[str] = []

    def show(self, view: View) -> None:
        self.shown.append(f"{view.frame}: {view.scene}")

    def report(self) -> Mapping[str, int]:
        return {"pictures": len(self.shown)}


VOCABULARY = Vocabulary.of(
    *(
        PDot,
        TAt,
        eAdd,
        eStep,
        eCroak,
        eSeen,
        eDone,
        eShow,
        Counter,
        Mother,
        Tadpole,
        Frog,
        Fly,
        Lily,
        Minnow,
    )
)


def world(text: str | Scene, expected: Iterable[str], **rest: Any) -> WorldSpec:
    """A world with the pond's vocabulary."""
    rest = {"order": Priority(("eAdd", "eStep", "eSeen", "eCroak")), **rest}
    return WorldSpec(
        rest.pop("name", "pond"),
        VOCABULARY.read(text) if isinstance(text, str) else text,
        VOCABULARY,
        expected=frozenset(expected),
        **rest,
    )


def service(name: str, make: Any) -> Any:
    """A factory of a member with a service."""
    return lambda: Member(name, make())


def host(name: str, *kinds: type[Agent]) -> Any:
    """A factory of a host of agents."""
    return partial(Member, name, None, kinds)


USUAL = {
    r"> (?P<who>\w+) joins at frame (?P<n>\d+): (?P<rest>.*)": (
        "> {who} appeared", "{who} ← greet", "> {who}: hello, {rest}", "{who} ← welcome to frame {n}",
    ),
    r"> begin (?P<n>\d+)": ("> begin", "~tick ← tick {n}"),
    r"frame (?P<n>\d+) is done: (?P<rest>.*)": ("frame {n} done: {rest}", "ready for frame {next}"),
    r"> frame (?P<n>\d+) as usual: (?P<rest>.*)": (
        "> begin", "~tick ← tick {n}", "> add: ticked {n}: eAdd<n=1>",
        "~hosts ← evolve {n} on host: eAdd<n=1>", "> host: evolved {n}: {ids}",
        "frame {n} done: eAdd<n=1>; {rest}", "ready for frame {next}",
    ),
}  # fmt: skip
"""What usually happens, by a pattern for a line of a trace that stands for it.

"As usual" is a frame of `counters` in which nothing else happens.
"""


def whole(short: str) -> list[str]:
    """The lines that a line of an expected trace stands for."""
    for pattern, lines in USUAL.items():
        if match := re.fullmatch(pattern, short.strip()):
            given = match.groupdict("")
            ids = " ".join(re.findall(r"(#[\w:]+): ", given.get("rest", "")))
            return [line.format(**given, next=int(given["n"]) + 1, ids=ids) for line in lines]
    return [short.strip()]


class Bus(MemoryBus):
    """A bus that executes the steps of a scenario as a text, and compares its trace with one."""

    def do(self, steps: str) -> "Bus":
        """Execute steps such as "hold up host, frame, vanish host, settle, release, run 2".

        They are methods of the bus with names, links or numbers of frames as arguments. `abandon`
        gives a member up; `clear` empties the trace.
        """
        for step in steps.split(", "):
            match step.split():
                case ["clear"]:
                    self.trace.clear()
                case ["abandon", name]:
                    self.handle(Abandoned(name))
                case ["run", frames]:
                    self.run(int(frames))
                case ["hold" | "step" | "drop" as deed, *link]:
                    getattr(self, deed)((*link, "") if len(link) == 1 else tuple(link))
                case [deed, *names]:
                    getattr(self, deed)(*names)
        return self

    def join(self, name: str, make: Any) -> None:
        """Let another member appear, or one of this name as another."""
        self.makers[name] = make
        self.appear(name)

    def expect(self, trace: str) -> None:
        """Check the trace since the last call; blanks around lines are ignored.

        A line that begins as one of USUAL stands for the lines of what usually happens.
        """
        lines = [line.strip() for line in self.trace]
        self.trace.clear()
        assert lines == [line for short in trace.strip().splitlines() for line in whole(short)], (
            "\n".join(lines)
        )


def counters(text: str = "ACounter#a · ACounter#b", **rest: Any) -> Bus:
    """The plain world: one generator, and one host of counters; `members` adds to them."""
    members = {"add": service("add", Add), "host": host("host", Counter), **rest.pop("members", {})}
    expected = rest.pop("expected", members)
    return Bus(world(text, expected, **rest), members)


def started(*text: str, after: int = 1, **rest: Any) -> Bus:
    """Counters after some frames, with an empty trace."""
    return counters(*text, **rest).do(f"start, run {after}, clear")


def finished(*text: str, **rest: Any) -> Bus:
    """Counters whose world has run to its end."""
    return counters(*text, **rest).do("start, run")


def undisturbed(frames: int, **rest: Any) -> list[str]:
    """The digests of so many frames in which nothing else happens."""
    return started(after=frames, **rest).digests
