"""Grid: the game of life; a cell lives on with two or three neighbours, and is born with three."""

import numpy as np

from minerva_bus import Agent, Cells, EventType, Primitive, Raster, World, each, on, run, view

PCells = Primitive("PCells", Raster("cells", 1.0, colors=((1, "#0072b2"),)), cells=Cells)
ePicture = EventType("ePicture", visual=True)
eStep = EventType("eStep")


class Life(Agent, symbol="ALife"):
    cells: Cells

    @on("eStep")
    def step(self, event, moment):
        shifts = [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if (x, y) != (0, 0)]
        around = sum(np.roll(self.cells, shift, (0, 1)) for shift in shifts)
        self.cells = ((around == 3) | ((around == 2) & (self.cells == 1))).astype(np.int16)

    @view("ePicture")
    def picture(self, event):
        return PCells(self.cells)


start = (np.random.default_rng(1).random((60, 40)) < 0.3).astype(np.int16)
world = World(Life("life", cells=start).string, services=[each(eStep)], name="life")
run(world, frames=60).picture().save("grid.svg")
