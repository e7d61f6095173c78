"""Neighbours: agents perceive one another through events, and no agent reads another."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.symbols import EventType
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_services.making import event_type
from minerva_services.physics.neighbours.lattice import HOODS, Lattice, counts
from minerva_services.physics.neighbours.plane import near, tree
from minerva_services.physics.neighbours.spots import Names, Reader, Spots
from minerva_services.physics.neighbours.telling import one_by_one, summary

_KINDS = {"who": "text", "number": "int", "same": "int"}
_REAL = ("dx", "dy", "distance", "apart_x", "apart_y")


class Neighbours(Device, Generator, coupled=True):
    """Looks at where agents are, and tells each who is near it, in the frame that follows.

    The view has one figure for each agent, alone or within transformations, which carry among
    them its coordinates, its id, and whatever else its neighbours can see of it:
    `TMove(x, y)(PSpot(who=id, vx=...))`. Figures without an id are scenery. What an agent is told
    is up to the data of the event type.

    One event for each neighbour (the default), by agent and then by neighbour: `who`, `dx` and `dy`
    (the way to it), `distance`, and whatever the neighbour shows.

    One event for each agent (`summary`), also for those who are alone: `number` of neighbours, the
    means of `dx`, `dy`, `distance` and whatever they show, and the sums `apart_x` and `apart_y` of
    the ways from those that are nearer than `apart`; means of nobody are 0.

    On a lattice (`grid`) likewise: `number`, `same` (those who show the same value of one name as
    the agent itself), and means of whatever they show.

    Args:
        event: the type of what agents are told.
        draws: the visual event type of the views.
        every: frames from one view to the next. With 1 agents hear in each frame where the others
            were one frame ago; with 2 they look in one frame and move in the next.
        radius: up to this distance somebody is near; on a lattice, cells that the neighbourhood
            reaches.
        width: of a periodic plane, or in cells.
        height: of a periodic plane, or in cells.
        periodic: whether opposite edges are one.
        nearest: at most so many neighbours, the nearest first; 0: all within the radius.
        summary: one event for each agent.
        apart: the distance within which ways apart are summed up; 0: the radius.
        grid: agents are in cells, counted from 0.
        hood: moore or von neumann, the neighbourhood on a lattice.
        same: the name by whose value agents on a lattice are the same.
        x: the name of that coordinate in the view.
        y: the name of that coordinate in the view.
        who: the name of the id in the view.

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
        self.every = every
        self.draws = (draws,)
        self._event = event
        self._radius = radius
        self._size = _plane(width, height, radius) if periodic and not grid else None
        self._nearest = nearest
        self._summary = summary
        self._apart = apart or radius
        self._lattice = Lattice(width, height, radius, hood, periodic) if grid else None
        if not grid:
            tree()  # better missed now than in the first frame
        self._same = same
        self._reader = Reader("neighbours", Names(x, y, who))
        self._told: tuple[AnyEvent, ...] = ()
        self._shown = -1

    def generates(self) -> tuple[str, ...]:
        return (self._event,)

    def joined(self, world: WorldInfo) -> None:
        self._type = event_type("neighbours", world, self._event)
        self._wanted = frozenset(self._type.fields.names)
        self._compare(self._type)

    def show(self, view: View) -> None:
        """Reckon at once, while the others are still at the frame that shows this."""
        spots = self._reader.read(view.scene)
        self._told = self._events(spots) if spots is not None else ()
        self._shown = view.frame

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        return self._told if self._shown == tick.number - 1 else ()

    def _events(self, spots: Spots) -> tuple[AnyEvent, ...]:
        if self._lattice is not None:
            found = counts(spots, self._lattice, self._wanted, self._same)
            return (self._made(spots, spots.ids, found),)
        pairs = near(spots.x, spots.y, self._radius, self._size)
        if self._summary:
            found = summary(spots, pairs, self._wanted, self._apart)
            return (self._made(spots, spots.ids, found),)
        to, found = one_by_one(spots, pairs, self._wanted, self._nearest)
        return (self._made(spots, spots.ids.take(to), found),) if len(to) else ()

    def _made(self, spots: Spots, receivers: Ids, found: Mapping[str, Any]) -> AnyEvent:
        try:
            return self._type(receivers=receivers, **found)
        except MisuseError as error:
            shown = ", ".join(spots.shown)
            raise MisuseError(f"neighbours: {error}; what agents show is {shown}") from None

    def _compare(self, declared: EventType) -> None:
        """Refuse data of other types than what is made of them. Raises MisuseError."""
        means = self._summary or self._lattice is not None
        for one in declared.fields.all:
            made = _KINDS.get(one.name, "real" if means or one.name in _REAL else one.type.kind)
            if one.type.kind not in (made, "real" if made == "int" else made):
                raise MisuseError(
                    f"neighbours: {declared.name} wants {one.name} as {one.type}; neighbours makes"
                    f" {made}"
                )


def _check(every: int, radius: float, hood: str) -> None:
    if every < 1:
        raise MisuseError(f"neighbours: every is {every}; expected a number of frames from 1")
    if radius <= 0:
        raise MisuseError(f"neighbours: radius is {radius}; expected a number above 0")
    if hood not in HOODS:
        raise MisuseError(f"neighbours: hood is {hood!r}; expected {' or '.join(HOODS)}")


def _check_nearest(nearest: int, together: bool) -> None:
    if nearest < 0:
        raise MisuseError(f"neighbours: nearest is {nearest}; expected a number from 0")
    if nearest and together:
        raise MisuseError(
            "neighbours: nearest is for one event for each neighbour; leave it out with summary"
            " and grid"
        )


def _plane(width: float, height: float, radius: float) -> tuple[float, float]:
    """The size of a periodic plane."""
    if min(width, height) <= 2 * radius:
        raise MisuseError(
            f"neighbours: width and height of a periodic plane are {width} and {height}; expected"
            f" numbers above {2 * radius}, twice the radius"
        )
    return width, height
