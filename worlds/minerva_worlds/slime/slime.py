"""A slime mould: cells that follow a scent and leave it, so that veins and nets of them form.

A cell smells three places before it, turns to the strongest scent and moves. `Nose` tells it what
it smells, and tells the ground how many cells are at each place. The nose has no state, because
everything is in the string.

Jeff Jones (2010): Characteristics of pattern formation and evolution in approximations of Physarum
transport networks. Artificial Life 16.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus import (
    Agent,
    Cells,
    Context,
    Device,
    Event,
    EventType,
    Generator,
    Metres,
    Primitive,
    Raster,
    Reals,
    Scene,
    Tick,
    View,
    Vocabulary,
    on,
    portable,
    view,
)
from minerva_services.physics.neighbours.spots import Names, SpotReader, Spots

AHEAD = 9.0
"""Metres to the places that a cell smells: before it, and 45° to the left and to the right."""
TURN = math.pi / 4
KEPT = 0.9
"""The part of the scent that is left after a frame."""
COLORS = (
    *((0, "#0b1026"), (1, "#16214a"), (2, "#233d78"), (4, "#2f649f")),
    *((8, "#3f93b5"), (12, "#6cc0b8"), (16, "#b7e3b0"), (24, "#f6f5c4")),
)
"""Colours of the scent, from these numbers on."""

# --- the vocabulary -------------------------------------------------------------------------------

PCell = Primitive("PCell", who=str, x=Metres, y=Metres, dx=float, dy=float)
PScent = Primitive("PScent", scent=Reals)
PGround = Primitive("PGround", Raster("cells", 1.0, colors=COLORS), cells=Cells)

eWhere = EventType("eWhere", visual=True)
eScent = EventType("eScent", visual=True)
ePicture = EventType("ePicture", visual=True)
eSmell = EventType("eSmell", left=float, ahead=float, right=float)
eTraces = EventType("eTraces", cells=Cells)

# --- the agents -----------------------------------------------------------------------------------


class Cell(Agent, symbol="ACell"):
    """Follows the scent; `heading` is in radians. The plane is periodic."""

    x: Metres
    y: Metres
    heading: float
    width: int
    height: int

    @on("eSmell")
    def crawl(self, smell: Event, moment: Context) -> None:
        if smell.ahead <= smell.left or smell.ahead <= smell.right:
            if smell.left > smell.right:
                self.heading += TURN
            elif smell.left < smell.right:
                self.heading -= TURN
            else:
                self.heading += TURN if moment.chance.chance(0.5) else -TURN
        self.x = (self.x + portable.cos(self.heading)) % self.width
        self.y = (self.y + portable.sin(self.heading)) % self.height

    @view("eWhere", population=True)
    def where(self, event: Event) -> Scene:
        dx, dy = portable.cos(self.heading), portable.sin(self.heading)
        return PCell(self.id, self.x, self.y, dx, dy)


class Ground(Agent, symbol="AGround"):
    """The scent in each square metre, which spreads and evaporates."""

    scent: Reals

    @on("eTraces")
    def spread(self, traces: Event, moment: Context) -> None:
        if traces.cells.shape != self.scent.shape:
            return  # A person has sent it.
        scent = self.scent + traces.cells
        for axis in (0, 1):
            scent = scent + np.roll(scent, 1, axis) + np.roll(scent, -1, axis)
        self.scent = scent * (KEPT / 9)

    @view("eScent")
    def smell(self, event: Event) -> Scene:
        return PScent(self.scent)

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        return PGround(np.minimum(self.scent, COLORS[-1][0]).astype(np.int16))


# --- the nose -------------------------------------------------------------------------------------


class Nose(
    Device,
    Generator,
    events=("eSmell", "eTraces"),
    draws=("eWhere", "eScent"),
    coupled=True,
    when="each frame",
):
    """Notifies each cell of the scent before it, and the ground of the cells."""

    def __init__(self) -> None:
        self.reader = SpotReader("nose", Names())
        self.cells: Spots | None = None
        self.scent = np.zeros((1, 1))

    def show(self, view: View) -> None:
        if view.event_type == eWhere.name:
            self.cells = self.reader.read(view.scene)
        else:
            self.scent = view.scene.nodes[0].parameters["scent"]

    def generate(self, tick: Tick) -> Iterator[Event]:
        cells = self.cells
        if cells is None:
            return
        dx, dy = AHEAD * cells.shown["dx"], AHEAD * cells.shown["dy"]
        side = math.sqrt(0.5)
        yield eSmell(
            left=self.smelled(cells, side * (dx - dy), side * (dx + dy)),
            ahead=self.smelled(cells, dx, dy),
            right=self.smelled(cells, side * (dx + dy), side * (dy - dx)),
            receivers=cells.ids,
        )
        places = np.bincount(self.places(cells.x, cells.y), minlength=self.scent.size)
        yield eTraces(places.reshape(self.scent.shape).astype(np.int16))

    def smelled(self, cells: Spots, dx: NDArray[Any], dy: NDArray[Any]) -> NDArray[Any]:
        """The scent at a displacement from each cell."""
        return self.scent.ravel()[self.places(cells.x + dx, cells.y + dy)]

    def places(self, x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
        """The indices of positions in the matrix of the scent, in one dimension."""
        width, height = self.scent.shape
        column, row = np.floor(x).astype(int) % width, np.floor(y).astype(int) % height
        return column * height + row


# --- the world ------------------------------------------------------------------------------------

vocabulary = Vocabulary.of(
    *(PCell, PScent, PGround, eWhere, eScent, ePicture, eSmell, eTraces, Cell, Ground)
)


def scene(options: Mapping[str, Any]) -> Scene:
    """The ground without scent, and cells at random positions."""
    count, width, height = options["cells"], options["width"], options["height"]
    chance = np.random.default_rng(1)
    cells = Cell.many(
        "c",
        count,
        x=chance.uniform(0, width, count),
        y=chance.uniform(0, height, count),
        heading=chance.uniform(0, 2 * math.pi, count),
        width=width,
        height=height,
    )
    return Ground("ground", scent=np.zeros((width, height))).string + cells
