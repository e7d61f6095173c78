"""Field that diffuses: two stoves warm a room, whose walls are cold."""

import numpy as np

from minerva_bus import Agent, EventType, Primitive, Raster, Reals, World, each, on, run, view

SHADES = ("#fbfaf6", "#fee0d2", "#fcbba1", "#fc9272", "#fb6a4a", "#ef3b2c", "#a50f15")
COLORS = tuple((4 * number, shade) for number, shade in enumerate(SHADES))
PHeat = Primitive("PHeat", Raster("heat", 0.5, colors=COLORS), heat=Reals)
ePicture = EventType("ePicture", visual=True)
eStep = EventType("eStep")


class Room(Agent, symbol="ARoom"):
    heat: Reals = np.zeros((60, 40))  # degrees above the walls, in squares of half a metre

    @on("eStep")
    def spread(self, step, moment):
        wide = np.pad(self.heat, 1)  # The walls stay at 0.
        around = wide[:-2, 1:-1] + wide[2:, 1:-1] + wide[1:-1, :-2] + wide[1:-1, 2:]
        self.heat = self.heat + 0.2 * (around - 4 * self.heat)
        self.heat[15, 10] = self.heat[45, 30] = 30.0

    @view("ePicture")
    def picture(self, event):
        return PHeat(self.heat)


world = World(Room("room").string, services=[each(eStep)], name="room")
run(world, frames=400).picture().save("field.svg")
