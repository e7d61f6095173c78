"""Agents of one kind in the population form of λ and θ: their attributes are arrays.

    @on("eHunger", population=True)
    def starve(self, hunger, moment):
        self.energy -= hunger.amount
        self.die(self.energy <= 0)

`self` has the agents that the events concern, each once. Its attributes and the data of `hunger`
are arrays of shape (n,) with a row per agent; data are single values if one event is for all. An
agent with several events in a frame processes them in several calls, or in one with an
`EventBatch`. A single agent is a population of one.

Ids of newborns and copies derive from other ids, so they are equal wherever a world runs:

    a:3        the third child of #a, by the count in its state
    a:7-2      the second copy of #a that frame 7 makes under the literal policy (equation 3)
    a:7-2-3    #a in the second copy of an agent around it; 3 is its height (see `copy_id`)

The form of the suffix determines the rule, so two rules, parents, frames or copies never give the
same id. An id longer than `LONGEST` is hashed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from hashlib import blake2b
from typing import TYPE_CHECKING, Any, Final, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.columns import Coded, Column, Columns, Rows, fit_array, is_array, repeated
from minerva_bus.grammar.events import AnyEvent, Event, Events, as_batch, chosen
from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.ids import LONGEST, Ids
from minerva_bus.grammar.scene import EMPTY, AgentNode, Scene
from minerva_bus.grammar.types import Unfit
from minerva_bus.grammar.vocabulary import AgentKind
from minerva_bus.values import fast_dataclass
from minerva_bus.world.class_declaration import TOGETHER
from minerva_bus.world.context import Context

if TYPE_CHECKING:
    from minerva_bus.world.agent import Agent


Mask: TypeAlias = NDArray[np.bool_] | bool


Sent: TypeAlias = tuple[Rows | int, AnyEvent]
"""An event and the row of its sender, or a batch with a row for each of its events."""


@fast_dataclass
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
        self.sent: list[Sent] = []
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


@fast_dataclass
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
        return Turn(chosen(self.event, places)[0], self.rows[places])


class EventBatch:
    """n events of one type; data by name are arrays of shape (n,).

    Iterating yields single events, which are created only then. Separate from `Events`, whose own
    attributes (`count`, `columns`) would hide data with these names.
    """

    __slots__ = ("_chosen", "_events", "_row")

    def __init__(self, events: Events, row: Rows | None = None, chosen: Rows | None = None) -> None:
        self._events = events
        self._chosen = chosen
        self._row = row

    @property
    def row(self) -> Rows:
        """The row of each event's receiver, shape (n,)."""
        return np.arange(self._events.count) if self._row is None else self._row

    @property
    def sender(self) -> Ids | None:
        """The senders; None if a generator made the events."""
        return self._selected().senders

    def __len__(self) -> int:
        return self._events.count if self._chosen is None else len(self._chosen)

    def __iter__(self) -> Iterator[Event]:
        return iter(self._selected())

    def __getattr__(self, name: str) -> Any:
        if name in self.__slots__:  # not set yet, as in copy.copy()
            raise AttributeError(name)
        events = self._selected()
        if name not in events.names:
            known = ", ".join(events.names) or "no data"
            raise AttributeError(f"{events.type} has no {name}; it has {known}")
        return events.data(name)

    def _selected(self) -> Events:
        if self._chosen is not None:  # as late as possible: most methods read few columns
            self._events, self._chosen = self._events.take(self._chosen), None
        return self._events


def joined(parts: Sequence[Events]) -> Events | None:
    """Events of one type for known agents, as one batch; None if their forms differ.

    If only a part of them names receivers, the batch names none.
    """
    batch = Events.concatenated(parts)
    if batch is None:
        # The receivers are known here, and single events and batches may name them differently.
        batch = Events.concatenated([replace(part, receivers=None) for part in parts])
    return batch


def merged(items: Sequence[AnyEvent]) -> Sequence[Events]:
    """Events of one type for one agent, in order, as one batch if their forms agree."""
    parts = [as_batch(item) for item in items]
    batch = joined(parts)
    return parts if batch is None else [batch]


Activity = Callable[[Any, Any, Any], Any]


def as_one(activity: Activity) -> Callable[[Any, Event, Context], Scene | None]:
    """λ of one agent from the λ of a population."""
    together: bool = getattr(activity, TOGETHER, False)

    def apply(agent: Agent, event: Event, moment: Context) -> Scene | None:
        state, population = _population_of(agent)
        given = EventBatch(Events.repeated(event, 1)) if together else event
        returns_nothing(activity(population, given, moment.batch(population)))
        for name, array in state.arrays.items():
            # As a Python object: attributes have exactly the types of the language, not those of
            # numpy.
            setattr(agent, name, array.tolist()[0])
        for _, sent in state.sent:
            for each in sent:
                moment.emit(each)
        young = [node for birth in state.born for node in birth.newborn.nodes()]
        # The agent has died; its newborns take its place.
        if state.away is not None:
            return Scene(tuple(young)) if young else EMPTY
        return agent.string + Scene(tuple(young)) if young else None

    apply.__wrapped__ = activity  # type: ignore[attr-defined]
    return apply


