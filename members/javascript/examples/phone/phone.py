"""A garden for phones: its vocabulary, its weather, and the Python counterpart of the snails."""

from minerva_bus import (
    EMPTY,
    Agent,
    Default,
    Disc,
    EventType,
    Generator,
    Metres,
    Motion,
    Primitive,
    Transformation,
    Vocabulary,
    on,
    view,
)

PShell = Primitive("PShell", Disc("size", "#8a5a44", meaning="snail"), size=Metres)
TAt = Transformation("TAt", Motion("x", "y"), x=Metres, y=Metres)
eRain = EventType("eRain")
eSun = EventType("eSun", heat=Default(float, 0.26))
eTilt = EventType("eTilt", x=float, y=float)
eLettuce = EventType("eLettuce", x=Metres, y=Metres)
ePicture = EventType("ePicture", visual=True)


class Sky(Generator, events=("eRain", "eSun")):
    """Sun in every frame, rain in every second one."""

    def generate(self, tick):
        """The weather of a frame."""
        return [eSun(), eRain()] if tick.number % 2 == 0 else [eSun()]


class Snail(Agent, symbol="ASnail"):
    """A snail crawls, drinks, divides when it is full, and dies when it is dry."""

    x: Metres = 0.0
    y: Metres = 0.0
    water: float = 3.0
    births: int = 0

    @on("eRain")
    def drink(self, rain, moment):
        """Drink, and divide."""
        self.water += moment.chance.random()
        if self.water > 5:
            self.water /= 2
            return self.string + self.child(x=self.x + 0.3, y=self.y, water=self.water)

    @on("eSun")
    def crawl(self, sun, moment):
        """Crawl, dry, and die."""
        self.x += 0.1 * (moment.chance.random() - 0.5)
        self.y += 0.1 * (moment.chance.random() - 0.5)
        self.water -= sun.heat
        if self.water <= 0:
            return EMPTY

    @on("eTilt")
    def slide(self, tilt, moment):
        """Slide down a tilted phone."""
        self.x = max(-3.0, min(3.0, self.x + 0.1 * tilt.x))
        self.y = max(-3.0, min(3.0, self.y + 0.1 * tilt.y))

    @on("eLettuce")
    def smell(self, lettuce, moment):
        """Crawl to a lettuce, and eat."""
        self.x += 0.3 * (lettuce.x - self.x)
        self.y += 0.3 * (lettuce.y - self.y)
        self.water += 0.5

    @view("ePicture")
    def show(self, picture):
        """A shell, the larger the wetter."""
        return TAt(self.x, self.y)(PShell(0.02 + 0.03 * self.water))


vocabulary = Vocabulary.of(PShell, TAt, eRain, eSun, eTilt, eLettuce, ePicture, Snail)
