"""Spaces: lattices, fields and graphs with compiled rules; see `Space` and `rule`."""

from minerva_fast.space.draws import (
    Draws,
    chance,
    exponential,
    integers,
    normal,
    random,
    shuffle,
    uniform,
)
from minerva_fast.space.edges import Edges, degree, edge, neighbour, random_neighbour
from minerva_fast.space.field import FieldGrid, go_to, near
from minerva_fast.space.kernels import interpreted, kernel
from minerva_fast.space.lattice import CellGrid, beside, next_cell
from minerva_fast.space.occupancy import copy, move_to, random_at, random_free, remove, within
from minerva_fast.space.rules import ORDERED, SHUFFLED, SIMULTANEOUS, Activation, rule
from minerva_fast.space.space import Space
from minerva_fast.space.tables import Column, InField, OnLattice

__all__ = [
    "ORDERED",
    "SHUFFLED",
    "SIMULTANEOUS",
    "Activation",
    "CellGrid",
    "Column",
    "Draws",
    "Edges",
    "FieldGrid",
    "InField",
    "OnLattice",
    "Space",
    "beside",
    "chance",
    "copy",
    "degree",
    "edge",
    "exponential",
    "go_to",
    "integers",
    "interpreted",
    "kernel",
    "move_to",
    "near",
    "neighbour",
    "next_cell",
    "normal",
    "random",
    "random_at",
    "random_free",
    "random_neighbour",
    "remove",
    "rule",
    "shuffle",
    "uniform",
    "within",
]
