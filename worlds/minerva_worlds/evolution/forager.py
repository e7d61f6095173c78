"""Creatures among berries whose eyes drive their wheels, after Braitenberg (1984).

Their body is the scope of the egg from which they hatch: `TAim<angle=40>(PEye<left=1>)` is an eye
that looks 40° to the left and makes the left wheel turn faster the more berries it sees. A mutation
of the string therefore creates other creatures, with more or fewer eyes, or with other positions or
wiring.
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
from minerva_bus.grammar.scene import FigureNode, agents, walk
from minerva_bus.semantics.plane import PlaneGeometry, Pose
from minerva_study.outcome import Outcome

WIDTH, HEIGHT, BROOD = 24.0, 15.0, 6
MAX_SPEED = 0.4  # metres per frame
MAX_TURN = 30.0  # degrees per frame
REACH = 0.7  # metres within which a creature can eat
SIGHT = portable.cos(math.radians(35))  # an eye sees 35° to either side of its direction

# --- the vocabulary -------------------------------------------------------------------------------

Corners = tuple[float, ...]
PGround = Primitive(
    "PGround",
    Line("xs", "ys", "#c9c2a5", 0.12, meaning="edge of the ground"),
    xs=Corners,
    ys=Corners,
)
PBody = Primitive("PBody", Disc(0.45, "#2f6f8f", heading=True, meaning="forager"), who=str)
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
    """Six creatures hatch from it at different positions, all with the body in its scope."""

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
    """Drives with its eyes and wheels; counts the berries that it eats."""

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
        self.heading = (self.heading + max(-MAX_TURN, min(MAX_TURN, turn))) % 360
        way = max(0.0, min(MAX_SPEED, (left + right) / 2))
        self.x = (self.x + way * portable.cos(math.radians(self.heading))) % WIDTH
        self.y = (self.y + way * portable.sin(math.radians(self.heading))) % HEIGHT

    @on("eMeal")
    def digest(self, meal: Event, moment: Context) -> None:
        self.eaten += 1

    @view("eLook", "ePicture")
    def picture(self, event: Event) -> Scene:
        return TPlace(self.x, self.y, self.heading)(PBody(self.id), self.scope)


class Berry(Agent, symbol="ABerry"):
    """Stays in place until it is eaten."""

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
    """The parameters of a creature's eyes, in the order of its scope."""
    return [
        dict(node.parameters)
        for _, node in walk(body)
        if isinstance(node, FigureNode) and node.symbol == "PEye"
    ]


# --- light and food -------------------------------------------------------------------------------


class Sight(PlaneGeometry):
    """A geometric system in which a view is a list of positions and viewing directions."""

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
    Device, Generator, coupled=True, draws=("eLook",), events=("eHatch", "eSeen", "eEaten"),
    when="each frame",
):  # fmt: skip
    """Notifies creatures of the light that their eyes receive, and berries that they are eaten."""

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
    """The light that an eye receives from visible berries; decreases with distance squared."""
    ahead_x, ahead_y = portable.cos(math.radians(eye.angle)), portable.sin(math.radians(eye.angle))
    light = 0.0
    for berry in berries:
        dx, dy = berry.x - eye.x, berry.y - eye.y
        far = portable.hypot(dx, dy)
        if dx * ahead_x + dy * ahead_y > SIGHT * far:
            light += 1 / (1 + far * far)
    return light


def distance(first: Pose, second: Pose) -> float:
    """Distance in metres."""
    return portable.hypot(second.x - first.x, second.y - first.y)


# --- the world and the fitness --------------------------------------------------------------------

vocabulary = Vocabulary.of(
    *(PGround, PBody, PBerry, PEye, TPlace, TAim, eLook, ePicture, eHatch, eSeen, eEaten, eMeal),
    *(Egg, Creature, Berry),
)


def berries(outcome: Outcome) -> float:
    """Number of berries eaten, minus one per eye of a body."""
    brood = [agent for agent in agents(outcome.scene) if agent.symbol == "ACreature"]
    return sum(agent.state["eaten"] for agent in brood) - len(eyes(brood[0].scope))
