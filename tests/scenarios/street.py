"""A street for norms: runners run, shout and breed; a light changes; λ in both forms."""

from minerva_bus import EMPTY, Agent, Context, Event, EventType, Generator, Tick, Vocabulary, on
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.scene import agents
from minerva_bus.world.event_collection import Priority
from minerva_bus.world.norms import Norm, Then

eStep = EventType("eStep")
eBoo = EventType("eBoo")
eShout = EventType("eShout", loud=float)
eFine = EventType("eFine", amount=int, norm=str)


class State(Agent):
    """The common part of both forms."""

    x: float = 0.0
    y: float = 0.0
    speed: float = 1.0
    heard: int = 0
    fined: int = 0
    births: int = 0


class One(State, symbol="ARunner"):
    """λ for a single agent."""

    @on("eStep")
    def step(self, step, moment):
        self.speed += moment.chance.uniform(-1.0, 1.5)
        self.x += self.speed
        moment.emit(eShout(self.speed, condition="heard < 9"))
        if moment.chance.chance(0.1):
            return self.string + self.child(x=self.x, speed=self.speed + 1)
        return EMPTY if self.x > 40 else None

    @on("eShout")
    def hear(self, shout, moment):
        self.heard += 1

    @on("eFine")
    def pay(self, fine, moment):
        self.fined += fine.amount
        self.speed -= 1


class Many(State, symbol="ARunner"):
    """λ for the whole population."""

    @on("eStep", population=True)
    def step(self, step, moment):
        self.speed += moment.chance.uniform(-1.0, 1.5)
        self.x += self.speed
        moment.emit(eShout(self.speed, condition="heard < 9"))
        born = moment.chance.chance(0.1)
        self.bear(born, x=self.x, speed=self.speed + 1)
        self.die((self.x > 40) & ~born)

    @on("eShout", population=True)
    def hear(self, shout, moment):
        self.heard += 1

    @on("eFine", population=True)
    def pay(self, fine, moment):
        self.fined += fine.amount
        self.speed -= 1


class Light(Agent, symbol="ALight"):
    green: bool = True

    @on("eStep")
    def change(self, step: Event, moment: Context) -> None:
        self.green = moment.number % 4 < 2


class Steps(Generator, events=("eStep", "eBoo")):
    """A step in every frame, and a boo in every second frame."""

    def generate(self, tick: Tick):
        yield eStep()
        if tick.number % 2:
            yield eBoo()


class Passer(Agent, symbol="APasser"):
    """Counts boos."""

    boos: int = 0

    @on("eBoo")
    def shy(self, boo: Event, moment: Context) -> None:
        self.boos += 1


VOCABULARY = vocabulary = Vocabulary.of(eStep, eBoo, eShout, eFine, One, Light, Passer)
FINE = Norm("fine", then=Then.SANCTION, sanction=eFine(5, "fine"))


def street(scene, norms, expected=("runners", "steps"), **rest):
    """The world of the street."""
    rest = {"frames": 8, "seed": 3, "order": Priority(("eFine", "eShout", "eBoo", "eStep")), **rest}
    string = VOCABULARY.read(scene) if isinstance(scene, str) else scene
    return WorldSpec(
        "street", string, VOCABULARY, expected=frozenset(expected), norms=norms, **rest
    )


def states(scene):
    """The states of agents by id."""
    return {agent.id: dict(agent.state) for agent in agents(scene)}
