"""Halos: the figures that a region shows the others, because they are near their cells.

A service with a halo runs in each region. It sees the figures of the region's agents, and those of
other regions within its radius of the region's cell. A figure has to be within the cell of its
agent: then all figures near an agent of a region are near the cell, too. Figures outside of agents
are shown to all regions, if the service needs them and whenever they change. Without a radius, all
figures are shown to all regions in each frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import inf
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import WorldStopped
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.in_flight import FrameInFlight
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import Piece, Scene
from minerva_bus.grammar.slots import fill
from minerva_bus.grammar.traversal import walk
from minerva_bus.regions.figures import PieceFigures, figures_in, is_figure
from minerva_bus.regions.halo_part import HaloPart
from minerva_bus.regions.merging import Units
from minerva_bus.regions.partition import ByPosition, Cell, Partition
from minerva_bus.regions.place_table import Place, joined, taken
from minerva_bus.regions.tree import ByTree
from minerva_bus.regions.views import PartialViews, RegionViews, placed_views
from minerva_bus.world.halo import Halo

_MARGIN: Final = 1.0 + 1e-9
_ROUNDING: Final = 1e-12
"""How much more than the radius counts as near, as a factor and as a share of a periodic plane:
services round distances."""


def scenery_of(event_type: str) -> str:
    """The name of the figures outside of agents in the view for an event type."""
    return f"~{event_type}"


class HaloViews:
    """The figures of a region's agents, for services with a halo here and in other regions."""

    def __init__(self, number: int, halos: Mapping[str, Halo]) -> None:
        """`halos` are those of all services, by visual event type."""
        self._number = number
        self._halos = halos
        self._partial = PartialViews(frozenset(halos))
        self._views = RegionViews()
        self._shown: dict[str, Units] = {}
        self._scenery: dict[str, Units] = {}
        self._sent: dict[str, Units] = {}
        self._partition: Partition | None = None
        self._cells: Sequence[Cell] = ()
        self._near: dict[str, list[int]] = {}
        self._halted: tuple[str, ...] = ()

    def note(
        self, in_flight: FrameInFlight, composition: Composition, places: Sequence[Place]
    ) -> None:
        """Note the views of a frame whose results are final, before they replace the string."""
        part = self._partial.part(in_flight, composition, places)
        self._shown, self._scenery, self._halted = {}, {}, part.halted
        if part:
            self._views.take(part)
        for name in part.views:
            shown = _filled(self._views, name, self._halos[name], composition)
            self._shown[name], self._scenery[scenery_of(name)] = shown

    def by_region(
        self, partition: Partition, kept: Mapping[str, str] | None = None
    ) -> dict[int, HaloPart]:
        """The figures for each region, all for this one; agents are in the cells of `partition`.

        `kept` is what services have saved, for regions that are shown figures. Raises WorldStopped
        if an agent's figure is outside of the cell of its region.
        """
        assert isinstance(partition, ByPosition | ByTree)
        if partition is not self._partition:
            # Once for all frames, so that a frame costs no more with more regions farther away.
            self._partition, self._cells = partition, partition.cells
            self._near = {
                name: near_cells(self._cells, self._number, halo)
                for name, halo in self._halos.items()
            }
        shown = {self._number: dict(self._shown)} if self._shown else {}
        for event_type, units in self._shown.items():
            for region, near in self._near_units(event_type, units):
                shown.setdefault(region, {})[event_type] = near
        for name, units in self._scenery.items():
            if units != self._sent.get(name, _NOTHING):
                self._sent[name] = units
                for region in range(len(self._cells)):
                    shown.setdefault(region, {})[name] = units
        return {to: HaloPart(of, kept or {}, self._halted) for to, of in shown.items()}

    def _near_units(self, event_type: str, units: Units) -> Iterator[tuple[int, Units]]:
        """The figures that other regions see, by region."""
        halo, cells = self._halos[event_type], self._cells
        if halo.everywhere:
            yield from ((region, units) for region in self._near[event_type] if units)
            return
        figures = [figures_in(piece, halo) for piece in units.pieces]
        for each in figures:
            _check_inside(each, cells[self._number], halo)
        near = _NearFigures(units, figures, halo)
        for region in self._near[event_type]:
            units = near.within(cells[region])
            if units:
                yield region, units


_NOTHING: Final = Units((), ())


def _filled(
    views: RegionViews, event_type: str, halo: Halo, composition: Composition
) -> tuple[Units, Units]:
    """What the agents of a region show, and the scenery, with a place for each outermost node.

    Without scenery in the halo, all figures are those of agents. Raises WorldStopped for an agent's
    figure that could be taken for scenery.
    """
    placed, shown = placed_views(views, event_type), views.views.get(event_type, {})
    of_agents, scenery = _Placed(), _Placed()
    for (own, piece), kind in zip(placed.units.each(), placed.kinds, strict=True):
        if piece.still and not kind:
            is_scenery = halo.scenery and not is_figure(piece, halo)
            (scenery if is_scenery else of_agents).add(own, piece)
            continue
        made = (piece,) if piece.still else fill(Scene((piece,)), shown).pieces
        for each in made:
            if halo.scenery and not halo.everywhere and not is_figure(each, halo):
                raise WorldStopped(
                    f"regions: halo = true: {kind or 'an agent'} shows"
                    f" {next(walk(Scene((each,))))[1].symbol} for {event_type} without"
                    f" {halo.x}, {halo.y} and its id as {halo.who}; show these, or use halo = false"
                )
            missing = composition.first_missing(figures_in(each, halo).who) if halo.kept else None
            if missing is not None:
                raise WorldStopped(
                    f"regions: halo = true: {kind or 'an agent'} shows {halo.figure} of {missing!r}"
                    f" for {event_type}, which is no agent of its region; give figures the id of"
                    f" their agent as {halo.who}, or use halo = false"
                )
            # A slot, or a transformation around some, is a single node.
            of_agents.add(own if piece.still else taken(own, np.zeros(each.count, np.intp)), each)
    return of_agents.units, scenery.units


