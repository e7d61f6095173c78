"""Agents of one kind in the population form of λ and θ: their attributes are arrays.

    @on("eHunger", population=True)
    def starve(self, hunger, moment):
        self.energy -= hunger.amount
        self.die(self.energy <= 0)

`self` has the agents that the events concern, each once. Its attributes and the data of `hunger`
are arrays of shape (n,) with a row per agent; data are single values if one event is for all. An
agent with several events in a frame processes them in several calls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.column import Coded, Column, fit_array, is_array, repeated
from minerva_bus.grammar.columns import Columns, Rows
from minerva_bus.grammar.conversion import Unfit
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.lineage import check_births, child_ids

if TYPE_CHECKING:
    from minerva_bus.world.agent import Agent

Mask: TypeAlias = NDArray[np.bool_] | bool


Emitted: TypeAlias = Events | Sequence[Event]
"""Events of one type, one for each row; single ones if they have several receivers."""


@dataclass(frozen=True, slots=True)
class Birth:
    """Newborns of the parents in `rows`, in one turn of the frame."""

    rows: Rows
    turn: int
    newborn: Columns


class PopulationState:
    """Working state of a population within a frame: arrays, deaths, births and sent events.

    An attribute is copied from `part`, the agents at the start of the frame, on first access by
    user code. With `lasting=False`, as for views, it is not copied, because views do not write.
    """

    def __init__(self, part: Columns, fields: Fields, *, lasting: bool = True) -> None:
        self.part = part
        self._lasting = lasting
        self.fields = fields
        self.arrays: dict[str, NDArray[Any]] = {}
        self._coded: dict[str, Column] = {}
        self.away: NDArray[np.bool_] | None = None
        """Rows that are no longer in the arrays: dead, or continuing as an `AgentStep`."""
        self.born: list[Birth] = []
        self.sent: list[tuple[Rows, Emitted]] = []
        self.turn: int = 0

    @property
    def ids(self) -> Ids:
        """The agents' ids."""
        return cast("Ids", self.part.ids)

    def value(self, name: str) -> NDArray[Any]:
        """Current values of an attribute, read-only."""
        column = self.column(name)
        return self.arrays[name] if column is None else column.array

    def column(self, name: str) -> Column | None:
        """The column of an attribute; None if it is an array that methods write to."""
        if name in self.arrays:
            return None
        changed = self._coded.get(name)
        return self.part.columns[self.part.names.index(name)] if changed is None else changed

    def replace(self, name: str, texts: Coded) -> None:
        """Set an attribute of all rows to these texts, which remain coded."""
        self.arrays.pop(name, None)
        self._coded[name] = Column.of_coded(texts)

    def write(self, name: str, rows: Rows | None, values: Sequence[Any] | NDArray[Any]) -> None:
        """Set an attribute in these rows, or in all."""
        if rows is None and len(values) == self.part.count:  # without copying the old values
            old = self.part.column(name)
            array = np.empty(self.part.count, old.dtype)
            array[:] = values
            self.arrays[name] = array
        else:
            self.array(name)[rows] = values

    def leave(self, rows: Rows | int) -> None:
        """Take rows out of the arrays."""
        if self.away is None:
            self.away = np.zeros(self.part.count, np.bool_)
        self.away[rows] = True

    def array(self, name: str) -> NDArray[Any]:
        """Values of an attribute, writable."""
        array = self.arrays.get(name)
        if array is None:
            array = self.value(name)
            if self._lasting:
                array = self.arrays[name] = array.copy()
        return array


