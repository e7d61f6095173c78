"""A world with pictures, in a module that other processes can import."""

import signal

from minerva_bus import (
    Agent,
    Disc,
    EventType,
    Metres,
    Motion,
    Primitive,
    Transformation,
    World,
    each,
    on,
    view,
)  # fmt: skip

PBall = Primitive("PBall", Disc(0.5, "#3366cc"))
TAt = Transformation("TAt", Motion(x="x", y="y"), x=Metres, y=Metres)
eTick = EventType("eTick")
eKick = EventType("eKick")
ePicture = EventType("ePicture", visual=True)
eBroken = EventType("eBroken", visual=True)


class Ball(Agent, symbol="ABall"):
    x: Metres = 0.0
    y: Metres = 0.0

    @on("eTick")
    def roll(self, tick, moment):
        self.x += 1.0

    @on("eKick")
    def fly(self, kick, moment):
        self.y += 10.0

    @view("ePicture")
    def picture(self, event):
        return TAt(self.x, self.y)(PBall())

    @view("eBroken")
    def broken(self, event):
        return TAt(self.x / 0, 0.0)(PBall())


class Bell(Agent, symbol="ABell"):
    rung: int = 0

    @on("eTick")
    def ring(self, tick, moment):
        if self.rung == 5:
            signal.raise_signal(signal.SIGINT)
            self.after()
        self.rung += 1

    @staticmethod
    def after():
        """What the agent does after the signal."""


def bells():
    """A world in which somebody presses Ctrl-C in frame 5."""
    return World("ABell#a", agents=[Bell], services=[each(eTick)], name="bells")


def balls():
    return World("ABall#a · ABall#b<y=3>", agents=[Ball], services=[each(eTick)], name="balls")
