"""Neighbours: agents perceive each other through events; no agent reads another's state."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_services.event_factory import event_type
from minerva_services.options import check_parameter
from minerva_services.physics.neighbours.perception import individual, summary
from minerva_services.physics.neighbours.search import near, tree
from minerva_services.physics.neighbours.spots import (
    NEIGHBOURHOODS,
    Lattice,
    Names,
    SpotReader,
    Spots,
    counts,
)

_KINDS = {"who": "text", "number": "int", "same": "int"}
_REAL = ("dx", "dy", "distance", "apart_x", "apart_y")


class Neighbours(Device, Generator, coupled=True):
    """Finds each agent's neighbours in a view, and notifies it in the next frame.

    The view has one figure per agent, alone or within transformations; together they carry its
    coordinates, its id and everything that neighbours can perceive: `TMove(x, y)(PSpot(who=id,
    vx=...))`. Figures without an id are scenery. The data of the event type select what an agent
    receives.

    One event per neighbour (the default), ordered by agent, then by neighbour: `who`, `dx` and `dy`
    (the displacement to it), `distance`, and everything that the neighbour shows.

    One event per agent (`summary`), also for agents without neighbours: `number` of neighbours, the
    means of `dx`, `dy`, `distance` and of everything shown, and `apart_x` and `apart_y`, the summed
    displacements away from neighbours closer than `apart`; means over no neighbours are 0. Of what
    is shown as `size`, also `sum_size`, the sum, and how many neighbours have the agent's own
    value, `same_size`, or a greater one, `more_size`.

    On a lattice (`grid`) likewise: `number`, means, sums and comparisons of everything shown, and
    `same`, the comparison with the name that the option `same` has.

    Args:
        event: the event type of notifications.
        draws: the visual event type of the views.
        every: frames between views. With 1, agents receive the previous frame's positions; with 2
          they look in one frame and move in the next.
        radius: maximum distance of a neighbour; on a lattice, the reach in cells.
        width: of a periodic plane, or in cells.
        height: of a periodic plane, or in cells.
        periodic: whether opposite edges are connected.
        nearest: maximum number of neighbours, nearest first; 0: all within the radius.
        summary: one event per agent.
        apart: distance within which displacements away are summed; 0: the radius.
        grid: agents are in cells, counted from 0.
        hood: moore or von neumann, the neighbourhood on a lattice.
        same: the name whose values are compared on a lattice.
        x: name of the x coordinate in the view.
        y: name of the y coordinate in the view.
        who: name of the id in the view.

    """

    def __init__(
        self,
        event: str = "eNear",
        draws: str = "eWhere",
        every: int = 1,
        radius: float = 1.0,
        width: float = 0.0,
        height: float = 0.0,
        periodic: bool = False,
        nearest: int = 0,
        summary: bool = False,
        apart: float = 0.0,
        grid: bool = False,
        hood: str = "moore",
        same: str = "",
        x: str = "x",
        y: str = "y",
        who: str = "who",
    ) -> None:
        _check(every, radius, hood)
        _check_nearest(nearest, summary or grid)
        self.when = f"each {every} frames"
        self.draws = (draws,)
        self._event = event
        self._radius = radius
        self._size = _plane(width, height, radius) if periodic and not grid else None
        self._nearest = nearest
        self._summary = summary
        self._apart = apart or radius
        self._lattice = Lattice(width, height, radius, hood, periodic) if grid else None
        if not grid:
            tree()  # a missing library must fail here, not in the first frame
        self._same = same
        self._names = {"x": x, "y": y, "who": who, **({"same": same} if same else {})}
        self._reader = SpotReader("neighbours", Names(x, y, who))
        # The events depend on the last view alone, which a successor receives again, so there is
        # nothing to save.
        self._ready: tuple[AnyEvent, ...] = ()
        self._shown = -1

    def generates(self) -> tuple[str, ...]:
        return (self._event,)

    def check(self, world: WorldInfo) -> None:
        self._type = event_type("neighbours", world, self._event)
        self._compare(self._type)
        for option, name in self._names.items():
            check_parameter("neighbours", world, option, name)

    def show(self, view: View) -> None:
        """Compute immediately, in parallel with the members that still work on this frame."""
        spots = self._reader.read(view.scene)
        self._ready = self._events(spots) if spots is not None else ()
        self._shown = view.frame

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        # With `every` > 1 most frames follow no view; the events of an older view have been sent.
        return self._ready if self._shown == tick.number - 1 else ()

    def _events(self, spots: Spots) -> tuple[AnyEvent, ...]:
        wanted = frozenset(self._type.fields.names)
        if self._lattice is not None:
            data = counts(spots, self._lattice, wanted, self._same)
            return (self._made(spots, spots.ids, data),)
        pairs = near(spots.x, spots.y, self._radius, self._size)
        if self._summary:
            data = summary(spots, pairs, wanted, self._apart)
            return (self._made(spots, spots.ids, data),)
        to, data = individual(spots, pairs, wanted, self._nearest)
        return (self._made(spots, spots.ids.take(to), data),) if len(to) else ()

    def _made(self, spots: Spots, receivers: Ids, data: Mapping[str, Any]) -> AnyEvent:
        try:
            return self._type(receivers=receivers, **data)
        except MisuseError as error:
            shown = ", ".join(spots.shown)
            raise MisuseError(f"neighbours: {error}; agents show {shown}") from None

    def _compare(self, declared: EventType) -> None:
        """Check that the type declares data of the kinds that are produced. Raises MisuseError."""
        means = self._summary or self._lattice is not None
        for field in declared.fields.all:
            produced = _KINDS.get(
                field.name, "real" if means or field.name in _REAL else field.type.kind
            )
            if means and field.name.startswith(("same_", "more_")):
                produced = "int"
            # A type may declare a count as a real number.
            if field.type.kind not in (produced, "real" if produced == "int" else produced):
                raise MisuseError(
                    f"neighbours: {declared.name} declares {field.name} as {field.type};"
                    f" neighbours produces {produced}"
                )


def _check(every: int, radius: float, hood: str) -> None:
    if every < 1:
        raise MisuseError(f"neighbours: every is {every}; expected an integer >= 1 (frames)")
    if not radius > 0:
        raise MisuseError(f"neighbours: radius is {radius}; expected a number above 0")
    if hood not in NEIGHBOURHOODS:
        raise MisuseError(f"neighbours: hood is {hood!r}; expected {' or '.join(NEIGHBOURHOODS)}")


def _check_nearest(nearest: int, together: bool) -> None:
    if nearest < 0:
        raise MisuseError(f"neighbours: nearest is {nearest}; expected an integer >= 0")
    if nearest and together:
        raise MisuseError(
            "neighbours: nearest requires one event per neighbour; omit it with summary and grid"
        )


def _plane(width: float, height: float, radius: float) -> tuple[float, float]:
    """Size of a periodic plane. Raises MisuseError if it is too small for the radius."""
    if not all(2 * radius < side < math.inf for side in (width, height)):
        raise MisuseError(
            f"neighbours: width and height of a periodic plane are {width} and {height}; expected"
            f" numbers above {2 * radius}, twice the radius"
        )
    return width, height
