"""The accelerator of a class of agents: checked when the class is made, compiled at its first run.

population → columns → kernel (machine code) → changes, newborns, events
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import count
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.columns import Coded, Column, Columns
from minerva_bus.grammar.events import Events
from minerva_bus.grammar.ids import Ids
from minerva_bus.wording import install
from minerva_bus.world.class_declaration import IF_POSSIBLE, Mode, NotCompilable
from minerva_bus.world.context import Frame, FrameStreams
from minerva_bus.world.population import Birth, PopulationState, Turn, child_ids
from minerva_fast.draws import PLACE, new_progress
from minerva_fast.machine_code import Kernel, has_numba, load_kernel
from minerva_fast.methods import FAILED, GONE, cells, checked_methods
from minerva_fast.values import DTYPES, Emission, Method, Newborn, Output, ValueKind


def accelerate(cls: Any, modes: Mapping[str, Mode]) -> tuple[FastAccelerator | None, list[str]]:
    """The accelerator of a class, an entry point of `minerva.accelerators`."""
    chosen: dict[str, Callable[..., Any]] = {}
    reasons: list[str] = []
    if not has_numba() and IF_POSSIBLE in modes.values():
        reasons.append(f"{cls.__name__} runs agent by agent, without numba: {install('fast')}")
        modes = {event: mode for event, mode in modes.items() if mode != IF_POSSIBLE}
    for event_type, mode in modes.items():
        method = {event_type: cls.activities[event_type]}
        if mode == IF_POSSIBLE:
            try:
                checked_methods(cls, method)
            except NotCompilable as error:
                reasons.append(str(error))
                continue
        chosen |= method
    return (FastAccelerator(cls, chosen) if chosen else None), reasons


class FastAccelerator:
    """Runs the compiled methods of an agent class on the rows of a population.

    Constants of the module are part of the machine code. If one of them has changed, the methods
    are checked and compiled again.
    """

    def __init__(self, cls: Any, methods: Mapping[str, Callable[..., Any]]) -> None:
        self._cls = cls
        self.methods = methods
        self._checked = checked_methods(cls, methods)

    def code(self) -> Iterator[tuple[str, Callable[[], object]]]:
        """Titles of the compiled code, each with the function that compiles it."""
        for event_type in sorted(self.methods):
            yield self.checked(event_type).title, partial(self._kernel, event_type)

    def checked(self, event_type: str) -> Method:
        """The checked form of the method for an event type. Raises NotCompilable."""
        if not all(method.current() for method in self._checked.values()):
            self._checked = checked_methods(self._cls, self.methods)
        return self._checked[event_type]

    def _kernel(self, event_type: str) -> tuple[Method, Kernel]:
        """The checked form and the machine code of the method for an event type.

        Raises NotCompilable, and MisuseError without numba.
        """
        method = self.checked(event_type)
        return method, load_kernel(method.text, "compiled methods")

    def run(
        self, turn: Turn, state: PopulationState, streams: FrameStreams, frame: Frame
    ) -> NDArray[np.bool_]:
        """Process a turn; returns a mask of the rows that must run in Python, shape (rows,)."""
        method, kernel = self._kernel(turn.event.type)
        call = KernelCall(method, state, turn)
        # A duration that is an int would give an int, which the kernel does not have.
        if not call.fits or type(frame.dt) is not float:
            return np.ones(len(turn.rows), np.bool_)
        outcomes = call.run(kernel, streams, frame)
        state.turn += 1
        call.store()
        for index, output in enumerate(method.outputs):
            if isinstance(output, Newborn):
                call.bear(index, output, self._cls)
            else:
                call.send(index, output)
        gone = turn.rows[outcomes == GONE]
        if len(gone):
            state.leave(gone)
        return outcomes == FAILED


# --- one call of a kernel ---


class TextCodes:
    """Texts as ints, equal exactly if the texts are; valid during one call of a kernel.

    The code of a text is its first place among all texts so far.
    """

    def __init__(self, texts: Sequence[str]) -> None:
        self._codes: dict[str, int] = {}
        self._parts: list[NDArray[Any]] = []
        self._count = 0
        self.of(np.array(texts, object))

    def of(self, texts: NDArray[Any]) -> NDArray[np.int64]:
        """The codes of an array of texts."""
        # Without a step of Python for each text, which takes three times as long.
        places = map(self._codes.setdefault, texts.tolist(), count(self._count))
        codes = np.fromiter(places, np.int64, len(texts))
        self._parts.append(texts)
        self._count += len(texts)
        return codes

    def texts(self, codes: NDArray[np.int64]) -> NDArray[Any]:
        """The texts of codes, as an array of objects."""
        return self.coded(codes).texts()

    def coded(self, codes: NDArray[np.int64]) -> Coded:
        """The texts of codes, without a Python object for each."""
        self._parts = [np.concatenate(self._parts)]
        return Coded(self._parts[0], codes)


_LEAST_ROWS: Final = 64
_PART: Final = 8
"""If one in so many agents has a turn, texts are coded for all agents."""


class KernelCall:
    """The arrays of one call of a kernel, and what its rows have appended to them."""

    def __init__(self, method: Method, state: PopulationState, turn: Turn) -> None:
        self._method = method
        self.turn = turn
        self.codes = TextCodes([*method.texts])
        self._state = state
        self._texts: dict[str, NDArray[np.int64]] = {}
        self._whole = set[str]()
        self._counts = np.zeros(max(1, len(method.outputs)), np.int64)
        self._outputs = [_columns(output, len(turn.rows)) for output in method.outputs]
        data = self._data()
        self.fits = data is not None
        """Whether the data of the event have the types that its declaration gives them."""
        self._given_data = data or []

    def _data(self) -> list[NDArray[Any]] | None:
        """The data that the method reads; None if they have other types than declared."""
        event, made = self.turn.event, list[NDArray[Any]]()
        for name, kind in self._method.data.items():
            if name not in event.names:
                return None
            if isinstance(event, Events):
                array = event.data(name)
            else:
                array = Column.of([event.values[event.names.index(name)]]).array
            wanted = np.object_ if kind is ValueKind.TEXT else DTYPES[kind]
            if array.dtype != wanted:
                return None
            if kind is ValueKind.TEXT:
                array = self.codes.of(array)
            made.append(self._spread(array))
        return made

    def _spread(self, array: NDArray[Any]) -> NDArray[Any]:
        """An array with an item for each event; an event for all has one, without a copy."""
        if isinstance(self.turn.event, Events):
            return array
        return np.broadcast_to(array, len(self.turn.rows))

    def run(self, kernel: Kernel, streams: FrameStreams, frame: Frame) -> NDArray[np.uint8]:
        """Run all rows; returns their outcomes."""
        rows = self.turn.rows
        outcomes = np.zeros(len(rows), np.uint8)
        words = np.zeros(1, np.uint64)
        if self._method.draws:
            words = streams.draws.batch().words
        method = self._method
        columns = [self._column(name) for name in method.reads]
        progress, saved = new_progress(), np.zeros(len(method.outputs) + 1, np.int64)
        fixed = [
            *(rows, outcomes, self._counts, progress, saved, words),
            *columns,
            *self._given_data,
            *(self._given(name, frame) for name in method.given),
            *method.new_lists(),
        ]
        start = 0
        # The kernel returns early if an output is full, and after long loops, for signals.
        while start < len(rows):
            flat = [array for arrays in self._outputs for array in arrays]
            before = start
            try:
                start = kernel(start, *fixed, *flat)
            except Exception:  # a fault of one row, which is undone
                start = int(progress[PLACE])
                outcomes[start] = FAILED
                self._counts[: len(saved) - 1] = saved[:-1]
                if self._method.draws:
                    words[rows[start]] = saved[-1:].view(np.uint64)[0]
                start += 1
                continue
            if start < len(rows):
                self._enlarge(every=start == before)
        return outcomes

    def _column(self, name: str) -> NDArray[Any]:
        state = self._state
        if state.part.column(name).dtype == np.object_:
            self._texts[name] = self._codes_of(name)
            return self._texts[name]
        return state.array(name) if name in self._method.writes else state.value(name)

    def _codes_of(self, name: str) -> NDArray[np.int64]:
        column = self._state.column(name)
        if column is not None and _PART * len(self.turn.rows) >= self._state.part.count:
            self._whole.add(name)
            return self.codes.of(column.coded.words)[column.coded.codes]
        # Of the rows of this turn only: one event may concern one of many agents.
        return self._in_rows(self.codes.of(self._state.value(name)[self.turn.rows]))

    def _in_rows(self, codes: NDArray[np.int64]) -> NDArray[np.int64]:
        """An array for all agents with these codes in the rows of the turn."""
        made = np.zeros(self._state.part.count, np.int64)
        made[self.turn.rows] = codes
        return made

    def _given(self, name: str, frame: Frame) -> Any:
        if name == "id":
            return self._in_rows(self.codes.of(self._state.ids.take(self.turn.rows).column))
        if name == "sender":
            return self._senders()
        return {"dt": frame.dt, "time": frame.number * frame.dt, "number": frame.number}[name]

    def _senders(self) -> NDArray[Any]:
        event = self.turn.event
        if not isinstance(event, Events):
            return self._spread(self.codes.of(np.array([event.sender], object)))
        if event.senders is None:
            return np.broadcast_to(self.codes.of(np.array([""], object)), event.count)
        return self.codes.of(event.senders.column)

    def _enlarge(self, *, every: bool) -> None:
        """Double the outputs that are half full; `every` one if a single row did not fit."""
        for index, arrays in enumerate(self._outputs):
            if every or 2 * int(self._counts[index]) > len(arrays[0]):
                self._outputs[index] = [np.resize(array, 2 * len(array)) for array in arrays]

    def store(self) -> None:
        """Write changed texts to the population; numbers are in its arrays already."""
        rows = self.turn.rows
        for name in sorted(self._method.writes.keys() & self._texts.keys()):
            codes = self._texts[name]
            if name in self._whole:
                self._state.replace(name, self.codes.coded(codes).used())
            else:
                self._state.write(name, rows, self.codes.texts(codes[rows]))

    def bear(self, index: int, output: Newborn, cls: Any) -> None:
        """Place the newborns of an output in the population; `cls` is the class of the agents."""
        place, births, *values = self._appended(index)
        if not len(place):
            return
        kind = (output.symbol or cls).kind
        parents = self.turn.rows[place]
        given = self._decoded(output, values)
        columns = kind.fields.columns(kind.name, given, len(place))
        ids = child_ids(self._state.ids.take(parents), births)
        newborn = Columns(kind.name, kind.fields.names, columns, len(place), ids)
        self._state.born.append(Birth(parents, self._state.turn, newborn))

    def send(self, index: int, output: Emission) -> None:
        """Send the events of an output from their agents."""
        place, *values = self._appended(index)
        if not len(place):
            return
        rows = self.turn.rows[place]
        given = self._decoded(output, values)
        names = tuple([slot.name for slot in output.slots])
        columns = tuple(Column(given[name]) for name in names)
        receivers = None
        if output.receiver:
            receivers = Ids.of(self.codes.texts(values[-1]).tolist())
        senders = self._state.ids.take(rows)
        events = Events(
            output.event_type,
            names,
            columns,
            len(rows),
            output.condition,
            senders,
            receivers,
        )
        self._state.sent.append((rows, events))

    def _appended(self, index: int) -> list[NDArray[Any]]:
        """What was appended to an output, as arrays that nothing writes to any more."""
        parts = [array[: self._counts[index]] for array in self._outputs[index]]
        for part in parts:
            # Columns of nodes share the memory of read-only arrays, and copy others.
            part.flags.writeable = False
        return parts

    def _decoded(self, output: Output, values: Sequence[NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """The values of an output by name, texts decoded."""
        pairs = zip(output.slots, values, strict=False)
        return {
            slot.name: self.codes.texts(array) if slot.kind is ValueKind.TEXT else array
            for slot, array in pairs
        }


def _columns(output: Output, rows: int) -> list[NDArray[Any]]:
    # Usually few agents have newborns or emit events.
    size = max(_LEAST_ROWS, rows // 8)
    return [np.empty(size, DTYPES[kind]) for _, kind in cells(output)]
