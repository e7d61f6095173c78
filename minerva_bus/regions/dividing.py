"""Dividing strings into the units of each region."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.frame.lag import NOWHERE
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Piece, Scene, agents
from minerva_bus.regions.attached import HOME
from minerva_bus.regions.merging import Units
from minerva_bus.regions.partition import Partition, regions_of
from minerva_bus.regions.place_table import Place, PlaceTable, joined, taken

NOTHING: Final = Units((), ())
NOBODY: Final[Mapping[str, int]] = MappingProxyType({})


def cut(scene: Scene, partition: Partition, strays: Mapping[str, int] = NOBODY) -> list[Units]:
    """The units of each region in the string with which a world begins.

    The regions of `strays` are not those where they are.
    """
    places = PlaceTable.numbered(sum(piece.count for piece in scene.pieces))
    regions: list[NDArray[np.intp]] = []
    for piece in scene.pieces:
        of_agents = regions_of(partition, piece)
        home = np.full(piece.count, HOME, np.intp)
        regions.append(home if of_agents is None else _at_home(piece, of_agents, strays))
    parts = divided(Units(places, scene.pieces), regions)
    return [parts.get(number, NOTHING) for number in range(partition.count)]


def _at_home(
    piece: Piece, regions: NDArray[np.intp], strays: Mapping[str, int]
) -> NDArray[np.intp]:
    """The regions of the nodes of a piece; those of agents born since are where they are."""
    if not strays:
        return regions
    if piece.ids is None:  # All agents of a unit are in the same region.
        homes = [strays.get(agent.id, NOWHERE) for agent in agents(Scene((piece,)))]
        known = [home for home in homes if home != NOWHERE]
        return np.array(known[:1], np.intp) if known else regions
    rows = Ids.of([*strays]).rows_of(piece.ids)
    homes = np.array([*strays.values()], np.intp)[rows]
    return np.where((rows >= 0) & (homes != NOWHERE), homes, regions)


def divided(units: Units, regions: Sequence[NDArray[np.intp]]) -> dict[int, Units]:
    """Units by region; `regions` has the region of each node of each piece."""
    places: dict[int, list[Sequence[Place]]] = {}
    pieces: dict[int, list[Piece]] = {}
    for (own, piece), each in zip(units.each(), regions, strict=True):
        if piece.count == 1:  # Most pieces: a shorter way to the same parts.
            places.setdefault(int(each[0]), []).append(own)
            pieces.setdefault(int(each[0]), []).append(piece)
            continue
        for region in np.unique(each).tolist():
            rows = np.flatnonzero(each == region)
            whole = len(rows) == piece.count
            places.setdefault(region, []).append(own if whole else taken(own, rows))
            part = piece if whole or not isinstance(piece, Columns) else piece.take(rows)
            pieces.setdefault(region, []).append(part)
    return {
        region: Units(joined(places[region]), tuple(pieces[region])) for region in sorted(places)
    }


class Border:
    """Finds the units that leave a region, by piece: those that have not changed stay."""

    def __init__(self, number: int) -> None:
        self._number = number
        # Pieces are kept, not only their ids: Python reuses the id of an object that is gone.
        self._settled: dict[int, Piece] = {}
        self._settled_by: Partition | None = None

    def leaving(self, units: Units, partition: Partition) -> tuple[dict[int, Units], Units | None]:
        """The units whose agents are now in other regions, by region.

        Also the remaining ones; None if all of them stay.
        """
        if self._settled_by is not partition:
            self._settled, self._settled_by = {}, partition
        regions: list[NDArray[np.intp]] = []
        for piece in units.pieces:
            own = np.full(piece.count, self._number, np.intp)
            of_agents = None if id(piece) in self._settled else regions_of(partition, piece)
            regions.append(own if of_agents is None else of_agents)
        if all((each == self._number).all() for each in regions):
            self._settled = {id(piece): piece for piece in units.pieces}
            return {}, None
        parts = divided(units, regions)
        remaining = parts.pop(self._number, NOTHING)
        return parts, remaining
