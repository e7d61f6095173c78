"""A small set of agent kinds that together cover everything that λ and θ may do.

For tests of engines, hosts and buses. Without randomness or a clock, the same string and the
same events always give the same string.
"""
# ruff: noqa: N816 - event types are named as the paper names them

from __future__ import annotations

from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import EMPTY, Scene
from minerva_bus.grammar.symbols import EventType, Primitive, Transformation
from minerva_bus.grammar.types import Metres
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.agent import Agent
from minerva_bus.world.class_declaration import on, view
from minerva_bus.world.context import Context

PDot = Primitive("PDot", size=float)
PGrave = Primitive("PGrave")
TShift = Transformation("TShift", x=Metres)

eStep = EventType("eStep", dist=Metres)
eHit = EventType("eHit", amount=float)
eGrow = EventType("eGrow")
eTurn = EventType("eTurn")
eShow = EventType("eShow", visual=True)
eMark = EventType("eMark", visual=True, size=float)


class Walker(Agent, symbol="AWalker"):
    """Changes its state, and shows itself around its scope."""

    x: Metres = 0.0
    energy: float = 3.0

    @on("eStep")
    def step(self, step: Event, moment: Context) -> None:
        self.x = step.dist

    @on("eHit")
    def tire(self, hit: Event, moment: Context) -> None:
        self.energy = self.energy / 2

    @view("eShow")
    def picture(self, event: Event) -> Scene:
        return TShift(self.x)(PDot(self.energy), self.scope)

    @view("eMark")
    def mark(self, event: Event) -> Scene:
        return PDot(event.size)


class Mortal(Agent, symbol="AMortal"):
    """Dies when it is hit too hard, leaving a grave or nothing."""

    energy: float = 1.0

    @on("eHit")
    def suffer(self, hit: Event, moment: Context) -> Scene | None:
        if hit.amount > 10.0:
            return EMPTY
        if hit.amount > self.energy:
            return PGrave()
        self.energy = self.energy - max(0.0, hit.amount)
        return None

    @view("eShow")
    def picture(self, event: Event) -> Scene:
        return PDot(self.energy)


class Parent(Agent, symbol="AParent"):
    """Gives birth beside itself, within itself, and wraps itself in a transformation."""

    births: int = 0
    x: Metres = 0.0

    @on("eGrow")
    def grow(self, event: Event, moment: Context) -> Scene:
        mortal, parent = self.child(Mortal, energy=2.0), self.child(x=self.x)
        return self.string + mortal + TShift(self.x)(parent)

    @on("eStep")
    def move(self, step: Event, moment: Context) -> Scene:
        self.scope = self.scope + self.child(Walker)
        return TShift(step.dist)(self.string)


class Chameleon(Agent, symbol="AChameleon"):
    """Turns into an agent of another kind, which receives the rest of the frame's events."""

    x: Metres = 1.0

    @on("eTurn")
    def turn(self, event: Event, moment: Context) -> Scene:
        return Walker(self.id, x=self.x, scope=self.scope).string


class Caller(Agent, symbol="ACaller"):
    """Answers events with events for the next frame."""

    heard: int = 0

    @on("eHit", "eTurn")
    def call(self, event: Event, moment: Context) -> None:
        # Any 64-bit integer may be drawn for this attribute, and the largest cannot be incremented.
        self.heard = (self.heard + 1) % 1000
        moment.emit(eHit(amount=float(self.heard), receivers=[self.id]))
        moment.emit(eGrow(condition="births < 3"))


FAMILY: tuple[type[Agent], ...] = (Walker, Mortal, Parent, Chameleon, Caller)
FAMILY_VOCABULARY = Vocabulary.of(
    PDot, PGrave, TShift, eStep, eHit, eGrow, eTurn, eShow, eMark, *FAMILY
)
