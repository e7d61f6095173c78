"""Agents in a field: beetles feel the warmth at their place, and go where it is warmer."""

import numpy as np

from minerva_bus import Agent, Disc, EventType, Primitive, Raster, Reals, World, each, on, run, view
from minerva_study import Placed

SHADES = ("#fbfaf6", "#fee0d2", "#fcbba1", "#fc9272", "#fb6a4a", "#ef3b2c", "#a50f15")
PHeat = Primitive("PHeat", Raster("heat", 1.0, colors=tuple(enumerate(SHADES))), heat=Reals)
eHeat = EventType("eHeat", heat=Reals)  # degrees, in squares of a metre


class Room(Agent, symbol="ARoom"):
    heat: Reals = np.zeros((40, 30))

    @on("eStep")
    def spread(self, step, moment):
        wide = np.pad(self.heat, 1)  # The walls stay at 0.
        around = wide[:-2, 1:-1] + wide[2:, 1:-1] + wide[1:-1, :-2] + wide[1:-1, 2:]
        self.heat = self.heat + 0.2 * (around - 4 * self.heat)
        self.heat[20, 15] = 12.0
        moment.emit(eHeat(self.heat))

    @view("ePicture")
    def picture(self, event):
        return PHeat(self.heat)


class Beetle(Placed, form=Disc(0.3, "#2f3640")):
    @on("eHeat", population=True)
    def crawl(self, field, moment):
        x = np.clip(self.x + moment.chance.normal(0, 0.5), 0, 39)
        y = np.clip(self.y + moment.chance.normal(0, 0.5), 0, 29)
        here, there = (field.heat[np.int64(a), np.int64(b)] for a, b in [(self.x, self.y), (x, y)])
        self.x, self.y = np.where(there < here, self.x, x), np.where(there < here, self.y, y)


x, y = np.random.default_rng(1).uniform(0, (39, 29), (100, 2)).T
scene = Room("room").string + Beetle.many("b", 100, x=x, y=y)
run(World(scene, services=[each("eStep")], name="warmth"), frames=200).picture().save("warmth.svg")
