"""What several of the models share: turtles, `diffuse`, and a step in every tick."""

from minerva_bus import EventType, Reals, World, each
from minerva_fast import (
    SIMULTANEOUS,
    CellGrid,
    Column,
    OnLattice,
    Space,
    beside,
    kernel,
    move_to,
    rule,
)

AROUND = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
OUTSIDE = -1

eStep = EventType("eStep")


class Turtle(OnLattice):
    """Has a position within its cell."""

    x: Column
    y: Column


@kernel
def stand(turtles, i, x, y):
    """Move a turtle to a position of a torus."""
    turtles.x[i], turtles.y[i] = x % turtles.lattice.width, y % turtles.lattice.height
    move_to(turtles, i, int(turtles.y[i]) * turtles.lattice.width + int(turtles.x[i]))


@rule(SIMULTANEOUS)
def diffuse(
    cell: int, level: Reals, before: Reals, lattice: CellGrid, share: float, evaporation: float
):
    """Each cell gives a share to the 8 around it, and keeps what would leave the world."""
    total = 0.0
    for dx, dy in AROUND:
        other = beside(lattice, cell, dx, dy)
        total += before[cell if other == OUTSIDE else other]
    level[cell] = (1 - evaporation) * ((1 - share) * before[cell] + share * total / 8)


def ticking(space: Space) -> World:
    """A world of a space that takes a step in each frame."""
    return World(space.string, agents=[type(space)], services=[each(eStep)], name=space.id)
