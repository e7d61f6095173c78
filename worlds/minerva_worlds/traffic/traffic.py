"""A crossing: drivers who miss the red light, speed and honk, and norms against this.

Drivers respond to the light with a probability, receive a horn where an event's condition holds,
and receive the distance to the car ahead from the street. The norms are in traffic.toml.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Any, Literal

import numpy as np

from minerva_bus import (
    Agent,
    Context,
    Degrees,
    Device,
    Disc,
    Event,
    EventType,
    Generator,
    Line,
    Metres,
    MetresPerSecond,
    Motion,
    Primitive,
    Scene,
    Tick,
    Transformation,
    View,
    Vocabulary,
    on,
    portable,
    view,
)
from minerva_bus.grammar.scene import FigureNode

HALF, LINE, SPACE = 60.0, -8.0, 7.0
"""Half the length of a lane; where cars stop before the crossing at 0; spacing of cars. Metres."""

BRAKES, GAS = 6.0, 3.0
MOST_FINED = 1_000_000
LANES = {"east": 0, "north": 90, "west": 180, "south": 270}

# --- the vocabulary -------------------------------------------------------------------------------

Points = tuple[float, ...]
PRoad = Primitive("PRoad", Line("xs", "ys", "#c9ccd1", 9.0), xs=Points, ys=Points)
PMark = Primitive(
    "PMark",
    Line("xs", "ys", "#ffffff", 0.3, dashed=True, meaning="lane marking"),
    xs=Points,
    ys=Points,
)
PBar = Primitive(
    "PBar", Line("xs", "ys", "#ffffff", 0.6, meaning="stop line"), xs=Points, ys=Points
)
PCar = Primitive("PCar", Disc("radius", "#33658a", heading=True), radius=Metres)
PWreck = Primitive(
    "PWreck", Disc("radius", "#b3261e", heading=True, meaning="crashed car"), radius=Metres
)
PGreen = Primitive("PGreen", Disc("radius", "#2e9e4f", meaning="green light"), radius=Metres)
PYellow = Primitive("PYellow", Disc("radius", "#e6b422", meaning="yellow light"), radius=Metres)
PRed = Primitive("PRed", Disc("radius", "#d43a2f", meaning="red light"), radius=Metres)
PBody = Primitive("PBody", who=str, lane=str, s=Metres)
TTurn = Transformation("TTurn", Motion(turn="angle"), angle=Degrees)
TPlace = Transformation("TPlace", Motion("x", "y"), x=Metres, y=Metres)

eStep = EventType("eStep")
eLight = EventType("eLight", x=str, y=str)
eAhead = EventType("eAhead", gap=Metres, speed=MetresPerSecond)
eHonk = EventType("eHonk")
eCrash = EventType("eCrash")
eFine = EventType("eFine", amount=int, norm=str)
eWhere = EventType("eWhere", visual=True)
ePicture = EventType("ePicture", visual=True)

# --- the agents -----------------------------------------------------------------------------------


class Lights(Agent, symbol="ALights"):
    """Green for one road, then for the other; sent to the drivers once per second."""

    x: Literal["green", "yellow", "red"] = "green"
    y: Literal["green", "yellow", "red"] = "red"

    @on("eStep")
    def change(self, step: Event, moment: Context) -> None:
        second = moment.number // 10 % 20
        first = "green" if second % 10 < 6 else "yellow" if second % 10 < 8 else "red"
        self.x, self.y = (first, "red") if second < 10 else ("red", first)
        if moment.number % 10 == 0:
            moment.emit(eLight(self.x, self.y))

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        colors = {"green": PGreen, "yellow": PYellow, "red": PRed}
        x, y = (TPlace(LINE, -6.5)(colors[color](0.9)) for color in (self.x, self.y))
        return x + TTurn(90)(y) + TTurn(180)(x) + TTurn(270)(y)


class Car(Agent, symbol="ACar"):
    """A driver: `care` is the probability of noticing the light, `wish` the preferred speed."""

    lane: Literal["east", "north", "west", "south"]
    axis: Literal["x", "y"]
    s: Metres
    speed: MetresPerSecond = 0.0
    wish: MetresPerSecond = 13.0
    care: float = 0.5
    stop: bool = False
    waited: int = 0
    wrecked: int = 0
    fined: int = 0
    _ahead: Event | None = None

    @on("eLight", probability="care")
    def notice(self, light: Event, moment: Context) -> None:
        self.stop = (light.x if self.axis == "x" else light.y) != "green"

    @on("eHonk", probability=0.3)
    def lose_nerve(self, honk: Event, moment: Context) -> None:
        self.stop = False

    @on("eFine")
    def pay(self, fine: Event, moment: Context) -> None:
        # A person may send any amount.
        self.fined = min(max(0, self.fined + fine.amount), MOST_FINED)
        self.wish = max(10.0, self.wish - 2.0)

    @on("eCrash")
    def crash(self, crash: Event, moment: Context) -> None:
        self.speed, self.wrecked = 0.0, 40

    @on("eAhead")
    def look(self, ahead: Event, moment: Context) -> None:
        self._ahead = ahead

    @on("eStep")
    def drive(self, step: Event, moment: Context) -> None:
        if self.wrecked:
            self.wrecked -= 1
            return
        most = min(self.wish, self.speed + GAS * moment.dt)
        if self._ahead is not None:
            most = min(most, braking(self._ahead.gap - SPACE, self._ahead.speed))
        if self.stop and self.s < LINE:
            most = min(most, braking(LINE - 0.5 - self.s))
        self.speed = max(0.0, self.speed - 1.5 * BRAKES * moment.dt, most)
        self.go(self.speed * moment.dt)
        self.waited = self.waited + 1 if self.speed < 0.5 else 0
        if self.waited % 30 == 29:
            moment.emit(eHonk(condition=f'lane == "{self.lane}" and s > {self.s}'))

    def go(self, way: float) -> None:
        """Move along the lane; continue at its beginning after its end."""
        self.s += way
        if self.s >= HALF:
            self.s -= 2 * HALF

    @view("eWhere", population=True)
    def where(self, event: Event) -> Scene:
        return PBody(self.id, self.lane, self.s)

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        body = PWreck(1.9) if self.wrecked else PCar(1.7)
        return TTurn(LANES[self.lane])(TPlace(self.s, -2.2)(body))


def braking(room: float, least: float = 0.0) -> float:
    """The speed from which a car can brake to `least` within `room` metres."""
    return math.sqrt(max(0.0, least * least + 2 * BRAKES * room))


# --- the street -----------------------------------------------------------------------------------


class Street(
    Generator,
    Device,
    events=("eAhead", "eCrash"),
    draws=("eWhere",),
    coupled=True,
    when="each frame",
):
    """Notifies each car of the distance to the next one, and of crashes."""

    def __init__(self) -> None:
        self.now: dict[str, tuple[str, float]] = {}
        self.before: dict[str, float] = {}
        self.touching: set[tuple[str, str]] = set()
        self.crashes = self.passed = 0

    def show(self, view: View) -> None:
        self.before = {who: s for who, (_, s) in self.now.items()}
        figures = (node for node in view.scene if isinstance(node, FigureNode))
        bodies = [figure.parameters for figure in figures if figure.symbol == PBody.name]
        self.now = {body["who"]: (body["lane"], body["s"]) for body in bodies}
        self.passed += sum(self.before.get(who, s) < 0 <= s for who, (_, s) in self.now.items())

    def generate(self, tick: Tick) -> Iterator[Event]:
        for lane in LANES:
            cars = sorted((s, who) for who, (on, s) in self.now.items() if on == lane)
            for (s, who), (ahead, other) in zip(cars, [*cars[1:], *cars[:1]], strict=True):
                gap = (ahead - s) % (2 * HALF)
                moved = (ahead - self.before.get(other, ahead)) % (2 * HALF)
                if 0 < gap < 30:
                    yield eAhead(gap, moved / tick.dt, receivers=[who])
        before, self.touching = self.touching, set(self.meetings())
        for pair in sorted(self.touching - before):
            self.crashes += 1
            yield eCrash(receivers=pair)

    def meetings(self) -> Iterator[tuple[str, str]]:
        """Pairs of cars on the crossing that touch each other."""
        inside = [name for name, (_, s) in sorted(self.now.items()) if abs(s) < -LINE]
        for who, other in combinations(inside, 2):
            if portable.dist(place(*self.now[who]), place(*self.now[other])) < 3.0:
                yield who, other

    def save(self) -> Mapping[str, Any]:
        return {
            "now": {who: list(name) for who, name in self.now.items()},
            "before": self.before,
            "touching": sorted(map(list, self.touching)),
            "crashes": self.crashes,
            "passed": self.passed,
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        self.now = {who: (lane, s) for who, (lane, s) in saved["now"].items()}
        self.touching = {(first, second) for first, second in saved["touching"]}
        self.before = dict(saved["before"])
        self.crashes, self.passed = saved["crashes"], saved["passed"]

    def report(self) -> Mapping[str, int]:
        return {"crashes": self.crashes, "passed": self.passed}


def place(lane: str, s: float) -> tuple[float, float]:
    """Position of a car in the plane, in metres."""
    turn = math.radians(LANES[lane])
    return (
        s * portable.cos(turn) + 2.2 * portable.sin(turn),
        s * portable.sin(turn) - 2.2 * portable.cos(turn),
    )


# --- the world ------------------------------------------------------------------------------------

vocabulary = Vocabulary.of(
    *(PRoad, PMark, PBar, PCar, PWreck, PGreen, PYellow, PRed, PBody, TTurn, TPlace),
    *(eStep, eLight, eAhead, eHonk, eCrash, eFine, eWhere, ePicture, Lights, Car),
)


def scene(options: Mapping[str, Any]) -> Scene:
    """Two roads, the lights, and the cars, spread over the four lanes."""
    road, mark = PRoad((-HALF, HALF), (0, 0)), PMark((-HALF, HALF), (0, 0))
    roads = road + TTurn(90)(road) + mark + TTurn(90)(mark)
    bar = PBar((LINE, LINE), (-3.9, -0.6))
    bars = bar + TTurn(90)(bar) + TTurn(180)(bar) + TTurn(270)(bar)
    chance, count = np.random.default_rng(7), options["cars"]
    cars = [
        Car(
            f"c{number}",
            lane=list(LANES)[number % 4],
            axis="xy"[number % 2],
            s=number // 4 * (2 * HALF / math.ceil(count / 4)) - HALF + 5,
            wish=round(chance.uniform(10, 18), 1),
            care=round(chance.uniform(0.3, 0.9), 2),
        ).string
        for number in range(count)
    ]
    return sum(cars, roads + bars + Lights("lights").string)
