"""A small world, and a server whose messages are counted, for tests of the page."""

import socket
from contextlib import contextmanager

import numpy as np

from minerva_bus import (
    Agent,
    Disc,
    EventType,
    Label,
    Line,
    Metres,
    MetresPerSecond,
    Motion,
    Primitive,
    Raster,
    Transformation,
    Vocabulary,
    WorldInfo,
    on,
    view,
)
from minerva_bus.errors import BusError
from minerva_bus.grammar.scene import AgentNode, Scene
from minerva_bus.grammar.types import Cells
from minerva_bus.world.operator import MemberStatus, WorldStatus
from minerva_services.geometry.picture import Lists

PFloor = Primitive(
    "PFloor", Raster("cells", 0.5, colors=((0, "#ffffff"), (1, "#222222")), height=1.0), cells=Cells
)
PMemory = Primitive(
    "PMemory", Raster("cells", 0.5, colors=((0, ""), (1, "#0000ff")), opacity=0.5), cells=Cells
)
PCart = Primitive("PCart", Disc(0.2, "#ff8000", heading=True))
PStone = Primitive("PStone", Disc("radius", height=0.5), radius=Metres)
PWay = Primitive("PWay", Line("xs", "ys", dashed=True), xs=tuple[float, ...], ys=tuple[float, ...])
PName = Primitive("PName", Label("name"), name=str)
PWanted = Primitive("PWanted", Label("name", "#ff00ff", "wanted <b>", marks=True), name=str)
TAt = Transformation("TAt", Motion("x", "y", "turn"), x=Metres, y=Metres, turn=float)
eGo = EventType("eGo", place=str)
ePace = EventType("ePace", speed=MetresPerSecond)
eBring = EventType("eBring", source=str, target=str, times=int, gently=bool)
ePicture = EventType("ePicture", visual=True)
eDone = EventType("eDone", what=str)
eShade = EventType("eShade", visual=True)


class Cart(Agent, symbol="ACart"):
    x: Metres = 0.0
    speed: MetresPerSecond = 0.5

    @on("eGo")
    def go(self, go, moment):
        self.x += 1.0

    @on("ePace")
    def pace(self, pace, moment):
        self.speed = pace.speed

    @on("eBring")
    def bring(self, bring, moment):
        pass

    @view("ePicture")
    def picture(self, event):
        return TAt(self.x, 0.0, 0.0)(PCart())


class Parcel(Agent, symbol="AParcel"):
    @view("ePicture")
    def picture(self, event):
        return PStone(0.1)


WORDS = Vocabulary.of(
    *(PFloor, PMemory, PCart, PStone, PWay, PName, PWanted, TAt),
    *(eGo, ePace, eBring, eDone, ePicture, eShade, Cart, Parcel),
)
FLOOR = np.zeros((8, 6), np.int16)
FLOOR[2, 1:4] = 1


def slot(symbol, name):
    return Scene((AgentNode(symbol, name),))


def cart(x, y=0.0, turn=0.0):
    return TAt(x, y, turn)(PCart())


def named(name, x, y):
    return TAt(x, y, 0.0)(PName(name))


class Nobody:
    """An operator that records the commands it receives; with `silent` it does not respond."""

    def __init__(self):
        self.told, self.silent, self.unheard = [], False, 0
        self.types, self.fates = ("eBring", "eGo", "ePace"), []
        self.happenings, self.events = (), {}

    def status(self, since=0):
        self.unheard += self.silent
        self._answer()
        member = MemberStatus("gate", "present", orders=self.types)
        return WorldStatus(
            "yard", 7, 0.1, "events", rate=10.0, hz=9.5, members=(member,), events=self.events,
            happenings=tuple(happening for happening in self.happenings if happening.number > since),
        )  # fmt: skip

    def named(self, by):
        self.person = by
        return self

    def orders(self, since=0):
        self._answer()
        return [order for order in self.fates if order.change > since]

    def fragment(self, agent):
        self._answer()
        return f"ACart#{agent}<x=1.5, speed=0.75>"

    def order(self, event):
        self._answer()
        self.told.append(event)

    def pause(self):
        self._answer()
        self.told.append("pause")

    def resume(self):
        self.told.append("resume")

    def step(self, frames=1):
        self.told.append("step")

    def set_rate(self, rate):
        self.told.append(rate)

    def _answer(self):
        if self.silent:
            raise BusError("the world 'yard' has not answered for a second")


def yard(operator=None):
    return WorldInfo("yard", WORDS, 1, 0.1, operator or Nobody())


def picture(scene, lists=None, **parts):
    return (lists or Lists(WORDS)).picture(scene, parts)


@contextmanager
def listened():
    """A real server, and the list of the messages that it sends to every browser."""
    from minerva_services.views.web.serving import serve, stop

    server, sent = serve("127.0.0.1", 0), []
    channel = server._websock_server
    send = channel.queue_message

    def queue_message(message):
        sent.append(message)
        send(message)

    channel.queue_message = queue_message
    try:
        yield server, sent
    finally:
        stop(server)


def taken_port():
    """A port in use, with its socket."""
    taken = socket.socket()
    taken.bind(("127.0.0.1", 0))
    taken.listen()
    return taken, taken.getsockname()[1]