def view_as_one(view: Callable[[Any, Any], Any]) -> Callable[[Any, Event], Scene]:
    """θ of one agent from the θ of a population."""

    def apply(agent: Agent, event: Event) -> Scene:
        _, population = _population_of(agent)
        return view(population, event)

    apply.__wrapped__ = view  # type: ignore[attr-defined]
    return apply


def _population_of(agent: Agent) -> tuple[PopulationState, Population]:
    node = agent.freeze()
    # Columns hold agents without scopes, and methods for populations do not access the scope.
    bare = AgentNode(node.symbol, node.id, node.names, node.values)
    state = PopulationState(Columns.of([bare]), agent.kind.fields)
    return state, Population(state, type(agent), None)


MAX_UNUSED: Final = 100
"""Consecutive births without a newborn after which `parents_of` stops comparing hashed ids."""


def check_births(kind: AgentKind) -> None:
    """Check that a kind counts its births, on which ids depend. Raises MisuseError."""
    if not any(field.name == "births" and field.type.kind == "int" for field in kind.fields.all):
        raise MisuseError(
            f"{kind.name} gives birth: declare `births: int = 0` in its class, so that its"
            " children's ids can be told apart"
        )


def child_id(parent: str, births: int) -> str:
    """The id of the child of a birth; hashed if it is too long."""
    return _derived(parent, f"{births}", "")


def parents_of(newborns: Iterable[str], parents: Mapping[str, int]) -> dict[str, str]:
    """The parents of newborns by id; ids that do not derive from any of `parents` are left out.

    `parents` has the number of births of each possible parent before these newborns. A parent need
    not exist any longer.
    """
    lineage, hashed = dict[str, str](), set[str]()
    for newborn in newborns:
        parent, _, _ = newborn.rpartition(":")
        # First, because the text before a hash is the id of an ancestor, which may exist, too.
        if _HASHED_CHILD.search(newborn):
            hashed.add(newborn)
        elif parent in parents:
            lineage[newborn] = parent
    # A hash does not contain the parent's id, so the ids of the next births are compared. Their
    # numbers may have gaps, because a parent need not place each child beside itself.
    birth, unused = 1, 0
    while hashed and unused < MAX_UNUSED:
        ids = {child_id(parent, births + birth): parent for parent, births in parents.items()}
        born = hashed & ids.keys()
        lineage |= {newborn: ids[newborn] for newborn in born}
        hashed -= born
        birth, unused = birth + 1, 0 if born else unused + 1
    return lineage


def copy_id(original: str, frame: int, number: int, height: int = 1) -> str:
    """The id of a copy that a frame makes of an agent; `number` starts at 2.

    `height` is 1 for the agent to which λ is applied. For agents in its scope it is the number of
    nested agents from the copied one inwards, so that copies of an agent differ from those that
    are made with each agent around it.
    """
    mark = f"{frame}-{number}" if height == 1 else f"{frame}-{number}-{height}"
    return _derived(original, mark, f"{frame}")


def newest_copy(ids: Iterable[str]) -> int:
    """The last frame that has made copies with any of these ids; -1 if there are none."""
    return max((int(frame) for agent_id in ids for frame in _COPY.findall(agent_id)), default=-1)


_HASHED_CHILD: Final = re.compile(r":-[0-9a-f]{24}$")
# Hashed ids of copies keep the frame in front of the hash, so that `newest_copy` finds it there.
_COPY: Final = re.compile(r":([0-9]{1,18})-(?:[0-9]+(?:-[0-9]+)?|[0-9a-f]{24})(?=:|$)")


def _derived(source: str, mark: str, before_hash: str) -> str:
    name = f"{source}:{mark}"
    if len(name) <= LONGEST:
        return name
    # 96 bits: a collision would give two agents the same id.
    lineage = blake2b(name.encode(), digest_size=12).hexdigest()
    return f"{source[:16].split(':')[0]}:{before_hash}-{lineage}"


def child_ids(parents: Ids, births: NDArray[np.int64]) -> Ids:
    """The ids of one birth of each parent, equal to `child_id` of each."""
    # 20 bytes hold every 64-bit integer.
    names = np.strings.add(np.strings.add(parents.spelled, b":"), births.astype("S20"))
    longest = int(np.strings.str_len(names).max())
    if longest <= LONGEST:
        return Ids(None, names.astype(f"S{longest}")).sound_like((parents,))
    texts = [child_id(*pair) for pair in zip(parents.texts(), births.tolist(), strict=True)]
    return Ids.of(texts).sound_like((parents,))
