"""A population for runs on a real bus: fish that swim, call, are born and die at random."""

import numpy as np
import yard
from yard import eStep

from minerva_bus import (
    Agent,
    Device,
    EventType,
    Metres,
    Primitive,
    Transformation,
    Vocabulary,
    on,
    view,
)

PDot = Primitive("PDot")
TAt = Transformation("TAt", x=Metres)
eCall = EventType("eCall", x=Metres)
eShow = EventType("eShow", visual=True)


class Fish(Agent, symbol="AFish"):
    x: Metres = 0.0
    heard: int = 0
    births: int = 0

    @on("eStep", population=True)
    def swim(self, step, moment):
        self.x += moment.chance.normal() + 0.001 * step.count
        moment.emit(eCall(self.x, receivers=self.id), where=moment.chance.chance(0.3))
        self.bear(moment.chance.chance(0.05), x=self.x)

    @on("eCall", population=True)
    def hear(self, call, moment):
        self.heard += 1
        self.die(moment.chance.chance(0.15))

    @view("eShow", population=True)
    def picture(self, event):
        return TAt(self.x)(PDot())


class Steps(yard.Steps, events=("eStep",)):
    """Has no inputs, but a state that a successor inherits."""


class Screen(Device, draws=("eShow",), when="each frame"):
    """Prints the number of figures in each view and the sum of their positions."""

    def __init__(self, said=False):
        self.said = said

    def show(self, view):
        if not self.said:
            return
        places = [float(node.values[0]) for node in view.scene]
        print(f"{view.frame} {len(places)} {sum(places)!r}", flush=True)


vocabulary = Vocabulary.of(PDot, TAt, eStep, eCall, eShow, Fish)


def scene(options):
    return Fish.many("f", 1000, x=np.arange(1000.0))
