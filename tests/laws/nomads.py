"""A world whose agents do everything that regions have to keep in order, for tests of regions."""

from minerva_bus.grammar.packing import packed
from minerva_bus.grammar.scene import EMPTY, Scene
from minerva_bus.grammar.symbols import EventType, Primitive, Transformation
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.agent import Agent
from minerva_bus.world.marking import on

NOMADS, SETTLERS = 24, 40

PStone = Primitive("PStone")
TWrap = Transformation("TWrap")
eStep = EventType("eStep")
eCall = EventType("eCall", value=int)
eArrive = EventType("eArrive")
eTire = EventType("eTire")


class Settler(Agent, symbol="ASettler"):
    """Moves, calls, gives birth and dies; enough of them stand together to be in columns."""

    x: float = 0.0
    y: float = 0.0
    births: int = 0
    heard: int = 0

    @on("eStep")
    def act(self, step, moment):
        self.x += moment.chance.uniform(-1.0, 1.0)
        self.y += moment.chance.uniform(-1.0, 1.0)
        self.speak(moment)
        return self.replaced(moment.chance.random())

    def speak(self, moment):
        value = moment.chance.integers(100)
        if moment.chance.chance(0.3):
            kind = "n" if moment.chance.chance(0.5) else "s"
            names = [f"{kind}{moment.chance.integers(NOMADS)}", f"s{value % SETTLERS}"]
            moment.emit(eCall(value=value, receivers=names[: 1 + value % 2]))
        if moment.chance.chance(0.1):
            near = f"distance(x, y, {self.x}, {self.y}) < 1.5"
            moment.emit(eCall(value=value, condition=near if value % 2 else "x > 0"))

    def replaced(self, drawn):
        if drawn < 0.1:
            return self.string + self.child(x=self.x, y=self.y)
        if drawn < 0.15:
            return self.string + self.child(x=-self.x) + self.child(y=-self.y)
        return EMPTY if drawn < 0.2 else None

    @on("eCall")
    def hear(self, call, moment):
        # Calls in another order give another number.
        self.heard = (self.heard * 31 + call.value) % 100_003
        if call.sender and call.value < 20:
            moment.emit(eCall(value=call.value + 20, receivers=[call.sender]))


class Nomad(Settler, symbol="ANomad"):
    """Also has children before itself and within itself, leaves stones, and wraps itself."""

    def replaced(self, drawn):
        if drawn > 0.95:
            return self.child(Settler, x=self.x) + self.string
        if drawn > 0.9:
            return PStone()
        if drawn > 0.8:
            return PStone() + self.string + PStone()
        if drawn > 0.75:
            self.scope = self.scope + self.child(x=self.x)
        if drawn > 0.7:
            return TWrap()(self.string)
        return super().replaced(drawn)


class Pilgrim(Settler, symbol="APilgrim"):
    """Moves, and arrives after some frames; may give up before."""

    left: int = 1
    strength: int = 9

    @on("eStep")
    def act(self, step, moment):
        self.x += moment.chance.uniform(-1.0, 1.0)
        self.left -= 1
        if self.left == 0:
            moment.emit(eArrive())
        self.strength -= 1
        if self.strength == 0:
            moment.emit(eTire())


KINDS = (Settler, Nomad, Pilgrim)
VOCABULARY = Vocabulary.of(PStone, TWrap, eStep, eCall, eArrive, eTire, *KINDS)


def string():
    """Nomads with stones between them, around a population of settlers."""
    nomads = [Nomad(f"n{n}", x=n % 5 - 2.0, y=n % 3 - 1.0).string for n in range(NOMADS)]
    settlers = [Settler(f"s{n}", x=n % 7 - 3.0).string for n in range(SETTLERS)]
    half = [nomad + PStone() for nomad in nomads[: NOMADS // 2]]
    nodes = [node for part in (*half, *settlers, *nomads[len(half) :]) for node in part.nodes]
    return VOCABULARY.check(packed(Scene(tuple(nodes))))
