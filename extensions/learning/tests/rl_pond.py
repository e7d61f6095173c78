"""A small world with births, deaths and actions of all types, in a module for other processes."""

from typing import Annotated, Literal

from minerva_bus import (
    EMPTY,
    Agent,
    Degrees,
    EventType,
    Primitive,
    Range,
    Transformation,
    World,
    each,
    on,
    view,
)
from minerva_learning import follow_policy

PFin = Primitive("PFin", size=float, angles=tuple[float, ...], name=str)
TAt = Transformation("TAt", x=float)
eTick = EventType("eTick")
eSwim = EventType("eSwim", way=Annotated[float, Range(-1, 1)], turn=Degrees)
eEat = EventType("eEat")
eMix = EventType("eMix", far=bool, times=Annotated[int, Range(1, 3)], note=str)
ePick = EventType(
    "ePick", color=Literal["red", "green", "blue"], times=Annotated[int, Range(1, 3)], far=bool
)
eSee = EventType("eSee", visual=True)


class Fish(Agent, symbol="AFish"):
    x: float = 0.0
    food: float = 3.0
    color: Literal["red", "green", "blue"] = "red"
    big: bool = False
    tail: tuple[float, ...] = (0.5, 1.5)
    births: int = 0

    @on("eSwim")
    def swim(self, swim, moment):
        self.x += swim.way

    @on("eEat")
    def eat(self, event, moment):
        self.food += 5.0

    @on("ePick")
    def pick(self, pick, moment):
        self.color, self.big = pick.color, pick.far

    @on("eMix")
    def mix(self, event, moment):
        pass

    @on("eTick")
    def live(self, tick, moment):
        self.food -= 1.0
        self.x += moment.random.normal() * 0.01
        if self.food <= 0:
            return EMPTY
        if self.food > 6:
            self.food = 2.0
            return self.string + self.child(x=self.x, food=2.0)
        return None

    @view("eSee")
    def see(self, event):
        return TAt(self.x)(PFin(self.food, self.tail, self.id))


def shy(observation):
    """A policy: away from 0 with less food."""
    x, food = observation
    return [-0.5 if x > 2 else 0.25 * food / (1 + food), 1.0]


class ShyFish(Fish):
    """A fish that follows a policy."""

    follow = follow_policy(shy, when="eTick", act=eSwim, observe=["x", "food"])


ALL_FISH = "AFish#a · AFish#b<x=2> · AFish#c<x=3, food=1>"


def pond_of(fish, string=ALL_FISH):
    """A pond whose fish are of a class."""
    return World(
        string,
        agents=[fish],
        services=[each(eTick)],
        symbols=[eSwim, eEat, eMix, ePick, eSee, PFin, TAt],
        order=[eSwim, eEat, ePick, eTick],
        name="rl_pond",
    )


pond = pond_of(Fish)