class Population:
    """The agents in the given rows of a `PopulationState`, or in all; see the module."""

    __slots__ = ("_kind", "_rows", "_state")
    _state: PopulationState
    _kind: type[Agent]
    _rows: Rows | None

    def __init__(self, state: PopulationState, kind: type[Agent], rows: Rows | None) -> None:
        # `__setattr__` of this class writes attributes of agents.
        object.__setattr__(self, "_state", state)
        object.__setattr__(self, "_kind", kind)
        object.__setattr__(self, "_rows", rows)

    def __len__(self) -> int:
        return self._state.part.count if self._rows is None else len(self._rows)

    @property
    def id(self) -> Ids:
        """The agents' ids."""
        ids = self._state.ids
        return ids if self._rows is None else ids.take(self._rows)

    def __getattr__(self, name: str) -> Any:
        names = self._state.fields.names
        if name not in names:
            if not name.startswith("_") and hasattr(self._kind, name):
                # A helper method of the class, bound to the population in place of an agent.
                return getattr(self._kind, name).__get__(self)
            kind = self._kind.kind.name
            raise AttributeError(f"{kind} has no {name}{nearest(name, list(names))}")
        array = self._state.array(name)
        return array if self._rows is None else array[self._rows]

    def __setattr__(self, name: str, value: Any) -> None:
        names, kind = self._state.fields.names, self._kind.kind.name
        if name == "id":
            raise MisuseError(f"{kind}: an agent keeps its id")
        if name not in names:
            raise MisuseError(
                f"a population of {kind} has no {name}; declare it in the class"
                f"{nearest(name, list(names))}"
            )
        fitted = self._fitted(name, value)
        array = self._state.array(name)
        if self._rows is not None:
            array[self._rows] = fitted
        # Otherwise the method has changed the array in place.
        elif fitted is not array:
            array[:] = fitted

    def _fitted(self, name: str, value: Any) -> NDArray[Any]:
        # `self.energy -= x` changes the array in place and assigns that same array again.
        if value is self._state.arrays.get(name):
            return value
        count, fields = len(self), self._state.fields
        declared = fields.all[fields.names.index(name)].type
        try:
            if not is_array(value):
                return repeated(declared, value, count).array
            if len(value) != count:
                raise Unfit(f"an array of shape ({count},), not ({len(value)},)")
            # Not checked for finite numbers here: agents that die in this frame may have any. What
            # remains is checked once, when the columns of the frame are assembled.
            return fit_array(declared, value, finite=False).array
        except Unfit as unfit:
            raise MisuseError(f"{self._kind.kind.name}: {name} must be {unfit}") from None

    def die(self, where: Mask = True) -> None:
        """Remove the agents where the mask is true; they process no further event."""
        rows = self._chosen(where)
        if len(rows):
            self._state.leave(rows)

    def bear(self, where: Mask = True, kind: type[Agent] | None = None, **state: Any) -> None:
        """Place a newborn beside each agent where the mask is true, as `Agent.child` does.

        Values of `state` may be arrays with a row per agent, or per birth. Raises MisuseError.
        """
        check_births(self._kind.kind)
        rows = self._chosen(where)
        if not len(rows):
            return
        births = self._state.array("births")
        # A row occurs once in `rows`; numpy would count repeated ones only once here.
        births[rows] += 1
        young = (kind or self._kind).kind
        given = {name: self._picked(value, where, len(rows)) for name, value in state.items()}
        columns = young.fields.columns(young.name, given, len(rows))
        ids = child_ids(self._state.ids.take(rows), births[rows])
        newborn = Columns(young.name, young.fields.names, columns, len(rows), ids)
        self._state.born.append(Birth(rows, self._state.turn, newborn))

    def _emit(self, event: AnyEvent, where: Mask) -> None:
        """Send an event, or a row of several, from each agent where the mask is true."""
        rows = self._chosen(where)
        senders = self._state.ids.take(rows)
        if isinstance(event, Event):
            if len(event.receivers) > 1:
                raise MisuseError("an event of a population has at most one receiver per agent")
            batch = Events.repeated(event, len(rows))
        else:
            batch = event
            # The batch has a row for each agent, the mask selects some of them.
            if batch.count == len(self) != len(rows):
                batch = batch.take(np.flatnonzero(where))
            if batch.count != len(rows):
                raise MisuseError(
                    f"{batch.count} events from {len(rows)} agents; expected one each"
                )
        if len(rows):
            self._state.sent.append((rows, replace(batch, senders=senders)))

    def _picked(self, value: Any, where: Mask, count: int) -> Any:
        if is_array(value) and not isinstance(where, bool) and len(value) == len(where) != count:
            return value.take(np.flatnonzero(where)) if isinstance(value, Ids) else value[where]
        return value

    def _chosen(self, where: Mask) -> Rows:
        rows = np.arange(len(self)) if self._rows is None else self._rows
        if isinstance(where, bool | np.bool_):
            return rows if where else rows[:0]
        mask = np.asarray(where)
        if mask.dtype != np.bool_ or mask.shape != (len(self),):
            raise MisuseError(
                f"a mask is an array of bool, shape ({len(self)},), not {mask.dtype} {mask.shape}"
            )
        return np.flatnonzero(mask) if self._rows is None else self._rows[mask]


def returns_nothing(result: object) -> None:
    """Raise TypeError if an activity of a population has returned anything but None."""
    if result is not None:
        raise TypeError(
            "an activity of a population returns nothing: self.die(mask), self.bear(mask, ...)"
        )


@dataclass(frozen=True, slots=True)
class Turn:
    """Rows of a population with the events that they process in one call.

    Row k has the event k of the batch, or those from `begins[k]` to `ends[k]`; an event for all has
    one row.
    """

    event: AnyEvent
    rows: Rows
    begins: Rows | None = None
    ends: Rows | None = None

    def take(self, places: Rows) -> Turn:
        """The turn of some of the rows."""
        if len(places) == len(self.rows):
            return self
        if self.begins is not None and self.ends is not None:
            return Turn(self.event, self.rows[places], self.begins[places], self.ends[places])
        event = self.event if isinstance(self.event, Event) else self.event.take(places)
        return Turn(event, self.rows[places])
