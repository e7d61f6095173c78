"""η of agents in columns (equation 3), computed for all agents at once.

The results are those of an `AgentStep` per agent. Methods for populations run on arrays; methods
for one agent run for one row after another, on the objects of a `RowAdapter`. The rows, newborns
and agents that have left them are then assembled to a string.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import groupby, repeat
from operator import is_, itemgetter, methodcaller
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MinervaError, MisuseError, StateError
from minerva_bus.grammar.columns import Column, Columns, Rows, bits, packed, shape_of
from minerva_bus.grammar.condition import holds_of_many
from minerva_bus.grammar.events import AnyEvent, Event, Events, as_batch, first_of
from minerva_bus.grammar.ids import RowDelta
from minerva_bus.grammar.scene import EMPTY, AgentNode, Piece, Scene
from minerva_bus.grammar.types import Type
from minerva_bus.world.agent import ActivityError, Agent, Kinds
from minerva_bus.world.agent_evolution import AgentStep, at_fault
from minerva_bus.world.class_declaration import TOGETHER
from minerva_bus.world.context import BatchContext, Context, Frame, FrameStreams
from minerva_bus.world.event_collection import Addressed, Round, narrowed, rounds
from minerva_bus.world.population import (
    Birth,
    EventBatch,
    Population,
    PopulationState,
    Sent,
    Turn,
    joined,
    returns_nothing,
)

_TYPES: Final[dict[str, tuple[type, Any]]] = {
    "real": (float, np.float64),
    "int": (int, np.int64),
    "bool": (bool, np.bool_),
    "text": (str, object),
}
_OWN = 3  # id, scope and _node beside the state


class RowAdapter:
    """Agent objects for the rows of a population, created on first use.

    They are cached from frame to frame with the columns that they have become, because creating
    them takes longer than most methods. The cache is dropped when the columns change otherwise.
    """

    def __init__(self, cls: type[Agent], state: PopulationState) -> None:
        self._cls = cls
        self._state = state
        self._made: dict[int, Agent] = {}
        self._all: list[Agent] | None = None
        self._kept, self._texts = _taken(state.part, cls)
        self.at_fault = 0
        """The row of the agent with an invalid state."""

    def agents(self, rows: Rows | None) -> Sequence[Agent]:
        """The agents in these rows, or in all."""
        if rows is None:
            if self._all is None:
                self._all = self._every()
                self._made = {}
            return self._all
        wanted = cast("list[int]", rows.tolist())
        if self._all is not None:
            return [self._all[row] for row in wanted]
        missing = [row for row in wanted if row not in self._made]
        self._made.update(zip(missing, self._missing(missing), strict=True))
        return [self._made[row] for row in wanted]

    def _every(self) -> list[Agent]:
        every = self._kept or self._thawed(None)
        for row, agent in self._made.items():
            every[row] = agent
        return every

    def _missing(self, rows: list[int]) -> list[Agent]:
        if self._kept is not None:
            return [self._kept[row] for row in rows]
        return self._thawed(np.array(rows, np.intp)) if rows else []

    def _thawed(self, rows: Rows | None) -> list[Agent]:
        state, cls = self._state, self._cls
        names = (*state.fields.names, "id", "scope", "_node")
        chosen = slice(None) if rows is None else rows
        columns = [state.value(name)[chosen].tolist() for name in state.fields.names]
        columns.append(self._ids(rows))
        # Without `__init__`, whose checks the columns have passed, and with all attributes in one
        # update.
        made: list[Agent] = []
        new = cls.__new__
        for values in zip(*columns, strict=True):
            agent = new(cls)
            agent.__dict__.update(zip(names, (*values, EMPTY, None), strict=True))
            made.append(agent)
        return made

    def _ids(self, rows: Rows | None) -> list[str]:
        if rows is not None:
            return self._state.ids.take(rows).texts()
        if self._texts is None:
            self._texts = self._state.ids.texts()
        return self._texts

    def drop(self, row: int) -> None:
        """Drop an agent that has left the arrays."""
        if self._all is not None:
            # The list stands for all rows; without one of them the agents are looked up by row.
            self._made = dict(enumerate(self._all))
            self._all = None
        self._kept = None
        del self._made[row]

    def forget(self) -> None:
        """Drop all agents, because their rows are about to change."""
        self._made, self._all, self._kept = {}, None, None

    def keep(self, part: Columns) -> None:
        """Cache all agents with the columns that they are at the end of the frame."""
        every = self._all or self._kept
        # With births or deaths the rows are other agents than those of the list.
        if every is not None and part.columns and part.ids is self._state.ids:
            ids = self._ids(None)
            part.columns[0].kept = self._cls, self._state.ids, part.columns[1:], every, ids

    def settle(self) -> list[tuple[int, Agent]]:
        """Write the agents' states to the arrays; returns the agents that now have a scope.

        Raises MisuseError if an attribute has a value of a wrong type; `at_fault` is its row.
        """
        agents = self._all if self._all is not None else list(self._made.values())
        if not agents:
            return []
        rows = None if self._all is not None else list(self._made)
        at = None if rows is None else np.array(rows, np.intp)
        # The checks below are loops in C over all agents. Any irregularity leads to `freeze`, which
        # checks one agent after another and names the fault.
        states = [agent.__dict__ for agent in agents]
        self._check_ids(at, states)
        # With the declared number of entries, and each name found by `_usual`, no attribute was
        # added or deleted.
        usual = set(map(len, states)) == {len(self._state.fields.names) + _OWN}
        arrays = self._usual(states) if usual else None
        grown = self._grown(rows, agents, states)
        if arrays is None:
            arrays = self._checked(rows, agents)
        for name, values in zip(self._state.fields.names, arrays, strict=True):
            self._state.write(name, at, values)
        return grown

    def _check_ids(self, rows: Rows | None, states: list[dict[str, Any]]) -> None:
        """Raise StateError if an agent has changed its id."""
        ids = self._ids(rows)
        if list(map(_id, states)) == ids:
            return
        for place, (agent_id, state) in enumerate(zip(ids, states, strict=True)):
            if _id(state) != agent_id:
                self.at_fault = place if rows is None else int(rows[place])
                raise StateError(
                    f"an agent keeps its id; #{agent_id} cannot become #{_id(state)}", "id"
                )

    def _grown(
        self, rows: list[int] | None, agents: list[Agent], states: list[dict[str, Any]]
    ) -> list[tuple[int, Agent]]:
        # Columns hold agents without scopes.
        if all(map(is_, map(_scope, states), repeat(EMPTY))):
            return []
        every = enumerate(agents) if rows is None else zip(rows, agents, strict=True)
        return [(row, agent) for row, agent in every if agent.freeze().scope.pieces]

    def _usual(self, states: list[dict[str, Any]]) -> list[NDArray[Any]] | None:
        """The values of each attribute; None unless all have exactly the declared type."""
        arrays: list[NDArray[Any]] = []
        for field in self._state.fields.all:
            kind, dtype = _TYPES[field.type.kind]
            try:
                values = list(map(itemgetter(field.name), states))
                # Exact types: a bool is an int, and an int in a real attribute must become a float
                # first.
                if set(map(type, values)) != {kind}:
                    return None
                array = np.array(values, dtype)
            # A deleted attribute, or an int of more than 64 bits.
            except (KeyError, OverflowError):
                return None
            if kind is float and not np.isfinite(array).all():
                return None
            if not _within(field.type, array, values):
                return None
            arrays.append(array)
        return arrays

    def _checked(self, rows: list[int] | None, agents: list[Agent]) -> list[Sequence[Any]]:
        values: list[tuple[Any, ...]] = []
        for place, agent in enumerate(agents):
            self.at_fault = place if rows is None else rows[place]
            values.append(agent.freeze().values)
        self.forget()  # temporary attributes, with names that begin with _, end here
        return list(zip(*values, strict=True))


def _within(declared: Type, array: NDArray[Any], values: Sequence[Any]) -> bool:
    """Whether values of the right Python type are words of their type, or in its range."""
    if declared.words:
        return {*values} <= {*declared.words}
    # If the extremes are in the range, all values are.
    return declared.range is None or all(
        map(declared.range.holds, (array.min().item(), array.max().item()))
    )


_id = methodcaller("get", "id")
_scope = methodcaller("get", "scope")


def _taken(part: Columns, cls: type[Agent]) -> tuple[list[Agent] | None, list[str] | None]:
    """The agents cached with these columns, and their ids; clears the cache."""
    kept = part.columns[0].kept if part.columns else None
    if kept is None:
        return None, None
    part.columns[0].kept = None  # agents are mutable, so two evolutions must not share them
    kind, ids, others, agents, names = kept
    if kind is cls and ids is part.ids and all(map(is_, others, part.columns[1:])):
        return agents, names
    return None, None


Activity = Callable[..., Any]


class PopulationStep:
    """Agents in columns processing their events within a frame.

    `_state` has the arrays. `_adapter` has rows as agent objects, for methods for one agent. An
    agent whose method returns a string leaves the arrays and continues as one of `_steps`: it may
    become several agents, none, or one of another kind.
    """

    def __init__(self, part: Columns, kinds: Kinds, frame: Frame) -> None:
        self._kinds = kinds
        self._frame = frame
        self._cls = kinds[part.symbol]
        self._state = PopulationState(part, self._cls.kind.fields)
        self._ids = self._state.ids
        self._streams = FrameStreams(self._ids, frame)
        self._probabilities = dict(self._cls.kind.chances)
        self._adapter = RowAdapter(self._cls, self._state)
        self._steps: dict[int, AgentStep] = {}
        self._ran: list[tuple[Activity, AnyEvent]] = []
        # Rows whose state is in agent objects: any after a method that is not compiled, and those
        # of `_in_python`, which a compiled method has left to Python until the end of the frame.
        self._in_objects = False
        self._in_python = np.zeros(0, np.bool_)

    def process(self, addressed: Addressed) -> None:
        """Process a frame's events. Raises ActivityError."""
        for event_type, group in groupby(addressed.events, lambda event: event.type):
            # Agents that have left the arrays may have become another kind, which responds to other
            # types.
            if event_type not in self._cls.activities and not self._steps:
                continue
            population = self._cls.population.get(event_type)
            activity = self._cls.activities.get(event_type)
            if population is not None and getattr(population, TOGETHER, False):
                self._run_together(population, list(group))
            elif activity is not None and event_type in self._cls.batches:
                self._run_batches(activity, list(group))
            else:
                self._run_in_rounds(event_type, group)

    def _run_in_rounds(self, event_type: str, items: Iterable[AnyEvent]) -> None:
        population = self._cls.population.get(event_type)
        activity = self._cls.activities.get(event_type)
        for event, rows in self._rounds(items):
            if population is not None:
                given = EventBatch(event) if isinstance(event, Events) else event
                self._run_population(population, given, event, rows)
            elif activity is not None and self._is_compiled(event_type):
                self._run_compiled(activity, event, rows)
            elif activity is not None:
                self._run_rows(activity, event, rows)
                self._in_objects = True

    # --- which agents an event concerns ---

    def _rounds(self, items: Iterable[AnyEvent], *, at_once: bool = False) -> Iterator[Round]:
        """Batches for the agents in the arrays; the others process their events here.

        With `at_once` a row may occur several times in a batch.
        """
        for item in items:
            # A probability takes a draw per event, and a batch of draws has each row once.
            once = not at_once or self._steps or item.type in self._probabilities
            for event, rows in rounds(item, self._ids, at_once=not once):
                if self._steps:
                    self._continue_steps(event, rows)
                # Computed for each round: an earlier round may have removed agents.
                keep = None if self._state.away is None else ~self._state.away
                if item.condition:
                    keep = self._willing(event, keep)
                left = (event, rows) if keep is None else narrowed(event, rows, keep)
                if left is not None and item.type in self._probabilities:
                    left = self._answering(*left)
                if left is not None:
                    yield left

    def _answering(self, event: AnyEvent, rows: Rows | None) -> Round | None:
        """The part of a round whose receivers respond, for a type with a probability."""
        probability: Any = self._probabilities[event.type]
        if isinstance(probability, str):
            # The attribute with the probability may have been changed by a method for one agent.
            self._settle(event)
            values = self._state.value(probability)
            probability = values if rows is None else values[rows]
        answers = self._streams.answers(event.type).batch(rows).chance(probability)
        keep = np.ones(len(self._ids), np.bool_)
        # Rows outside the round stay true; `narrowed` looks at the round's own rows only.
        keep[slice(None) if rows is None else rows] = answers
        return narrowed(event, rows, keep)

    def _willing(self, event: AnyEvent, keep: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
        """The agents for which the condition of an event holds, as a mask."""
        self._settle(event)
        values = {name: self._state.value(name) for name in self._state.fields.names}
        willing = holds_of_many(event.condition, values, len(self._ids))
        return willing if keep is None else willing & keep

    def _continue_steps(self, event: AnyEvent, rows: Rows | None) -> None:
        """Process a round for the agents that have left the arrays."""
        places = None if rows is None else {row: place for place, row in enumerate(rows.tolist())}
        for row, step in self._steps.items():
            cls = self._kinds.get(step.symbol)
            if cls is None or event.type not in cls.activities:
                continue
            if places is None or row in places:
                place = places[row] if places is not None else 0
                step.process_event(event if isinstance(event, Event) else event.event(place))

    # --- methods for populations ---

    def _run_together(self, activity: Activity, items: Sequence[AnyEvent]) -> None:
        """Pass all events of a type to a method for populations, in one call."""
        events, row, chosen = self._batch(items)
        if not len(row):
            return
        there = np.zeros(len(self._ids), np.bool_)
        there[row] = True
        concerned = None if there.all() else np.flatnonzero(there)
        if concerned is not None:
            # A method sees its own agents only, so `event.row` counts among these, not among all.
            place = np.empty(len(self._ids), np.intp)
            place[concerned] = np.arange(len(concerned))
            row = place[row]
        # An error names one event; taking all of them for it would copy every column.
        shown = events if chosen is None else events.take(chosen[:1])
        self._run_population(activity, EventBatch(events, row, chosen), shown, concerned)

    def _batch(self, items: Sequence[AnyEvent]) -> tuple[Events, Rows, Rows | None]:
        """Events of one type, the row of each receiver, and which of the events to take."""
        first = items[0]
        # A single batch without condition or probability is passed on as it is; its columns are
        # selected only when the method reads them.
        simple = len(items) == 1 and not self._steps and self._state.away is None
        simple &= first.type not in self._probabilities
        if simple and isinstance(first, Events) and first.receivers and not first.condition:
            rows = self._ids.rows_of(first.receivers)
            chosen = np.flatnonzero(rows >= 0)
            if len(chosen) == len(rows):
                return first, rows, None
            return first, rows[chosen], chosen
        left = list(self._rounds(items, at_once=True))
        if not left:
            return Events(first.type, (), (), 0), np.empty(0, np.intp), None
        everyone = np.arange(len(self._ids))
        receiving = [everyone if rows is None else rows for _, rows in left]
        parts = [
            as_batch(event, len(rows)) for (event, _), rows in zip(left, receiving, strict=True)
        ]
        events = joined(parts)
        if events is None:
            raise MisuseError(f"events {first.type} have different forms and cannot be one batch")
        return events, np.concatenate(receiving), None

    def _run_population(
        self, activity: Activity, given: Any, event: AnyEvent, rows: Rows | None
    ) -> None:
        if rows is not None and len(rows) == len(self._ids):
            rows = None  # each row occurs once, so these are all rows in order
        self._settle(event)
        # The method writes to the arrays, so agent objects made of them would be out of date.
        self._adapter.forget()
        self._state.turn += 1
        population = Population(self._state, self._cls, rows)
        context = BatchContext(self._frame, self._streams.draws, population, rows)
        self._ran.append((activity, event))
        try:
            returns_nothing(activity(population, given, context))
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            row = 0 if rows is None else int(rows[0])
            raise self._failed(activity, row, event) from error

    # --- methods for one agent ---

    def _run_rows(self, activity: Activity, item: AnyEvent, rows: Rows | None) -> None:
        count = len(self._ids) if rows is None else len(rows)
        events = list(item) if isinstance(item, Events) else [item] * count
        self._run_each(activity, item, rows, events, events)

    def _run_batches(self, activity: Activity, items: Sequence[AnyEvent]) -> None:
        """Pass each agent all its events of a type, in one call per agent."""
        events, row, chosen = self._batch(items)
        if not len(row):
            return
        if chosen is not None:
            events = events.take(chosen)
        # Stable, because each agent gets its events in their order.
        order = np.argsort(row, kind="stable")
        rows, begins = np.unique(row[order], return_index=True)
        ends = np.append(begins[1:], len(order))
        keep = np.ones(len(rows), np.bool_)
        if self._is_compiled(events.type):
            events, order = events.take(order), np.arange(len(order))
            keep = self._compiled_rows(Turn(events, rows, begins, ends))
            self._ran.append((activity, events))
        else:
            self._in_objects = True
        parts = [
            events.take(order[begin:end])
            for begin, end in zip(begins[keep].tolist(), ends[keep].tolist(), strict=True)
        ]
        batches = [EventBatch(part, np.zeros(part.count, np.intp)) for part in parts]
        firsts = [part.event(0) for part in parts]
        if parts:
            self._run_each(activity, events, rows[keep], firsts, batches)

    # --- compiled methods for one agent ---

    def _is_compiled(self, event_type: str) -> bool:
        accelerator = self._cls.accelerator
        return accelerator is not None and event_type in accelerator.methods

    def _run_compiled(self, activity: Activity, event: AnyEvent, rows: Rows | None) -> None:
        """Run a method as machine code, and in Python for the rows that the code leaves to it."""
        chosen = np.arange(len(self._ids)) if rows is None else rows
        left = self._compiled_rows(Turn(event, chosen))
        self._ran.append((activity, event))
        if left.any():
            rest = event.take(np.flatnonzero(left)) if isinstance(event, Events) else event
            self._run_rows(activity, rest, chosen[left])

    def _compiled_rows(self, turn: Turn) -> NDArray[np.bool_]:
        """Which rows of a turn must run in Python, after the compiled method of its type has run.

        A row stays in Python until the end of the frame: its state may be one that columns cannot
        hold, which is an error only if it lasts.
        """
        assert self._cls.accelerator is not None
        if self._in_objects:
            self._settle(turn.event)
            self._in_objects, self._in_python = False, np.zeros(0, np.bool_)
        if not self._in_python.any():
            self._adapter.forget()
            self._in_python = np.zeros(len(self._ids), np.bool_)
        left = self._in_python[turn.rows]
        fast = np.flatnonzero(~left)
        if len(fast):
            faults = self._cls.accelerator.run(
                turn.take(fast), self._state, self._streams, self._frame
            )
            left[fast[faults]] = True
        self._in_python[turn.rows[left]] = True
        return left

    def _run_each(
        self,
        activity: Activity,
        item: AnyEvent,
        rows: Rows | None,
        events: Sequence[Event],
        arguments: Sequence[Event | EventBatch],
    ) -> None:
        """Run a method for one agent after another.

        For each agent there is the event that an error would name, and the method's argument.
        """
        agents = self._adapter.agents(rows)
        chosen = range(len(agents)) if rows is None else rows.tolist()
        returned: list[tuple[int, Agent, Any, Event]] = []
        context = Context(self._frame, "", streams=self._streams)
        row, event = 0, first_of(item)
        self._ran.append((activity, item))
        try:
            for row, agent, event, given in zip(chosen, agents, events, arguments, strict=True):
                # One context for all rows: creating one per agent takes longer than most methods.
                context.row, context.who = row, "#" + agent.id
                result = activity(agent, given, context)
                if context.emitted:
                    self._state.sent += [(row, sent) for sent in context.emitted]
                    context.emitted = []
                if result is not None:
                    returned.append((row, agent, result, event))
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise self._failed(activity, row, event) from error
        # Outside the `try`, because `_let_go` raises ActivityError itself.
        for row, agent, result, event in returned:
            self._let_go(row, agent, activity, result, event)

    def _let_go(
        self, row: int, agent: Agent, activity: Activity, result: Any, event: Event
    ) -> None:
        """Move an agent from the arrays to an `AgentStep`, because it is no longer one row."""
        context = Context(self._frame, "#" + agent.id, streams=self._streams, row=row)
        step = AgentStep(self._node(row), self._kinds, context, agent)
        step.returned(activity, result, event)
        self._steps[row] = step
        self._state.leave(row)
        self._adapter.drop(row)

    def _settle(self, event: AnyEvent) -> None:
        """Write the states of agent objects to the arrays, for methods and conditions on arrays."""
        try:
            grown = self._adapter.settle()
        except MinervaError as error:
            raise self._unsound(self._adapter.at_fault, event, error) from error
        for row, agent in grown:
            self._let_go(row, agent, self._ran[-1][0], agent.string, first_of(event))

    # --- the end of the frame ---

    def end(self, event: AnyEvent) -> tuple[Scene, tuple[AnyEvent, ...]]:
        """The string of the agents after the frame, and the emitted events by type."""
        self._settle(event)
        steps = sorted(self._steps.items())
        for row, step in steps:  # after the events that it sent as a row
            self._state.sent += [(row, sent) for sent in step.context.emitted]
        try:
            scene = assembled(self._state, {row: step.string for row, step in steps})
        except Unsound as error:
            raise self._unsound(error.row, event, error) from error
        piece = scene.pieces[0] if len(scene.pieces) == 1 else None
        if piece is not None and piece.ids is not None:
            self._adapter.keep(piece)
        return scene, emissions(self._state.sent)

    def _node(self, row: int) -> AgentNode:
        return cast("AgentNode", self._state.part.node(row))

    def _unsound(self, row: int, event: AnyEvent, error: MinervaError) -> ActivityError:
        """The error of an invalid state, with the activity that probably caused it."""
        ran = [(activity, first_of(item)) for activity, item in self._ran]
        activity, cause = at_fault(ran, first_of(event), error)
        return self._failed(activity, row, cause)

    def _failed(self, activity: Activity | None, row: int, event: AnyEvent) -> ActivityError:
        return ActivityError(activity, self._node(row), first_of(event), self._frame.number)


def evolve_population(
    part: Columns, addressed: Addressed, kinds: Kinds, frame: Frame
) -> tuple[Scene, tuple[AnyEvent, ...]]:
    """η of agents in columns, and the events that they emitted. Raises ActivityError."""
    cls = kinds[part.symbol]
    # The same columns are returned, so the digest and the views of these agents remain valid.
    if not addressed.types & cls.activities.keys():
        return Scene((part,)), ()
    step = PopulationStep(part, kinds, frame)
    step.process(addressed)
    return step.end(addressed.events[-1])


_FEW_CHANGED = 0.25
"""Up to this part, changed values are put into the old column, which keeps its digests."""

_OF_DTYPE: Final[dict[str, type]] = {"f": float, "i": int, "b": bool, "O": str}
"""The type of a column's values, by the kind of its dtype."""


class Unsound(StateError):
    """An attribute of the agent in `row` is not finite."""

    def __init__(self, name: str, row: int, value: float) -> None:
        super().__init__(f"{name} must be a finite number, not {value}", name)
        self.row = row


def assembled(state: PopulationState, lives: Mapping[int, Scene]) -> Scene:
    """The string of the remaining rows, with newborns after their parents.

    `lives` has the strings of the agents that have left the arrays, by row.
    """
    lives = _unlike(state, lives)
    part = _changed(state)
    if (state.away is None or not state.away.any()) and not state.born:
        return Scene((part,))
    if not lives and all(birth.newborn.symbol == part.symbol for birth in state.born):
        return _in_columns(part, state)
    return packed(_in_pieces(part, state, lives))


def _unlike(state: PopulationState, lives: Mapping[int, Scene]) -> Mapping[int, Scene]:
    """The strings that are not rows of the population; the others are written to `state`.

    A string between the rows would split the columns, and a host sends split columns as a whole.
    """
    unlike: dict[int, Scene] = {}
    staying: dict[int, AgentNode] = {}
    young: list[tuple[int, AgentNode]] = []
    for row, scene in lives.items():
        nodes = _like_rows(scene, state.part)
        own = nodes is not None and bool(nodes) and nodes[0].id == state.ids[row]
        # A newborn before its parent has no place among the newborns of a row.
        if nodes is None or (not own and any(node.id == state.ids[row] for node in nodes)):
            unlike[row] = scene
            continue
        if own:
            staying[row] = nodes[0]
        young += [(row, node) for node in nodes[own:]]
    if staying:
        _keep_rows(state, staying)
    if young:
        newborn = Columns.of([node for _, node in young])
        rows = np.array([row for row, _ in young], np.intp)
        # The last turn of the frame: these newborns are the closest to their parents.
        state.born.append(Birth(rows, state.turn + 1, newborn))
    return unlike


def _like_rows(scene: Scene, part: Columns) -> list[AgentNode] | None:
    """The nodes of a string if all of them could be rows of these columns."""
    types = [_OF_DTYPE[column.dtype.kind] for column in part.columns]
    nodes: list[AgentNode] = []
    for node in scene.nodes:
        if not isinstance(node, AgentNode) or shape_of(node) != part.shape:
            return None
        # numpy would convert a value of another type.
        if list(map(type, node.values)) != types:
            return None
        nodes.append(node)
    return nodes


def _keep_rows(state: PopulationState, staying: Mapping[int, AgentNode]) -> None:
    """Return agents to their rows with their present values."""
    rows = np.array([*staying], np.intp)
    columns = Columns.of([*staying.values()]).columns
    for name, column in zip(state.part.names, columns, strict=True):
        # An attribute that has not changed keeps its column.
        if (bits(state.value(name)[rows]) != bits(column.array)).any():
            state.write(name, rows, column.array)
    if state.away is not None:
        state.away[rows] = False


def _changed(state: PopulationState) -> Columns:
    part = state.part
    columns = [
        _column(state, name, old) for name, old in zip(part.names, part.columns, strict=True)
    ]
    # The same object again: whatever compares by identity finds that nothing has changed.
    if all(new is old for new, old in zip(columns, part.columns, strict=True)):
        return part
    return part.with_columns(columns)


def _column(state: PopulationState, name: str, old: Column) -> Column:
    column = state.column(name)
    if column is old:
        return old
    if column is None:
        _check_finite(state, name, state.arrays[name])
        column = Column(state.arrays[name])
    # Rows will move, which changes every column, so a comparison would show nothing.
    if state.away is not None or state.born:
        return column
    rows = old.differs(column)
    if rows is None or len(rows) >= _FEW_CHANGED * len(column):
        return column
    return old.changed(rows, column) if len(rows) else old


def _check_finite(state: PopulationState, name: str, array: NDArray[Any]) -> None:
    """Raise Unsound for an agent with a number that is not finite, unless it is dead."""
    if array.dtype != np.float64 or np.isfinite(array).all():
        return
    wrong = ~np.isfinite(array) if state.away is None else ~np.isfinite(array) & ~state.away
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise Unsound(name, row, float(array[row]))


def _in_columns(part: Columns, state: PopulationState) -> Scene:
    stays = np.ones(part.count, np.bool_) if state.away is None else ~state.away
    gone = np.flatnonzero(~stays)
    if not state.born:
        row_delta, newborn = RowDelta(part.count, gone, np.empty(0, np.intp)), None
    else:
        # A single agent returns `self.string + child`, so a later newborn stands before an earlier
        # one. The sort by parents is stable and keeps that order.
        births = sorted(state.born, key=_later_first)
        parents = np.concatenate([birth.rows for birth in births])
        order = np.argsort(parents, kind="stable")
        # A newborn's row: the remaining agents up to its parent, and the newborns before it.
        ahead = np.cumsum(stays)[parents[order]]
        row_delta = RowDelta(part.count, gone, ahead + np.arange(len(order)))
        newborn = Columns.concatenated([birth.newborn for birth in births]).take(order)
    return Scene((part.updated(row_delta, newborn),)) if row_delta.after else EMPTY


def _later_first(birth: Birth) -> int:
    """Sort key: newborns of a later event are closer to their parent."""
    return -birth.turn


def _in_pieces(part: Columns, state: PopulationState, lives: Mapping[int, Scene]) -> Scene:
    made: list[Piece] = []
    young: dict[int, list[Piece]] = {}
    for birth in sorted(state.born, key=_later_first):
        for row, node in zip(birth.rows.tolist(), birth.newborn.nodes(), strict=True):
            young.setdefault(row, []).append(node)
    away = set(np.flatnonzero(state.away).tolist()) if state.away is not None else set[int]()
    begin = 0
    for row in sorted(away | young.keys()):
        # A parent that stays belongs to the piece before its newborns; one that has left does not.
        end = row if row in away else row + 1
        if end > begin:
            made.append(part.take(slice(begin, end)))
        if row in lives:
            made += lives[row].pieces
        made += young.get(row, ())
        begin = row + 1
    if begin < part.count:
        made.append(part.take(slice(begin, part.count)))
    return Scene(tuple(made)) if made else EMPTY


def emissions(sent: Iterable[Sent]) -> tuple[AnyEvent, ...]:
    """Emitted events by type, in the order of their senders' rows and then of emission."""
    by_type: dict[str, list[Sent]] = {}
    for rows, event in sent:
        by_type.setdefault(event.type, []).append((rows, event))
    return tuple([e for event_type in sorted(by_type) for e in _ordered(by_type[event_type])])


def _ordered(sent: Sequence[Sent]) -> Sequence[AnyEvent]:
    batches = [event for _, event in sent if isinstance(event, Events)]
    batch = Events.concatenated(batches) if len(batches) == len(sent) else None
    if batch is None:
        pairs: list[tuple[int, Event]] = []
        for rows, event in sent:
            pairs += zip([rows] if isinstance(rows, int) else rows.tolist(), event, strict=True)
        events = [event for _, event in sorted(pairs, key=itemgetter(0))]
        batch = Events.of(events)
        return events if batch is None else [batch]
    every = np.concatenate([rows for rows, _ in sent])  # pyright: ignore[reportArgumentType, reportCallIssue]
    # Several methods have sent events of this type; a stable sort keeps the order of each sender.
    if (every[1:] < every[:-1]).any():
        return [batch.take(np.argsort(every, kind="stable"))]
    return [batch]
