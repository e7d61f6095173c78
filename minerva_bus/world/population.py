"""Agents of one kind as the population form of λ and θ sees them: attributes are arrays.

    @on("eHunger", population=True)
    def starve(self, hunger, moment):
        self.energy -= hunger.amount
        self.die(self.energy <= 0)

`self` has just the agents that the events concern, each once: its attributes, and the data of
`hunger`, are arrays of shape (n,), a row for each. (A datum is a single value where one event is
for all.) An agent with several events of a frame gets them one after another, in several calls.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.arrays import fit_array, is_array, repeated
from minerva_bus.grammar.batch import Events
from minerva_bus.grammar.columns import Columns, Rows
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.context import Frame, InFrame
from minerva_bus.world.lineage import child_ids
from minerva_bus.world.rng import RngBatch

if TYPE_CHECKING:
    from minerva_bus.world.agent import Agent

Where = NDArray[np.bool_] | bool


@dataclass(frozen=True, slots=True)
class Birth:
    """Newborns of the parents in some rows, in one turn of the frame."""

    rows: Rows
    turn: int
    newborn: Columns


class PopulationState:
    """The working state of a population within a frame: what has become of each row."""

    def __init__(self, part: Columns, fields: Fields, *, lasting: bool = True) -> None:
        self.part = part
        self._lasting = lasting
        self.fields = fields
        self.arrays: dict[str, NDArray[Any]] = {}
        self.away: NDArray[np.bool_] | None = None
        self.born: list[Birth] = []
        self.said: list[tuple[Rows, Events]] = []
        self.turn: int = 0

    def value(self, name: str) -> NDArray[Any]:
        """The values of an attribute, as they are now."""
        array = self.arrays.get(name)
        return self.part.column(name) if array is None else array

    def write(self, name: str, rows: Rows | None, values: Sequence[Any] | NDArray[Any]) -> None:
        """Other values of an attribute in some rows, or in all."""
        if rows is None and len(values) == self.part.count:
            old = self.part.column(name)
            array = np.empty(self.part.count, old.dtype)
            array[:] = values
            self.arrays[name] = array
        else:
            self.array(name)[rows] = values

    def leave(self, rows: Rows | int) -> None:
        """Some are no mere rows any more: dead, or more than a row."""
        if self.away is None:
            self.away = np.zeros(self.part.count, np.bool_)
        self.away[rows] = True

    def array(self, name: str) -> NDArray[Any]:
        """The values of an attribute, to be written to."""
        array = self.arrays.get(name)
        if array is None:
            array = self.part.column(name)
            if self._lasting:  # where nothing lasts nobody has a reason to write
                array = self.arrays[name] = array.copy()
        return array


class Population:
    """Some agents of one kind; see the module."""

    __slots__ = ("_herd", "_kind", "_rows")
    _herd: PopulationState
    _kind: type[Agent]
    _rows: Rows | None

    def __init__(self, herd: PopulationState, kind: type[Agent], rows: Rows | None) -> None:
        object.__setattr__(self, "_herd", herd)
        object.__setattr__(self, "_kind", kind)
        object.__setattr__(self, "_rows", rows)

    def __len__(self) -> int:
        return self._herd.part.count if self._rows is None else len(self._rows)

    @property
    def id(self) -> Ids:
        """The agents' ids."""
        ids = cast("Ids", self._herd.part.ids)
        return ids if self._rows is None else ids.take(self._rows)

    def __getattr__(self, name: str) -> Any:
        herd = self._herd
        if name not in herd.fields.names:
            known = list(herd.fields.names)
            kind = self._kind.kind.name
            if not name.startswith("_") and hasattr(self._kind, name):
                return getattr(self._kind, name).__get__(self)
            raise AttributeError(f"{kind} has no {name}{nearest(name, known)}")
        array = herd.array(name)
        return array if self._rows is None else array[self._rows]

    def __setattr__(self, name: str, value: Any) -> None:
        herd = self._herd
        if name not in herd.fields.names:
            known = list(herd.fields.names)
            if name == "id":
                raise MisuseError(f"{self._kind.kind.name}: an agent keeps its id")
            raise MisuseError(
                f"a population of {self._kind.kind.name} has no {name}; declare it in the"
                f" class{nearest(name, known)}"
            )
        fitted = self._fitted(name, value)
        array = herd.array(name)
        if self._rows is not None:
            array[self._rows] = fitted
        elif fitted is not array:
            array[:] = fitted

    def _fitted(self, name: str, value: Any) -> NDArray[Any]:
        herd = self._herd
        if value is herd.arrays.get(name):
            return value
        count = len(self)
        one = herd.fields.all[herd.fields.names.index(name)]
        try:
            if not is_array(value):
                return repeated(one.type, value, count).array
            if len(value) != count:
                raise Unfit(f"an array of shape ({count},), not ({len(value)},)")
            return fit_array(one.type, value, finite=False).array
        except Unfit as unfit:
            raise MisuseError(f"{self._kind.kind.name}: {name} must be {unfit}") from None

    def die(self, where: Where = True) -> None:
        """The end of the agents where the mask says so; they meet no further event."""
        rows = self._chosen(where)
        if len(rows):
            self._herd.leave(rows)

    def bear(self, where: Where = True, kind: type[Agent] | None = None, **state: Any) -> None:
        """A newborn beside each agent where the mask says so, as `child` of one agent makes it.

        The state may have arrays, of shape (n,) for all agents or with a row for each birth. Raises
        MisuseError.
        """
        herd = self._herd
        fields: Fields = self._kind.kind.fields
        if not any(one.name == "births" and one.type.kind == "int" for one in fields.all):
            raise MisuseError(
                f"{self._kind.kind.name} gives birth: declare `births: int = 0` in its class, so"
                " that its children's ids can be told apart"
            )
        rows = self._chosen(where)
        if not len(rows):
            return
        births = herd.array("births")
        births[rows] += 1
        young = (kind or self._kind).kind
        given = {name: self._picked(value, where, len(rows)) for name, value in state.items()}
        columns = young.fields.columns(young.name, given, len(rows))
        ids = child_ids(cast("Ids", herd.part.ids).take(rows), births[rows])
        newborn = Columns(young.name, young.fields.names, columns, len(rows), ids)
        herd.born.append(Birth(rows, herd.turn, newborn))

    def _picked(self, value: Any, where: Where, count: int) -> Any:
        if is_array(value) and not isinstance(where, bool) and len(value) == len(where) != count:
            return value.take(np.flatnonzero(where)) if isinstance(value, Ids) else value[where]
        return value

    def _chosen(self, where: Where) -> Rows:
        rows = np.arange(len(self)) if self._rows is None else self._rows
        if isinstance(where, bool | np.bool_):
            return rows if where else rows[:0]
        mask = np.asarray(where)
        if mask.dtype != np.bool_ or mask.shape != (len(self),):
            raise MisuseError(
                f"a mask has {len(self)} truths, one for each of these agents, not"
                f" {mask.dtype} {mask.shape}"
            )
        return np.flatnonzero(mask) if self._rows is None else self._rows[mask]


