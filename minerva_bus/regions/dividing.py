"""Dividing strings into the units of each region."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import Piece, Scene
from minerva_bus.regions.attached import HOME
from minerva_bus.regions.merging import Units
from minerva_bus.regions.partition import Partition, regions_of
from minerva_bus.regions.places import Place

NOTHING: Final = Units((), ())


def cut(scene: Scene, partition: Partition) -> list[Units]:
    """The units of each region in a world's initial string."""
    places = [(number,) for number in range(sum(piece.count for piece in scene.pieces))]
    regions: list[NDArray[np.intp]] = []
    for piece in scene.pieces:
        of_agents = regions_of(partition, piece)
        home = np.full(piece.count, HOME, np.intp)
        regions.append(home if of_agents is None else of_agents)
    parts = divided(Units(places, scene.pieces), regions)
    return [parts.get(number, NOTHING) for number in range(partition.count)]


def divided(units: Units, regions: Sequence[NDArray[np.intp]]) -> dict[int, Units]:
    """Units by region; `regions` has the region of each node of each piece."""
    places: dict[int, list[Place]] = {}
    pieces: dict[int, list[Piece]] = {}
    for (own, piece), each in zip(units.each(), regions, strict=True):
        if piece.count == 1:  # Most pieces: a shorter way to the same parts.
            places.setdefault(int(each[0]), []).append(own[0])
            pieces.setdefault(int(each[0]), []).append(piece)
            continue
        for region in np.unique(each).tolist():
            rows = np.flatnonzero(each == region)
            whole = len(rows) == piece.count
            places.setdefault(region, []).extend(own[row] for row in rows.tolist())
            part = piece if whole or not isinstance(piece, Columns) else piece.take(rows)
            pieces.setdefault(region, []).append(part)
    return {region: Units(places[region], tuple(pieces[region])) for region in sorted(places)}
