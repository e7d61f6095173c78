"""Map from an image: dark pixels are walls, and balls turn back at them."""

import numpy as np
from PIL import Image, ImageDraw

from minerva_bus import Cells, Disc, Primitive, Raster, World, each, on, run
from minerva_study import Placed

plan = Image.new("L", (60, 40), "white")
ImageDraw.Draw(plan).ellipse((5, 5, 54, 34), outline="black", width=2)
plan.save("plan.png")
PWalls = Primitive("PWalls", Raster("cells", 1.0, colors=((1, "#2f3640"),)), cells=Cells)
walls = (np.asarray(Image.open("plan.png"))[::-1].T < 128).astype(np.int16)  # [x, y from below]
near = walls + sum(np.roll(walls, step, axis) for step in (-1, 1) for axis in (0, 1))


class Ball(Placed, form=Disc(0.6, "viridis(hits, 0, 6)")):
    vx: float
    vy: float
    hits: int = 0

    @on("eStep", population=True)
    def roll(self, step, moment):
        free = near[np.int64(self.x + self.vx), np.int64(self.y + self.vy)] == 0
        self.vx, self.vy = np.where(free, 1, -1) * self.vx, np.where(free, 1, -1) * self.vy
        self.x, self.y, self.hits = self.x + self.vx, self.y + self.vy, self.hits + ~free


vx, vy = np.random.default_rng(1).uniform(-0.5, 0.5, (2, 40))
balls = Ball.many("b", 40, x=30.0, y=20.0, vx=vx, vy=vy)
world = World(PWalls(walls) + balls, services=[each("eStep")], name="balls")
run(world, frames=90).picture().save("image.svg")