class BatchContext(InFrame):
    """A frame as many agents live it at once."""

    def __init__(
        self, frame: Frame, chances: Callable[[], RngBatch], people: Population, rows: Rows | None
    ) -> None:
        self.frame = frame
        self._chances = chances
        self._people = people
        self._rows = rows

    @property
    def chance(self) -> RngBatch:
        """Draws, one number for each of the agents from its own stream."""
        return self._chances().of(self._rows)

    @property
    def random(self) -> Any:
        """Not for many at once."""
        raise MisuseError(
            "moment.random is one agent's; a population draws from moment.chance, a number for each"
            " (and so may a single agent: the numbers are the same)"
        )

    def emit(self, event: Event | Events, where: Where = True) -> None:
        """Send an event from each agent where the mask says so; they belong to the next frame.

        `eGive(amount=array, receivers=ids)` has a row for each of the agents, or for each sender.
        """
        people = self._people
        rows = people._chosen(where)  # pyright: ignore[reportPrivateUsage]
        herd: PopulationState = people._herd  # pyright: ignore[reportPrivateUsage]
        ids = cast("Ids", herd.part.ids)
        senders = Ids(ids.stem, ids.data[rows])
        if isinstance(event, Event):
            if len(event.receivers) > 1:
                raise MisuseError("an event of a population has one receiver for each, or none")
            sent = replace(Events.repeated(event, len(senders)), senders=senders)
        else:
            many = event
            if many.count == len(people) != len(rows):
                many = many.take(np.flatnonzero(where))
            if many.count != len(rows):
                raise MisuseError(f"{many.count} events from {len(rows)} agents; one from each")
            sent = replace(many, senders=senders)
        if len(rows):
            herd.said.append((rows, sent))


def returns_nothing(result: object) -> None:
    """What an activity of a population has to return. Raises TypeError."""
    if result is not None:
        raise TypeError(
            "an activity of a population returns nothing: self.die(mask), self.bear(mask, ...)"
        )


class EventBatch:
    """Events as a method for populations gets them: their data by name, arrays of shape (n,)."""

    __slots__ = ("_chosen", "_events", "_row")

    def __init__(self, events: Events, row: Rows | None = None, chosen: Rows | None = None) -> None:
        self._events = events
        self._chosen = chosen
        self._row = row

    @property
    def row(self) -> Rows:
        """For each event, which of the agents it is for."""
        return np.arange(self._events.count) if self._row is None else self._row

    @property
    def sender(self) -> Ids | None:
        """Who sent them; None where nobody did."""
        return self._mine().senders

    def __len__(self) -> int:
        return self._events.count if self._chosen is None else len(self._chosen)

    def __getattr__(self, name: str) -> Any:
        if name in self.__slots__:  # not set yet: one that is being copied or unpickled
            raise AttributeError(name)
        events = self._mine()
        if name not in events.names:
            known = ", ".join(events.names) or "no data"
            raise AttributeError(f"{events.type} has no {name}; it has {known}")
        return events.data(name)

    def _mine(self) -> Events:
        if self._chosen is not None:  # not before somebody asks: most ask for little of it
            self._events, self._chosen = self._events.take(self._chosen), None
        return self._events
