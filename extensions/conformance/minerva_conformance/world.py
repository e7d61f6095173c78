"""The world of the conformance suite: its vocabulary, and the members that it expects.

`docs/howto/other-languages.md` describes it in words. A member under test behaves as the class of
its role here; the suite gives the same messages to both and compares their answers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from enum import StrEnum
from typing import Any, Final

from minerva_bus.frame import messages as m
from minerva_bus.frame.member_side import Member
from minerva_bus.grammar.events import AnyEvent, Event
from minerva_bus.grammar.scene import EMPTY, Scene, walk
from minerva_bus.grammar.types import Metres
from minerva_bus.grammar.vocabulary import EventType, Primitive, Vocabulary
from minerva_bus.world.agent import Agent
from minerva_bus.world.class_declaration import on, view
from minerva_bus.world.context import Context
from minerva_bus.world.readings import Battery, Sightings
from minerva_bus.world.services import Device, Generator, Tick, View

SEED: Final = 7
DT: Final = 0.1
MEMBER: Final = "member"

PBar = Primitive("PBar", length=Metres)
eAdd = EventType("eAdd", amount=float)  # noqa: N816 - event types are named as in the paper
eCall = EventType("eCall", amount=float)  # noqa: N816
eDraw = EventType("eDraw")  # noqa: N816
eEnd = EventType("eEnd")  # noqa: N816
eMaybe = EventType("eMaybe")  # noqa: N816
eName = EventType("eName", name=str)  # noqa: N816
eSplit = EventType("eSplit", amount=float)  # noqa: N816
eShow = EventType("eShow", visual=True)  # noqa: N816


class Counter(Agent, symbol="ACounter"):
    """The kind of agents that a host evolves."""

    total: Metres = 0.0
    name: str = ""
    births: int = 0

    @on("eAdd")
    def add(self, event: Event, moment: Context) -> None:
        """Add the amount to the total."""
        self.total += event.amount

    @on("eCall")
    def call(self, event: Event, moment: Context) -> None:
        """Emit eAdd with the same amount, for all agents, and another one for itself."""
        moment.emit(eAdd(event.amount))
        moment.emit(eAdd(event.amount / 2.0, receivers=[self.id]))

    @on("eDraw")
    def draw(self, event: Event, moment: Context) -> None:
        """Set the total to the next number of the agent's SplitMix64 stream."""
        self.total = moment.chance.random()

    @on("eEnd")
    def end(self, event: Event, moment: Context) -> Scene:
        """Die."""
        return EMPTY

    @on("eMaybe", probability=0.5)
    def respond(self, event: Event, moment: Context) -> None:
        """Add 1 to the total."""
        self.total += 1.0

    @on("eName")
    def rename(self, event: Event, moment: Context) -> None:
        """Take the name."""
        self.name = event.name

    @on("eSplit")
    def split(self, event: Event, moment: Context) -> Scene:
        """Become itself and, after it, a child with this total."""
        child = self.child(total=event.amount)
        return self.string + child

    @view("eShow")
    def show(self, event: Event) -> Scene:
        """A bar as long as the total."""
        return PBar(self.total)


class NumberGenerator(Generator, events=("eAdd",)):
    """A generator in step that counts its ticks, passes orders on and adds up sightings."""

    topics = ("sight",)
    publishes = ("echo",)

    def __init__(self) -> None:
        self.count = 0

    def takes_orders(self) -> tuple[str, ...]:
        """Orders of the type that it generates."""
        return self.events

    def generate(self, tick: Tick) -> Iterator[AnyEvent]:
        """The count and a half, then the orders, then the distance of each sighting."""
        yield eAdd(self.count + 0.5)
        yield from tick.orders
        for reading in tick.readings:
            assert isinstance(reading, Sightings)
            for sighting in reading.seen:
                yield eAdd(sighting.distance)
        tick.publish("echo", Battery("r1", 1.0, float(self.count), float(tick.number)))
        self.count += 1

    def save(self) -> Mapping[str, int]:
        """The count."""
        return {"count": self.count}

    def restore(self, saved: Any) -> None:
        """Continue with a count."""
        self.count = int(saved["count"])

    def report(self) -> Mapping[str, int]:
        """The number of answered ticks."""
        return {"ticks": self.count}


class Bars(Device, draws=("eShow",), when="each frame"):
    """A device that reports what it has drawn last."""

    def __init__(self) -> None:
        self.drawn: dict[str, int | float] = {}

    def show(self, view: View) -> None:
        """Measure the bars of a view."""
        bars = [node.values[0] for opens, node in walk(view.scene) if opens]
        lengths = [float(length) for length in bars if isinstance(length, float)]
        self.drawn = {"bars": len(bars), "length": sum(lengths), "frame": view.frame}

    def report(self) -> Mapping[str, int | float]:
        """Number of bars, sum of their lengths and frame of the last view."""
        return self.drawn


class CoupledBars(Bars, draws=("eShow",), coupled=True):
    """A coupled device: each view is drawn before the next tick is answered."""

    def __init__(self) -> None:
        super().__init__()
        self.views = 0

    def show(self, view: View) -> None:
        """Measure and count the views."""
        super().show(view)
        self.views += 1

    def report(self) -> Mapping[str, int | float]:
        """As `Bars`, and the number of views."""
        return {**self.drawn, "views": self.views}


VOCABULARY: Final = Vocabulary.of(
    PBar, eAdd, eCall, eDraw, eEnd, eMaybe, eName, eSplit, eShow, Counter
)


class MemberRole(StrEnum):
    """What a member under test does in the world."""

    GENERATOR = "generator"
    HOST = "host"
    OBSERVER = "observer"
    COUPLED = "coupled"


_MEMBERS: Final[Mapping[MemberRole, Callable[[], Member]]] = {
    MemberRole.GENERATOR: lambda: Member(MEMBER, NumberGenerator()),
    MemberRole.HOST: lambda: Member(MEMBER, None, [Counter]),
    MemberRole.OBSERVER: lambda: Member(MEMBER, Bars()),
    MemberRole.COUPLED: lambda: Member(MEMBER, CoupledBars()),
}


def reference(role: MemberRole) -> Member:
    """A new member of this role, as the suite expects it."""
    return _MEMBERS[role]()


def roles_of(hello: m.Hello) -> tuple[MemberRole, ...]:
    """The roles that a member declares."""
    device = MemberRole.COUPLED if hello.coupled else MemberRole.OBSERVER
    offered = (
        (MemberRole.HOST, bool(hello.kinds)),
        (MemberRole.GENERATOR, bool(hello.generates) and hello.when.is_awaited),
        (device, bool(hello.draws)),
    )
    return tuple(role for role, offers in offered if offers)


def capabilities_of(hello: m.Hello) -> frozenset[str]:
    """What a member declares beyond its role, as cases require it."""
    offered = {
        "topics": bool(hello.topics),
        "publishes": bool(hello.publishes),
        "orders": bool(hello.orders),
        "columns": not hello.plain,
        "plain": hello.plain,
    }
    return frozenset(name for name, offers in offered.items() if offers)
