"""A meadow: rabbits graze and warn each other, foxes hunt; all are born and die.

No animal sees another. It makes a noise: an event whose condition limits the area of reception.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from minerva_bus import (
    EMPTY,
    Agent,
    Cells,
    Context,
    Default,
    Degrees,
    Disc,
    Event,
    EventType,
    Generator,
    Line,
    Metres,
    Motion,
    Primitive,
    Raster,
    Scene,
    Tick,
    Transformation,
    Vocabulary,
    on,
    portable,
    view,
)

WIDTH, HEIGHT, CELL = 24.0, 15.0, 0.5
MOST_ENERGY = 60.0  # of an animal
GREENS = ("#ddd6a3", "#cdd295", "#bccc88", "#abc57c", "#9bbd71", "#8cb468", "#7faa60", "#749f59")

# --- the vocabulary: primitives, a transformation, event types ------------------------------------

PGrass = Primitive("PGrass", Raster("cells", CELL, colors=tuple(enumerate(GREENS))), cells=Cells)
PGrey = Primitive("PGrey", Disc("radius", "#7d6b5d", meaning="rabbit"), radius=Metres)
PRed = Primitive("PRed", Disc("radius", "#d4622a", meaning="fox"), radius=Metres)
PWhite = Primitive(
    "PWhite", Disc("radius", "#fdf8ee", meaning="tail, or fear around a rabbit"), radius=Metres
)
PGreen = Primitive("PGreen", Disc("radius", "#4f8049", meaning="bush"), radius=Metres)
PLight = Primitive("PLight", Disc("radius", "#6c9c5b", meaning="top of a bush"), radius=Metres)
PYellow = Primitive("PYellow", Disc("radius", "#efc94c", meaning="flower"), radius=Metres)
PEars = Primitive(
    "PEars", Line("xs", "ys", "#a39080", 0.1), xs=tuple[float, ...], ys=tuple[float, ...]
)
TPlace = Transformation(
    "TPlace", Motion("x", "y", "angle"), x=Metres, y=Default(Metres, 0), angle=Default(Degrees, 0)
)

eStep = EventType("eStep")
eRain = EventType("eRain", amount=float)
eGraze = EventType("eGraze", x=Metres, y=Metres)
eGrass = EventType("eGrass", amount=float)
eRustle = EventType("eRustle", x=Metres, y=Metres)
eProwl = EventType("eProwl", x=Metres, y=Metres)
eAlarm = EventType("eAlarm", x=Metres, y=Metres)
eHowl = EventType("eHowl", x=Metres, y=Metres)
eBite = EventType("eBite")
eMeal = EventType("eMeal", amount=float)
ePicture = EventType("ePicture", visual=True)

EARS = PEars(xs=(-0.26, 0.05, -0.26), ys=(0.12, 0.0, -0.12))
RABBIT = TPlace(-0.28)(PWhite(0.1)) + PGrey(0.26) + TPlace(0.27)(PGrey(0.17) + EARS)
FOX = (
    TPlace(-0.8)(PWhite(0.13))
    + TPlace(-0.57)(PRed(0.19))
    + PRed(0.36)
    + TPlace(0.4, 0.2)(PRed(0.12))
    + TPlace(0.4, -0.2)(PRed(0.12))
    + TPlace(0.46)(PRed(0.25) + TPlace(0.22)(PWhite(0.11)))
)

# --- the agents -----------------------------------------------------------------------------------


class Meadow(Agent, symbol="AMeadow"):
    """The ground: height of the grass in each cell, from 0 to 7."""

    grass: Cells = np.full((int(WIDTH / CELL), int(HEIGHT / CELL)), 2, np.int16)

    @on("eRain")
    def grow(self, rain: Event, moment: Context) -> None:
        grass = self.writable("grass")
        grass += moment.random.random(grass.shape) < rain.amount
        grass.clip(max=7, out=grass)

    @on("eGraze")
    def feed(self, graze: Event, moment: Context) -> None:
        grass, cell = self.writable("grass"), (int(graze.x / CELL), int(graze.y / CELL))
        if not (0 <= cell[0] < grass.shape[0] and 0 <= cell[1] < grass.shape[1]):
            return  # A person has sent it.
        amount = min(grass[cell], 3)
        grass[cell] -= amount
        if graze.sender:
            moment.emit(eGrass(amount, receivers=[graze.sender]))

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        return PGrass(self.grass)


class Animal(Agent):
    """Common state and behaviour of rabbits and foxes."""

    x: Metres
    y: Metres
    heading: Degrees = 0.0
    energy: float = 12.0
    births: int = 0

    def go(self, distance: float) -> None:
        x = self.x + distance * portable.cos(math.radians(self.heading))
        y = self.y + distance * portable.sin(math.radians(self.heading))
        if 0 <= x < WIDTH and 0 <= y < HEIGHT:
            self.x, self.y = x, y
        else:
            self.heading = self.bearing(WIDTH / 2, HEIGHT / 2)

    def bearing(self, x: float, y: float) -> float:
        return math.degrees(portable.atan2(y - self.y, x - self.x))

    def distance(self, noise: Event) -> float:
        return portable.hypot(noise.x - self.x, noise.y - self.y)

    def nearby(self, reach: float) -> str:
        """Condition of a noise that is received within `reach` metres along each axis."""
        return (
            f"x > {self.x - reach} and x < {self.x + reach}"
            f" and y > {self.y - reach} and y < {self.y + reach}"
        )

    def eat(self, food: Event) -> None:
        """Take energy from an `eGrass` or `eMeal`; a person may send any amount."""
        self.energy = min(max(0.0, self.energy + food.amount), MOST_ENERGY)

    def breed(self) -> Scene:
        self.energy /= 2
        young = self.child(x=self.x, y=self.y, heading=self.heading + 180, energy=self.energy)
        return self.string + young


class Rabbit(Animal, symbol="ARabbit"):
    """Hops and grazes; warns the others of a fox nearby, and keeps still."""

    fear: int = 0

    @on("eBite")
    def die(self, bite: Event, moment: Context) -> Scene:
        if bite.sender:  # Otherwise a person has sent it.
            moment.emit(eMeal(8.0, receivers=[bite.sender]))
        return EMPTY

    @on("eGrass")
    def graze(self, grass: Event, moment: Context) -> None:
        self.eat(grass)

    @on("eProwl")
    def warn(self, prowl: Event, moment: Context) -> None:
        if not self.fear:
            moment.emit(eAlarm(self.x, self.y, condition=self.nearby(5.0)))
        self.duck(prowl, moment)

    @on("eAlarm")
    def duck(self, noise: Event, moment: Context) -> None:
        self.fear = 10

    @on("eStep")
    def hop(self, step: Event, moment: Context) -> Scene | None:
        self.energy -= 0.06
        if self.energy <= 0:
            return EMPTY
        if self.fear:
            self.fear -= 1
        elif moment.random.random() < 0.15:
            self.heading += moment.chance.normal(0, 40)
            self.go(0.4)
            moment.emit(eGraze(self.x, self.y))
            moment.emit(eRustle(self.x, self.y, condition=self.nearby(2.5)))
        return self.breed() if self.energy > 16 else None

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        halo = PWhite(0.45) if self.fear else EMPTY
        return TPlace(self.x, self.y, self.heading)(halo + RABBIT)


class Fox(Animal, symbol="AFox"):
    """Stalks the nearest rabbit that makes a noise; does not breed with another fox nearby."""

    company: int = 0
    _prey: Event | None = None  # not state, because of the underscore: lasts for one frame

    @on("eMeal")
    def devour(self, meal: Event, moment: Context) -> None:
        self.eat(meal)

    @on("eHowl")
    def give_way(self, howl: Event, moment: Context) -> None:
        if howl.sender != self.id:
            self.company = 80
            self.heading = self.bearing(howl.x, howl.y) + 180

    @on("eRustle")
    def listen(self, rustle: Event, moment: Context) -> None:
        if self._prey is None or self.distance(rustle) < self.distance(self._prey):
            self._prey = rustle

    @on("eStep")
    def prowl(self, step: Event, moment: Context) -> Scene | None:
        self.energy *= 0.994
        if self.energy < 1:
            return EMPTY
        if self._prey and self.energy < 20:
            self.hunt(self._prey, moment)
        else:
            self.heading += moment.chance.normal(0, 15)
            self.go(0.15)
        if moment.random.random() < 0.05:
            moment.emit(eHowl(self.x, self.y, condition=self.nearby(10.0)))
        self.company = max(0, self.company - 1)
        return self.breed() if self.energy > 20 and not self.company else None

    def hunt(self, prey: Event, moment: Context) -> None:
        self.heading = self.bearing(prey.x, prey.y)
        self.go(min(0.35, self.distance(prey)))
        moment.emit(eProwl(self.x, self.y, condition=self.nearby(3.0)))
        if prey.sender and self.distance(prey) < 0.4:
            moment.emit(eBite(receivers=[prey.sender]))

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        return TPlace(self.x, self.y, self.heading)(FOX)


# --- the weather ----------------------------------------------------------------------------------


class Weather(Generator, events=("eRain",)):
    """It rains more in summer than in winter; people may order rain.

    Args:
        year: frames from one spring to the next.
        amount: fraction of the meadow that grows in a shower.

    """

    def __init__(self, year: int = 1000, amount: float = 0.01) -> None:
        self.year = year
        self.amount = amount

    def takes_orders(self) -> tuple[str, ...]:
        return self.events

    def generate(self, tick: Tick) -> Iterator[Event]:
        yield from tick.orders
        warmth = portable.sin(2 * math.pi * tick.number / self.year)
        if tick.random.random() < 0.3 + 0.2 * warmth:
            yield eRain(self.amount)


vocabulary = Vocabulary.of(
    *(PGrass, PGrey, PRed, PWhite, PGreen, PLight, PYellow, PEars, TPlace),
    *(eStep, eRain, eGraze, eGrass, eRustle, eProwl, eAlarm, eHowl, eBite, eMeal, ePicture),
    *(Meadow, Rabbit, Fox),
)
