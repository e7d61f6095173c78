"""The agents with a figure for which the services of a region answer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Piece, Scene, agents
from minerva_bus.regions.figures import PieceFigures, figures_in
from minerva_bus.regions.halo_part import Figures
from minerva_bus.regions.merging import Units
from minerva_bus.regions.place_table import Place, joined
from minerva_bus.world.halo import Halo, OwnFigures


@dataclass(frozen=True, slots=True)
class Answered:
    """The agents of a region with a figure, their places, and figures by visual event type."""

    ids: Ids
    places: Sequence[Place]
    figures: Mapping[str, OwnFigures] = field(default_factory=dict[str, OwnFigures])


NOBODY: Final = Answered(Ids.of([]), ())


def showing(shown: Figures, halos: Mapping[str, Halo]) -> Answered:
    """The agents with a figure, and their places."""
    figures: dict[str, OwnFigures] = {}
    places: list[Sequence[Place]] = []
    for event_type in sorted(shown.keys() & halos.keys()):
        units = shown[event_type]
        each = [figures_in(piece, halos[event_type]) for piece in units.pieces]
        figures[event_type] = _joined(each, halos[event_type])
        for (own, _), of in zip(units.each(), each, strict=True):
            # A node may have several figures, if their positions do not matter.
            several = len(of.who) // len(own) if own else 1
            places += [own[: len(of.who)]] if several < 2 else [own] * several
    ids = [each.ids for each in figures.values()]
    return Answered(Ids.concatenated(ids), joined(places), figures) if ids else NOBODY


def figures_of(pieces: Iterable[Piece], halo: Halo) -> OwnFigures:
    """The figures of agents in pieces of a view."""
    return _joined([figures_in(piece, halo) for piece in pieces], halo)


def _joined(figures: Iterable[PieceFigures], halo: Halo) -> OwnFigures:
    present = [each for each in figures if each.at]
    if not present:
        return OwnFigures(Ids.of([]), np.zeros(0), np.zeros(0))
    x, y = (np.concatenate([each.at[name] for each in present]) for name in (halo.x, halo.y))
    return OwnFigures(Ids.concatenated([each.who for each in present]), x, y)


def within(units: Units) -> Answered:
    """The agents of a string, and the places of the nodes around them."""
    ids: list[str] = []
    places: list[Sequence[Place]] = []
    for own, piece in units.each():
        inside = [agent.id for agent in agents(Scene((piece,)))]
        ids += inside
        places.append(own if piece.ids is not None else [own[0]] * len(inside))
    return Answered(Ids.of(ids), joined(places))