class _Placed:
    """Pieces that are added one after another."""

    def __init__(self) -> None:
        self._places: list[Sequence[Place]] = []
        self._pieces: list[Piece] = []

    def add(self, places: Sequence[Place], piece: Piece) -> None:
        self._places.append(places)
        self._pieces.append(piece)

    @property
    def units(self) -> Units:
        return Units(joined(self._places), tuple(self._pieces))


def _bounds(cell: Cell, halo: Halo) -> Iterator[tuple[str, float, float, float]]:
    """Name, bounds and length of the plane, 0 if it is not periodic, for each coordinate."""
    for name, length in zip((halo.x, halo.y), halo.size or (0.0, 0.0), strict=True):
        low, high = cell.get(name, (-inf, inf))
        yield name, max(low, 0.0) if length else low, min(high, length) if length else high, length


def _check_inside(figures: PieceFigures, cell: Cell, halo: Halo) -> None:
    for name, low, high, length in _bounds(cell, halo):
        at = figures.at.get(name)
        if at is None:
            continue
        # The far edge of a periodic plane is the near one. Comparisons with NaN do not hold.
        inside = (at >= low) & ((at < high) | (at == length if length else False))
        if not inside.all():
            row = int(np.argmin(inside))
            raise WorldStopped(
                f"regions: halo = true: #{figures.who[row]} shows {name} = {at[row]}, outside of"
                f" the cell of its region, {low} to {high}; expected figures at the attributes that"
                " divide the regions, within a periodic plane, or halo = false"
            )


def near_cells(cells: Sequence[Cell], own: int, halo: Halo) -> list[int]:
    """The other cells within the radius of a cell, along each axis."""
    near = {*range(len(cells))} - {own}
    for name, low, high, length in _bounds(cells[own], halo):
        reach = halo.radius * _MARGIN + _ROUNDING * length
        shifts = (0.0, -length, length) if length else (0.0,)
        for number in sorted(near):
            bounds = {each: (begin, end) for each, begin, end, _ in _bounds(cells[number], halo)}
            begin, end = bounds[name]
            images = ((low + shift, high + shift) for shift in shifts)
            if not any(begin - last <= reach and first - end <= reach for first, last in images):
                near.remove(number)
    return sorted(near)


class _NearFigures:
    """Finds the figures of a region that are near the cells of others.

    Cells of one column, or row, have the same interval along an axis, which is compared once.
    """

    def __init__(self, units: Units, figures: Sequence[PieceFigures], halo: Halo) -> None:
        self._units = units
        self._figures = figures
        self._halo = halo
        self._known: dict[tuple[int, str, float, float], NDArray[np.bool_]] = {}

    def within(self, cell: Cell) -> Units:
        """The figures within the radius of a cell, along each axis."""
        bounds = [*_bounds(cell, self._halo)]
        places: list[Sequence[Place]] = []
        pieces: list[Piece] = []
        for number, (own, piece) in enumerate(self._units.each()):
            at = self._figures[number].at
            near = np.ones(len(self._figures[number].who), np.bool_)
            for name, low, high, length in bounds if at else ():
                near &= self._along(number, name, low, high, length)
            rows = np.flatnonzero(near)
            if not len(rows):
                continue
            places.append(taken(own, rows))
            pieces.append(piece.take(rows) if isinstance(piece, Columns) else piece)
        return Units(joined(places), tuple(pieces)) if pieces else _NOTHING

    def _along(
        self, number: int, name: str, low: float, high: float, length: float
    ) -> NDArray[np.bool_]:
        """Whether the figures of a piece are near an interval of a coordinate."""
        key = number, name, low, high
        if key not in self._known:
            at, radius = self._figures[number].at[name], self._halo.radius
            self._known[key] = _within(at, low, high, length, radius)
        return self._known[key]


def _within(
    at: NDArray[Any], low: float, high: float, length: float, radius: float
) -> NDArray[np.bool_]:
    """Whether coordinates are within the radius of an interval."""
    if low > high:  # A cell outside of a periodic plane, where no agent can be.
        return np.zeros(len(at), np.bool_)
    reach = radius * _MARGIN + _ROUNDING * length
    near = np.zeros(len(at), np.bool_)
    for image in (at, at - length, at + length) if length else (at,):
        # Differences as services compute them: rounding preserves their order.
        near |= (low - image <= reach) & (image - high <= reach)
    return near
