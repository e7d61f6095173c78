"""Checks of the agents that arrive in a region with the parcels of others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.composition import Composition
from minerva_bus.grammar.packing import packed
from minerva_bus.grammar.scene import Piece, Scene, agents
from minerva_bus.regions.parcel import Parcel
from minerva_bus.regions.partition import Partition, regions_of


def check_arriving(
    parcels: Iterable[Parcel], partition: Partition, composition: Composition
) -> None:
    """Raise ProtocolError for an agent of another region, or one that is here already."""
    for parcel in parcels:
        # A check of many agents in columns costs less than to put them there.
        for piece in packed(parcel.units.scene).pieces:
            regions = regions_of(partition, piece)
            if regions is None or (regions != parcel.target).any():
                raise _wrong(parcel, f"has sent {piece.symbol}, which does not belong here")
            present = next(_present(piece, composition), None)
            if present is not None:
                raise _wrong(parcel, f"has sent #{present}, which is here already")


def _present(piece: Piece, composition: Composition) -> Iterator[str]:
    """The agents of a piece that are in this region already."""
    if piece.ids is not None:
        rows = np.flatnonzero(composition.kinds(piece.ids) != "")
        yield from piece.ids.take(rows).texts()
    else:
        names = (agent.id for agent in agents(Scene((piece,))))
        yield from (name for name in names if composition.home(name) is not None)


def _wrong(parcel: Parcel, problem: str) -> ProtocolError:
    return ProtocolError(f"region {parcel.source} {problem}, in its parcel of frame {parcel.frame}")
