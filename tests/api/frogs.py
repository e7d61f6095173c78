"""A small world in a module that other processes can import."""

from minerva_bus import EMPTY, Agent, EventType, Primitive, Transformation, World, each, on, view

PFrog = Primitive("PFrog", size=float)
TAt = Transformation("TAt", x=float)
eTick = EventType("eTick")
eCroak = EventType("eCroak", loud=float)
eCross = EventType("eCross")
eFeed = EventType("eFeed", amount=float)
ePicture = EventType("ePicture", visual=True)


def figure(size):
    return PFrog(size)


class Frog(Agent, symbol="AFrog"):
    x: float = 0.0
    size: float = 1.0
    age: int = 0
    hungry: bool = True
    mood: str = "calm"

    @on("eTick")
    def live(self, tick, moment):
        self.x += moment.random.normal()
        self.age += 1
        self.mood = "loud" if self.age % 2 else "calm"
        if self.age % 3 == 0:
            moment.emit(eCroak(loud=self.size))

    @on("eFeed")
    def eat(self, feed, moment):
        self.size += feed.amount
        self.hungry = False

    @view("ePicture")
    def picture(self, event):
        return TAt(self.x)(figure(self.size))


class Toad(Agent, symbol="AToad"):
    age: int = 0

    @on("eTick")
    def live(self, tick, moment):
        self.age += 1
        if self.age == 3:
            raise ValueError("no more flies")


class Racer(Agent, symbol="ARacer"):
    steps: int = 0

    @on("eTick")
    def run(self, tick, moment):
        self.steps += 1
        if self.steps == 3:
            moment.emit(eCross())
            return EMPTY if self.id == "ghost" else self.string
        return self.string


def race(racer):
    """A world whose agent sends eCross in frame 2; a ghost vanishes there."""
    return World(f"ARacer#{racer}", agents=[Racer], services=[each(eTick)], symbols=[eCross])


def marsh():
    """A world whose code fails in frame 2."""
    return World("AToad#t", agents=[Toad], services=[each(eTick)], name="marsh")


def pond(**settings):
    return World(
        "AFrog#a · AFrog#b<size=2> · TAt<x=5>(AFrog#c<size=3>)",
        agents=[Frog],
        services=[each(eTick)],
        name="pond",
        **settings,
    )
