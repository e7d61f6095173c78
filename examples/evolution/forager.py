"""Creatures whose eyes drive their wheels, after Braitenberg's Vehicles (1984), among berries.

What they are stands in the scope of the egg that they come of: `TAim<angle=40>(PEye<left=1>)` is an
eye that looks 40° to the left and lets the left wheel turn the faster, the more berries it sees. So
a mutation of the string makes other creatures: with an eye more or less, elsewhere, or wired in
another way.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from minerva_bus import (
    EMPTY,
    Agent,
    Context,
    Default,
    Degrees,
    Device,
    Disc,
    Event,
    EventType,
    Generator,
    Line,
    Metres,
    Motion,
    Primitive,
    Scene,
    Tick,
    Transformation,
    View,
    Vocabulary,
    WorldInfo,
    interpret,
    on,
    portable,
    view,
)
from minerva_bus.grammar.scene import walk
from minerva_bus.semantics.plane import PlaneGeometry, Pose
from minerva_bus.study.outcome import Outcome

WIDTH, HEIGHT, BROOD = 24.0, 15.0, 6
FASTEST = 0.4  # metres in a frame
SHARPEST = 30.0  # degrees in a frame
REACH = 0.7  # metres to what it can eat
SIGHT = portable.cos(math.radians(35))  # an eye sees 35° to either side of where it looks

# --- the words ------------------------------------------------------------------------------------

Corners = tuple[float, ...]
PGround = Primitive("PGround", Line("xs", "ys", "#c9c2a5", 0.12), xs=Corners, ys=Corners)
PBody = Primitive("PBody", Disc(0.45, "#2f6f8f", heading=True), who=str)
PBerry = Primitive("PBerry", Disc(0.22, "#b3205f"), who=str)
PEye = Primitive("PEye", Disc(0.12, "#efc94c"), left=Default(float, 0.0), right=Default(float, 0.0))
TPlace = Transformation(
    "TPlace", Motion("x", "y", "angle"), x=Metres, y=Metres, angle=Default(Degrees, 0.0)
)
TAim = Transformation("TAim", Motion(turn="angle", forward=0.4), angle=Degrees)

eLook = EventType("eLook", visual=True)
ePicture = EventType("ePicture", visual=True)
eHatch = EventType("eHatch")
eSeen = EventType("eSeen", light=tuple[float, ...])
eEaten = EventType("eEaten", by=str)
eMeal = EventType("eMeal")

# --- the agents -----------------------------------------------------------------------------------


class Egg(Agent, symbol="AEgg"):
    """Six creatures hatch of it, here and there, all with the body that it holds."""

    speed: float = 0.15
    births: int = 0

    @on("eHatch")
    def hatch(self, spring: Event, moment: Context) -> Scene:
        young = EMPTY
        for n in range(BROOD):
            x, y = WIDTH * (n % 3 + 0.5) / 3, HEIGHT * (n // 3 + 0.5) / 2
            young += self.child(
                Creature, x=x, y=y, heading=67.0 * n, speed=self.speed, scope=self.scope
            )
        return young


class Creature(Agent, symbol="ACreature"):
    """Goes as its eyes and wheels let it, and counts what it eats."""

    x: Metres
    y: Metres
    heading: Degrees
    speed: float  # of either wheel in the dark
    eaten: int = 0

    @on("eSeen")
    def drive(self, seen: Event, moment: Context) -> None:
        left = right = self.speed
        for eye, light in zip(eyes(self.scope), seen.light, strict=False):
            left += eye["left"] * light
            right += eye["right"] * light
        turn = math.degrees(right - left)
        self.heading = (self.heading + max(-SHARPEST, min(SHARPEST, turn))) % 360
        way = max(0.0, min(FASTEST, (left + right) / 2))
        self.x = (self.x + way * portable.cos(math.radians(self.heading))) % WIDTH
        self.y = (self.y + way * portable.sin(math.radians(self.heading))) % HEIGHT

    @on("eMeal")
    def digest(self, meal: Event, moment: Context) -> None:
        self.eaten += 1

    @view("eLook", "ePicture")
    def picture(self, event: Event) -> Scene:
        return TPlace(self.x, self.y, self.heading)(PBody(self.id), self.scope)


class Berry(Agent, symbol="ABerry"):
    """Stands there until it is eaten."""

    x: Metres
    y: Metres

    @on("eEaten")
    def vanish(self, eaten: Event, moment: Context) -> Scene:
        moment.emit(eMeal(receivers=[eaten.by]))
        return EMPTY

    @view("eLook", "ePicture")
    def picture(self, event: Event) -> Scene:
        return TPlace(self.x, self.y)(PBerry(self.id))


def eyes(body: Scene) -> list[dict[str, float]]:
    """The eyes of a creature, as they stand in its scope from left to right."""
    return [dict(node.parameters) for opens, node in walk(body) if opens and node.symbol == "PEye"]


# --- what they see and eat ------------------------------------------------------------------------

MADE = ("eHatch", "eSeen", "eEaten")


class Sight(PlaneGeometry):
    """A geometric system in which a view is a list of who is where and looks whither."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.berries: dict[str, Pose] = {}
        self.creatures: dict[str, tuple[Pose, list[Pose]]] = {}
        self._eyes: list[Pose] = []

    def PBerry(self, who: str) -> None:
        self.berries[who] = self.pose

    def PBody(self, who: str) -> None:
        self._eyes = []
        self.creatures[who] = self.pose, self._eyes

    def PEye(self, left: float, right: float) -> None:
        self._eyes.append(self.pose)


