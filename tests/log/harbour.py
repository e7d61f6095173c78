"""A small world with people, orders, norms, agents within agents, and messages between them."""

from dataclasses import replace

from minerva_bus import EMPTY, Agent, EventType, Generator, World, each, on
from minerva_bus.grammar.scene import Scene, with_scope

eTide = EventType("eTide")
eCargo = EventType("eCargo", tons=int)
eSail = EventType("eSail", x=float)
eSignal = EventType("eSignal", text=str)
eWind = EventType("eWind", speed=float)


class Port(Agent, symbol="APort"):
    """Sends a signal in every fifth frame; the pilot answers it."""

    answers: int = 0

    @on("eTide")
    def watch(self, tide, moment):
        if moment.number % 5 == 0:
            moment.emit(eSignal("come", receivers=("pilot",)))

    @on("eSignal")
    def count(self, signal, moment):
        self.answers += 1


class Pilot(Agent, symbol="APilot"):
    calls: int = 0

    @on("eSignal")
    def answer(self, signal, moment):
        self.calls += 1
        moment.emit(eSignal("coming", receivers=("port",)))


class Ship(Agent, symbol="AShip"):
    """Carries a crew in its scope, which a strong wind drives below deck."""

    x: float = 0.0
    tons: int = 0
    births: int = 0

    @on("eCargo")
    def load(self, cargo, moment):
        self.tons += cargo.tons

    @on("eSail")
    def sail(self, sail, moment):
        self.x = sail.x

    @on("eWind")
    def shelter(self, wind, moment):
        nodes = [replace(n, values=(True,)) if n.symbol == "ACrew" else n for n in self.scope]
        return Scene((with_scope(self.freeze(), Scene(tuple(nodes))),)) + self.child(Raft)


class Raft(Agent, symbol="ARaft"):
    afloat: bool = True

    @on("eTide")
    def sink(self, tide, moment):
        return EMPTY if moment.number > 13 else None


class Crew(Agent, symbol="ACrew"):
    below: bool = False


class Cranes(Generator, events=("eCargo",)):
    """Loads what people order, two frames later."""

    def __init__(self):
        self.waiting = []

    def takes_orders(self):
        return ("eCargo",)

    def generate(self, tick):
        self.waiting += [(tick.number + 2, order) for order in tick.orders]
        return [order for number, order in self.waiting if number == tick.number]


class Weather(Generator, events=("eWind",)):
    def generate(self, tick):
        return [eWind(12.0)] if tick.number == 9 else []


def harbour(agents=(Port, Pilot, Ship, Raft, Crew)):
    return World(
        "APort#port · APilot#pilot · AShip#s1(ACrew#c1) · AShip#s2",
        agents=list(agents),
        services=[each(eTide), Cranes, Weather],
        symbols=[eSail],
        norms={
            "draught": {"applies": "AShip", "when": "tons > 50"},
            "inshore": {"on": "eSail", "when": "event.x > 100"},
        },
        name="harbour",
    )
