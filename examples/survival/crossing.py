"""Two roads that cross: drivers who learn, and norms that bind them (extensions/learning/rl.md)."""

from collections.abc import Iterator
from itertools import combinations
from typing import Annotated, Literal

import numpy as np

from minerva_bus import (
    Agent,
    Degrees,
    Device,
    Disc,
    EventType,
    Generator,
    Metres,
    MetresPerSecond,
    Motion,
    Primitive,
    Range,
    Transformation,
    World,
    each,
    on,
    view,
)
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import FigureNode

LENGTH, LINE, SPACE, SIZE = 100.0, -6.0, 6.0, 3.0
"""Length of each road, which is a ring; place of the stop line, 6 m before the crossing at 0; least
distance of two cars by the norm, and that at which they touch. Metres."""

TOP, LIMIT, FINE = 16.0, 12.5, 1.0
"""Greatest speed, speed limit (m/s), and the fine for each frame above it (m)."""

DAMAGE, REPAIR = 20.0, 20
"""Of a crash: metres that it costs, and frames in which the car stands still."""

PCar = Primitive("PCar", Disc("radius", "#33658a", heading=True), radius=Metres)
PBody = Primitive("PBody", who=str, road=str, s=Metres, speed=MetresPerSecond)
TPlace = Transformation("TPlace", Motion("x", "y", "angle"), x=Metres, y=Metres, angle=Degrees)
eStep = EventType("eStep")
ePedal = EventType("ePedal", push=Annotated[float, Range(-4, 4)])  # of the policy, in m/s²
eLight = EventType("eLight", road=str)
eAhead = EventType("eAhead", gap=Metres, lead=MetresPerSecond)
eCrash = EventType("eCrash")
eFine = EventType("eFine", amount=Metres)
eWhere = EventType("eWhere", visual=True)
ePicture = EventType("ePicture", visual=True)


class Lights(Agent, symbol="ALights"):
    """Green for road x, then for road y, for 8 of 10 seconds each."""

    green: Literal["x", "y", "none"] = "x"

    @on("eStep")
    def change(self, step, moment):
        second = moment.number // 10 % 20
        self.green = "none" if second % 10 >= 8 else "x" if second < 10 else "y"
        moment.emit(eLight(self.green))


class Car(Agent, symbol="ACar", rest=("speed",)):
    """A car whose driver sees the light and the car ahead; `earned` is the sum of rewards."""

    road: Literal["x", "y"]
    s: Metres
    speed: MetresPerSecond = 0.0
    push: float = 0.0
    gap: Metres = LENGTH
    lead: MetresPerSecond = 0.0
    green: bool = True
    broken: int = 0
    earned: Metres = 0.0
    fines: int = 0
    crashes: int = 0

    @on("eFine", population=True)
    def pay(self, fine, moment):
        self.earned -= fine.amount
        self.fines += 1

    @on("eCrash", population=True)
    def crash(self, crash, moment):
        self.speed, self.broken = 0.0, REPAIR
        self.earned -= DAMAGE
        self.crashes += 1

    @on("eLight", population=True)
    def notice(self, light, moment):
        self.green = self.road == light.road

    @on("eAhead", population=True)
    def look(self, ahead, moment):
        self.gap, self.lead = ahead.gap, ahead.lead

    @on("ePedal", population=True)
    def press(self, pedal, moment):
        self.push = pedal.push

    @on("eStep", population=True)
    def drive(self, step, moment):
        drives = self.broken == 0
        self.broken -= ~drives
        self.speed = drives * np.clip(self.speed + self.push * moment.dt, 0.0, TOP)
        moved = self.speed * moment.dt
        s = self.s + moved
        self.s = np.where(s >= LENGTH / 2, s - LENGTH, s)
        self.gap -= moved
        self.earned += moved

    @view("eWhere", population=True)
    def where(self, event):
        return PBody(self.id, self.road, self.s, self.speed)

    @view("ePicture", population=True)
    def picture(self, event):
        across = self.road == "y"
        x, y = np.where(across, 2.0, self.s), np.where(across, self.s, -2.0)
        return TPlace(x, y, 90.0 * across)(PCar(1.7))


class Street(
    Generator,
    Device,
    events=("eAhead", "eCrash"),
    draws=("eWhere",),
    coupled=True,
    when="each frame",
):
    """Notifies each car of the next one, and of crashes on the crossing."""

    def __init__(self):
        self.bodies = []
        self.touching = set()
        self.crashes = 0

    def show(self, view):
        figures = (node.parameters for node in view.scene if isinstance(node, FigureNode))
        self.bodies = sorted((body["road"], body["s"], body["who"], body["speed"])
                             for body in figures)  # fmt: skip

    def generate(self, tick) -> Iterator:
        for road in "xy":
            cars = [body for body in self.bodies if body[0] == road]
            if cars:
                _, s, who, speed = map(np.array, zip(*cars, strict=True))
                gap = np.where(len(cars) > 1, (np.roll(s, -1) - s) % LENGTH, LENGTH)
                yield eAhead(gap, np.roll(speed, -1), receivers=Ids.of(who.tolist()))
        before, self.touching = self.touching, set(self.meetings())
        for pair in sorted(self.touching - before):
            self.crashes += 1
            yield eCrash(receivers=pair)

    def meetings(self):
        """Pairs of cars that touch each other, on one road or on the crossing."""
        for (road, s, who, _), (other_road, other_s, other, _) in combinations(self.bodies, 2):
            if road == other_road:
                near = abs((other_s - s + LENGTH / 2) % LENGTH - LENGTH / 2) < SIZE
            else:
                near = max(abs(s), abs(other_s)) < SIZE
            if near:
                yield who, other

    def save(self):
        return {"bodies": [list(body) for body in self.bodies], "crashes": self.crashes,
                "touching": sorted(map(list, self.touching))}  # fmt: skip

    def restore(self, saved):
        self.bodies = [tuple(body) for body in saved["bodies"]]
        self.touching, self.crashes = set(map(tuple, saved["touching"])), saved["crashes"]

    def report(self):
        return {"crashes": self.crashes}


def cars(options):
    """The lights, and cars at equal distances on both roads, all at rest."""
    count = options["cars"]
    place = (np.arange(count) // 2 + 0.5) / ((count + 1) // 2)
    road = np.array(["x", "y"])[np.arange(count) % 2]
    return Car.many("c", count, road=road, s=LENGTH * (place - 0.5)) + Lights("lights").string


NORMS = {
    "red_light": {
        "applies": "ACar",
        "when": f"was.s < {LINE} and s >= {LINE} and (road == 'x' and #lights.green != 'x'"
        " or road == 'y' and #lights.green != 'y')",
    },
    "distance": {"applies": "ACar", "when": f"gap < {SPACE} and speed > 0"},
    "speed_limit": {
        "applies": "ACar", "when": f"speed > {LIMIT}",
        "then": "sanction", "event": "eFine", "data": {"amount": FINE},
    },
}  # fmt: skip

world = World(
    cars,
    agents=[Car, Lights],
    services=[Street, each(eStep)],
    symbols=[ePedal, eFine, eCrash, PCar, PBody, TPlace, eWhere, ePicture],
    options={"cars": 12, "norms": True},
    norms={
        name: {**norm, "when": norm["when"].replace("'", '"'), "in_force": "${norms}"}
        for name, norm in NORMS.items()
    },
    order=[eCrash, eFine, eLight, eAhead, ePedal, eStep],
    name="crossing",
)