class Light(
    Device, Generator, coupled=True, draws=("eLook",), events=("eHatch", "eSeen", "eEaten")
):
    """Tells each creature how much light each eye gets, and what it has come to eat."""

    every = 1

    def __init__(self) -> None:
        self._sight: Sight | None = None

    def joined(self, world: WorldInfo) -> None:
        self._vocabulary = world.vocabulary

    def show(self, view: View) -> None:
        self._sight = Sight(self._vocabulary)
        interpret(view.scene, self._sight)

    def generate(self, tick: Tick) -> Iterator[Event]:
        if self._sight is None:
            yield eHatch()
            return
        berries = self._sight.berries
        for who, (pose, looking) in sorted(self._sight.creatures.items()):
            for name in berries:
                if distance(pose, berries[name]) < REACH:
                    yield eEaten(by=who, receivers=[name])
            light = tuple([brightness(eye, berries.values()) for eye in looking])
            yield eSeen(light=light, receivers=[who])


def brightness(eye: Pose, berries: Iterable[Pose]) -> float:
    """How much light an eye gets from berries that it looks at: less with distance squared."""
    ahead_x, ahead_y = portable.cos(math.radians(eye.angle)), portable.sin(math.radians(eye.angle))
    light = 0.0
    for berry in berries:
        dx, dy = berry.x - eye.x, berry.y - eye.y
        far = portable.hypot(dx, dy)
        if dx * ahead_x + dy * ahead_y > SIGHT * far:
            light += 1 / (1 + far * far)
    return light


def distance(first: Pose, second: Pose) -> float:
    """Metres between two places."""
    return portable.hypot(second.x - first.x, second.y - first.y)


# --- the world, and what is good in it ------------------------------------------------------------

vocabulary = Vocabulary.of(
    *(PGround, PBody, PBerry, PEye, TPlace, TAim, eLook, ePicture, eHatch, eSeen, eEaten, eMeal),
    *(Egg, Creature, Berry),
)


def berries(outcome: Outcome) -> float:
    """The berries that are eaten; that a body has an eye more costs one of them."""
    brood = [node for node in outcome.scene if node.symbol == "ACreature"]
    return sum(agent.state["eaten"] for agent in brood) - len(eyes(brood[0].scope))
