"""A colony of ants: a world in which every lost message shows, for runs under faults.

Ants walk at random, call each other, are born and die; the weather and the clock have internal
state; the ground is a coupled device that responds to its views. The seed determines everything.
"""

from minerva_bus import (
    EMPTY,
    Agent,
    Context,
    Device,
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
from minerva_bus.grammar.events import Event

SIZE = 50.0
PAnt = Primitive("PAnt", load=float)
TMove = Transformation("TMove", x=Metres, y=Metres)
eStep = EventType("eStep", count=int)
eRain = EventType("eRain", amount=float)
eCall = EventType("eCall", x=Metres, y=Metres)
eCrowded = EventType("eCrowded", ants=int)
eLay = EventType("eLay")
eShow = EventType("eShow", visual=True)


class Ant(Agent, symbol="AAnt"):
    """One ant."""

    x: Metres = 0.0
    y: Metres = 0.0
    load: float = 0.0
    heard: int = 0
    births: int = 0

    @on("eStep")
    def walk(self, step: Event, moment: Context) -> Scene | None:
        self.x = (self.x + moment.random.normal()) % SIZE
        self.y = (self.y + moment.random.normal()) % SIZE
        self.load += 0.001 * step.count
        if moment.random.random() < 0.02:
            moment.emit(eCall(self.x, self.y))
        if moment.random.random() < 0.002:
            return EMPTY
        return None

    @on("eLay")
    def lay(self, _: Event, moment: Context) -> Scene | None:
        return (
            self.string + self.child(x=self.y, y=self.x) if moment.random.random() < 0.05 else None
        )

    @on("eCall")
    def hear(self, call: Event, _: Context) -> None:
        if abs(call.x - self.x) < 5.0 and abs(call.y - self.y) < 5.0:
            self.heard += 1

    @on("eRain")
    def shelter(self, rain: Event, _: Context) -> None:
        self.load = max(0.0, self.load - rain.amount)

    @on("eCrowded")
    def quarrel(self, crowded: Event, moment: Context) -> Scene | None:
        return EMPTY if moment.random.random() < 0.1 * (crowded.ants - 220) / 220 else None

    @view("eShow")
    def picture(self, _: Event) -> Scene:
        return TMove(self.x, self.y)(PAnt(self.load))


class Steps(Generator, events=("eStep",)):
    """The clock, which has internal state."""

    def __init__(self) -> None:
        self.count = 0

    def generate(self, tick: Tick) -> tuple[Event, ...]:
        self.count += int(tick.random.integers(1, 4))
        return (eStep(self.count % 97),)

    def save(self) -> dict[str, int]:
        return {"count": self.count}

    def restore(self, saved: dict[str, int]) -> None:
        self.count = saved["count"]


class Weather(Generator, events=("eRain",)):
    """Occasional rain."""

    def __init__(self) -> None:
        self.wet = 0.0

    def generate(self, tick: Tick) -> tuple[Event, ...]:
        self.wet = 0.9 * self.wet + tick.random.random()
        return (eRain(self.wet),) if self.wet > 6.0 else ()

    def save(self) -> dict[str, float]:
        return {"wet": self.wet}

    def restore(self, saved: dict[str, float]) -> None:
        self.wet = saved["wet"]


class Ground(
    Generator,
    Device,
    events=("eCrowded", "eLay"),
    draws=("eShow",),
    coupled=True,
    when="each frame",
):
    """Counts the ants in its views and emits events that limit their number."""

    def __init__(self) -> None:
        self.ants = 0

    def show(self, view: View) -> None:
        self.ants = len(view.scene)

    def generate(self, tick: Tick) -> tuple[Event, ...]:
        if tick.number % 5:
            return ()
        return (eCrowded(self.ants),) if self.ants > 220 else (eLay(),) if self.ants < 200 else ()


class Screen(Device, draws=("eShow",), when="each frame"):
    """An observer."""

    def show(self, view: View) -> None:
        self.frame = view.frame


vocabulary = Vocabulary.of(PAnt, TMove, Ant, eStep, eRain, eCall, eCrowded, eLay, eShow)
