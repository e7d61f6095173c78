"""Machine code for agents: compiled methods, and spaces with compiled rules.

    @on(..., compiled=True)     extensions/fast/compile.md
    class Meadow(Space): ...    extensions/fast/space.md

The names that users of spaces need; see `Space` and `rule`. The kernel loads the accelerator of a
class by its entry point.
"""

from minerva_fast.draws import (
    Draws,
    chance,
    exponential,
    integers,
    interpreted,
    kernel,
    normal,
    random,
    shuffle,
    uniform,
)
from minerva_fast.places import (
    CellGrid,
    Edges,
    FieldGrid,
    beside,
    copy,
    degree,
    edge,
    go_to,
    move_to,
    near,
    neighbour,
    next_cell,
    random_at,
    random_free,
    random_neighbour,
    remove,
    within,
)
from minerva_fast.rules import ORDERED, SHUFFLED, SIMULTANEOUS, Activation, rule
from minerva_fast.space import Space
from minerva_fast.tables import Column, InField, OnLattice

__all__ = [
    "ORDERED", "SHUFFLED", "SIMULTANEOUS", "Activation", "CellGrid", "Column", "Draws", "Edges",
    "FieldGrid", "InField", "OnLattice", "Space", "beside", "chance", "copy", "degree", "edge",
    "exponential", "go_to", "integers", "interpreted", "kernel", "move_to", "near", "neighbour",
    "next_cell", "normal", "random", "random_at", "random_free", "random_neighbour", "remove",
    "rule", "shuffle", "uniform", "within",
]  # fmt: skip
