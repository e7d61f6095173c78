"""A small world for windows: vocabulary, picture, and an operator that records commands."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from minerva_bus import (
    Agent,
    Default,
    Disc,
    EventType,
    Label,
    Metres,
    MetresPerSecond,
    Motion,
    Primitive,
    Transformation,
    Vocabulary,
)
from minerva_bus.errors import BusError
from minerva_bus.world.operator import MemberStatus, WorldStatus
from minerva_services.geometry.picture import Discs, Picture

PBug = Primitive("PBug", Disc(0.5, "#ff8000", heading=True), name=str)
PSign = Primitive("PSign", Label("words"), words=str)
TPut = Transformation("TPut", Motion("x", "y"), x=Metres, y=Metres)
eGo = EventType("eGo", place=str)
eBring = EventType("eBring", source=str, target=str)
eHaste = EventType("eHaste", speed=MetresPerSecond)
eTurn = EventType("eTurn", angle=Default(float, 2.0))
eRain = EventType("eRain")


class Bug(Agent, symbol="ABug"):
    speed: MetresPerSecond = 0.5


WORDS = Vocabulary.of(PBug, PSign, TPut, eGo, eBring, eHaste, eTurn, eRain, Bug)


def discs(*places, owners=None, names=None, radius=0.5, heading=True, height=0.3):
    n = len(places)
    x, y = (np.array([place[at] for place in places], np.float64) for at in (0, 1))
    return Discs(
        x, y, np.zeros(n), np.full(n, radius), np.full(n, height),
        np.tile(np.array([255, 128, 0], np.uint8), (n, 1)), np.full(n, heading, np.bool_),
        names or [""] * n, owners or [f"b{at + 1}" for at in range(n)],
    )  # fmt: skip


BUGS = Picture((discs((0.0, 0.0), (3.0, 0.0)),))


def flat(x, y, height):
    """A projection: ten pixels for a metre, y down, the origin at (100, 100)."""
    return 100 + 10 * x, 100 - 10 * y, np.full(len(x), 10.0)


def status(*orders, paused=False, **more):
    members = (MemberStatus("people", "present", orders=orders),)
    return WorldStatus("pond", 7, 0.1, "idle", paused=paused, members=members, **more)


class Ledger:
    """An operator that records the commands it receives."""

    def __init__(self, speed=0.5, error=""):
        self.told = []
        self.speed = speed
        self.error = error
        self.asked = 0
        self.fates = []

    def status(self, since=0):
        self.asked += 1
        if self.error:
            raise BusError(self.error)
        return status("eGo", "eHaste")

    def named(self, by):
        return self

    def orders(self, since=0):
        return [order for order in self.fates if order.change > since]

    def fragment(self, agent):
        return f"ABug#{agent}<speed={self.speed}>"

    def __getattr__(self, name):
        def note(*details):
            if self.error:
                raise BusError(self.error)
            self.told.append(" ".join([name, *map(str, details)]))

        return note


def shown_by(deed, **more):
    """The commands that an operator receives from an action."""
    ledger = Ledger(**more)
    said = deed.do(ledger)
    return SimpleNamespace(said=said, told=ledger.told)
