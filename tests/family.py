"""A small set of agent kinds that together cover everything that λ and θ may do.

For tests of engines, hosts and buses. Without randomness or a clock, the same string and the
same events always give the same string.
"""

from __future__ import annotations

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import EMPTY, AgentNode, Node, Scene, agents, rebuild, rescoped
from minerva_bus.grammar.types import Metres
from minerva_bus.grammar.vocabulary import EventType, Primitive, Transformation, Vocabulary
from minerva_bus.testing.strategies import events_of, strings_of
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


# --- strings and events of the family, for Hypothesis ---


def family_strings() -> SearchStrategy[Scene]:
    """Strings of agents that change, die, give birth and turn into others; see above."""
    return strings_of(FAMILY_VOCABULARY, depth=0).map(_with_few_births)


def _with_few_births(scene: Scene) -> Scene:
    def leave(node: Node, scope: Scene) -> Node:
        if not isinstance(node, AgentNode) or "births" not in node.names:
            return rescoped(node, scope)
        # Any 64-bit integer may be drawn: few are below the 3 of `births < 3`, and the largest
        # cannot be incremented.
        state = {**node.state, "births": node.state["births"] % 4}
        return AgentNode(node.symbol, node.id, node.names, tuple(state.values()), scope)

    return rebuild(scene, leave)


def family_events(scene: Scene, visual: bool = False) -> SearchStrategy[list[Event]]:
    """Events of a frame for a string of the family, each once."""
    names = [
        event_type.name
        for event_type in FAMILY_VOCABULARY.events.values()
        if event_type.visual is visual
    ]
    present = [agent.id for agent in agents(scene)]
    # Always, for some kinds, for some states, and never.
    conditions = ("", "energy > 0", "x < 3 and energy >= 1", "nothing == 1")
    single = events_of(FAMILY_VOCABULARY, present, conditions, names)
    return st.lists(single, max_size=5, unique=True)
