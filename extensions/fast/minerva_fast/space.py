"""Spaces: agents whose state is a lattice or a field with its inhabitants.

    class Meadow(Space, symbol="AMeadow"):
        sheep: Reals
        grass: Cells

        @on("eDay")
        def day(self, day, moment):
            self.run(moment, graze, grow)

The inhabitants are state of the space, in the string like all state: matrices of tables
(`minerva_fast.tables`). λ of the space applies rules to them, each as one compiled function.

The rules that a method names are found in its code, so that they can be compiled before it runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import CodeType, FunctionType, ModuleType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MinervaError, MisuseError, nearest
from minerva_bus.grammar.types import Unfit, to_cells, to_reals
from minerva_bus.world.agent import Agent
from minerva_bus.world.context import Context
from minerva_fast.draws import ALL, PLACE, Draws, Guarded, interpreted, interpreting, new_progress
from minerva_fast.driving import parts_of, run_parts
from minerva_fast.origin import MISSING, lookup
from minerva_fast.places import (
    ROWS,
    SEARCHES,
    UNCOUNTED,
    UNLISTED,
    CellGrid,
    Edges,
    go_to,
    opened_edges,
    random_free,
)
from minerva_fast.rules import BEFORE, SHUFFLED, RuleParameter, SpaceRule, loops_of
from minerva_fast.tables import Matrices, Opened


class Space(Agent):
    """An agent with inhabitants; a subclass declares their tables, and λ calls `run`.

    Attributes:
        width: cells in a row of the lattice, or the extent of the field in x.
        height: rows of cells, or the extent in y.
        periodic: whether opposite edges are connected.
        births: the id of the next newborn; all ids in the space are below.

    """

    width: float = 1.0
    height: float = 1.0
    periodic: bool = False
    births: int = 0

    def run(self, moment: Context, *rules: SpaceRule, **data: float) -> None:
        """Apply rules in turn.

        A rule for which machine code has no result of Python, such as an int of more than 64 bits,
        or no end, runs as Python from that activation on.

        Args:
            moment: the context of λ; all draws continue its stream `chance`.
            rules: functions marked with `rule`.
            data: numbers for parameters of rules, by name.

        Raises:
            MisuseError: a rule has a parameter that neither the space nor `data` has, an attribute
                does not fit, or a rule cannot be compiled.
            IndexError: an index of a rule is not that of a row or cell.
            Exception: others that a rule raises, with the line of the rule in the traceback.

        """
        as_python: dict[int, int] = {}
        while True:
            frame = OpenedSpace(self, moment, rules, data, as_python)
            failed = frame.failure()
            if failed is None:
                frame.close()
                return
            as_python |= [failed]

    @classmethod
    def machine_code(cls) -> Iterator[tuple[str, Callable[[], object]]]:
        """Also the rules that methods of the space name, with the functions that compile them."""
        yield from super().machine_code()
        for loop in loops_of(rules_of(cls)):
            yield f"{loop.name} of {cls.__name__}", loop.prepare


def rules_of(cls: type) -> list[SpaceRule]:
    """The rules that methods of a class refer to, each once.

    By name, as `module.name`, in a tuple or list, or in a function of the same module that a method
    calls. Others are compiled when they first run.
    """
    seen: dict[Any, None] = {}

    def see(value: Any, module: str) -> None:
        match value:
            case SpaceRule():
                seen[value] = None
            case tuple() | list():
                for item in cast("Sequence[Any]", value):
                    see(item, module)
            case FunctionType() if value.__module__ == module and value not in seen:
                seen[value] = None
                for each in _values(value):
                    see(each, module)
            case _:
                pass

    for base in reversed(cls.__mro__):
        for value in vars(base).values():
            see(value, getattr(value, "__module__", ""))
    return [each for each in seen if isinstance(each, SpaceRule)]


def _values(function: FunctionType) -> Iterator[Any]:
    """The objects that a function names, and those of modules that it names."""
    names = list(dict.fromkeys(_names(function.__code__)))
    for name in names:
        value = lookup(function, name)
        if isinstance(value, ModuleType):
            for attribute in names:
                yield getattr(value, attribute, MISSING)
        yield value


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    yield from code.co_freevars
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


@dataclass(slots=True)
class _Started:
    """A rule with the number of rows for which it runs, and the state before it, if it asks.

    `rows` are these rows, if the rule puts them into an order.
    """

    rule: SpaceRule
    count: int
    rows: NDArray[np.int64]
    before: Opened | NDArray[Any] | None


class OpenedSpace:
    """The tables and matrices of a space, opened once for several rules."""

    def __init__(
        self,
        space: Space,
        moment: Context,
        rules: Sequence[SpaceRule],
        data: Mapping[str, float],
        as_python: Mapping[int, int],
    ) -> None:
        """Open a space.

        Args:
            space: the space, which has its former matrices until `close`.
            moment: the context of its method.
            rules: the rules to apply.
            data: numbers for parameters of rules.
            as_python: numbers of rules that run as Python from a place on, with these places.

        """
        self._space = space
        self._rules = rules
        self._chance = moment.chance
        self._data = data
        state = vars(space)
        self._values = {name: state[name] for name in space.kind.fields.names if name in state}
        self._values.update(data)
        self._as_python = as_python
        self._lattice = CellGrid(int(space.width), int(space.height), space.periodic)
        self._births = np.array([space.births])
        self._draws: Draws = np.array([self._chance.word], np.uint64)
        self._tables: dict[str, Opened] = {}
        self._edges: dict[str, Edges] = {}
        self._progress = new_progress()
        self._matrices = Matrices(space)
        self._python = interpreting()

    def failure(self) -> tuple[int, int] | None:
        """Apply rules in turn; the activation in which machine code failed, which ends this early.

        Returns the number of its rule and its place in the order. The space has its former matrices
        then, as after an error. Raises any error of rules that run as Python, and MisuseError.
        """
        self._check_data()
        for number, rule in enumerate(self._rules):
            self._progress[PLACE] = 0
            before = self._as_python.get(number)
            try:
                started = self._apply(rule, before)
                if before is not None:
                    # Machine code has neither lines nor ints of any length.
                    with interpreted():
                        self._activate(started, before, started.count)
            except Exception as error:
                self._matrices.reset()
                in_python = self._python or rule.as_python or before is not None
                if in_python or isinstance(error, MinervaError):
                    raise
                return number, int(self._progress[PLACE])
        return None

    def _check_data(self) -> None:
        """Raise MisuseError if no rule has a parameter for some number."""
        if not self._data:
            return
        names = {parameter.name: None for rule in self._rules for parameter in rule.parameters}
        for name in self._data:
            if name not in names:
                hint = nearest(name, list(names))
                raise MisuseError(f"no rule of this `run` has a parameter {name}{hint}")

    def _apply(self, rule: SpaceRule, end: int | None) -> _Started:
        """Run a rule for the rows that exist at its start, or for those before a place."""
        before = self._snapshot(rule) if rule.sees_before else None
        count = self._count(rule.subject)
        started = _Started(rule, count, np.arange(count if rule.order is SHUFFLED else 0), before)
        in_turn = end is not None or self._python or not rule.checked.independent
        # Few cells of a matrix need no threads.
        if in_turn or (rule.subject.item and parts_of(started.count) == 1):
            self._activate(started, 0, started.count if end is None else end)
        else:
            self._share(started, parts_of(started.count))
        return started

    def _share(self, started: _Started, parts: int) -> None:
        """Run an independent rule in threads; raises the error of the first row."""
        subject = started.rule.subject
        for parameter in started.rule.tables:
            self._table(parameter).reserve(started.rule.room)
        arguments = [self._arguments(started, shared=True) for _ in range(parts)]

        run_rows = started.rule.compiled()

        def run(part: int, begin: int, end: int, progress: NDArray[np.int64]) -> None:
            while begin < end:
                begin = run_rows(begin, end, started.rows, progress, self._draws, *arguments[part])

        failed = run_parts(run, started.count, parts)
        if failed is not None:
            self._progress[PLACE], error = failed
            raise error
        if started.rule.checked.calls(go_to):
            self._table(subject).moved = True

    def _activate(self, started: _Started, begin: int, end: int) -> None:
        """Run a rule for the rows at these places of its order."""
        rule = started.rule
        while begin < end:
            for parameter in rule.tables if rule.room else ():
                self._table(parameter).reserve(rule.room)
            given = begin, end, started.rows, self._progress, self._draws
            if rule.as_python:
                begin = rule.interpret(*given, self._seen_by_python(started))
            else:
                begin = rule.compiled()(*given, *self._arguments(started))

    def close(self) -> None:
        """Write everything back to the space and its stream."""
        for name, table in self._tables.items():
            setattr(self._space, name, table.close())
        self._space.births = int(self._births[0])
        self._chance.word = int(self._draws[0])

    def _count(self, subject: RuleParameter) -> int:
        if subject.table is not None:
            return int(self._table(subject).rows.counts[ROWS])
        return self._attribute(subject).size

    def _snapshot(self, rule: SpaceRule) -> Opened | NDArray[Any]:
        subject = rule.subject
        if subject.table is not None:
            return self._table(subject).snapshot()
        self._attribute(subject)
        return self._matrices.as_it_is(subject.name)

    def _arguments(self, started: _Started, *, shared: bool = False) -> list[Any]:
        """The arguments of a rule, and its lists; `shared` for a thread of an independent one."""
        given = [self._argument(p, started, shared=shared) for p in started.rule.parameters]
        return [*given, *started.rule.checked.method.new_lists()]

    def _argument(self, parameter: RuleParameter, started: _Started, *, shared: bool) -> Any:
        """The argument for a parameter, as machine code sees it."""
        name, rule = parameter.name, started.rule
        if name == BEFORE:
            before = started.before
            return before.argument(shared=shared) if isinstance(before, Opened) else before
        if parameter.table is not None:
            table = self._table(parameter)
            # An independent rule does not read the lists of its subject.
            if not (shared and parameter is rule.subject):
                table.enlist()
            return table.argument(shared=shared)
        if parameter.number:
            return self._number(parameter)
        if parameter.draws:
            return self._draws
        if parameter.type is CellGrid:
            return self._lattice
        if parameter.type is Edges:
            return self._opened_edges(parameter)
        self._attribute(parameter)
        return self._matrices.cells(name, change=name not in rule.checked.only_read)

    def _seen_by_python(self, started: _Started) -> list[Any]:
        """The arguments of a rule that runs as Python."""
        seen: list[Any] = []
        for parameter in started.rule.parameters:
            name, given = parameter.name, self._argument(parameter, started, shared=False)
            if parameter.table is not None:
                table = started.before if name == BEFORE else self._tables[name]
                assert isinstance(table, Opened)
                given = table.table(name)
            elif parameter.type is Edges:
                edges = zip(Edges._fields, given, strict=True)
                given = Edges(*[_guarded(f"{name}.{part}", array) for part, array in edges])
            elif parameter.item:
                if name in started.rule.checked.only_read:
                    given = given.view()
                    given.flags.writeable = False
                given = _guarded(name, given)
            seen.append(given)
        return seen

    def _number(self, parameter: RuleParameter) -> Any:
        """The number for a parameter, passed to `run` or of the space."""
        name = parameter.name
        number = self._values[name] if name in self._values else self._attribute(parameter)
        # The usual case: only nan differs from itself.
        if type(number) is parameter.type and number == number:
            return number
        return self._converted(parameter, number)

    def _converted(self, parameter: RuleParameter, number: Any) -> Any:
        """A number in the type of a parameter, if it has the same value in it."""
        try:
            made = parameter.type(number)
        except (TypeError, ValueError, OverflowError):  # such as a text, or nan as an int
            made = None
        if made is None or made != number or isinstance(number, str):
            raise MisuseError(
                f"{self._space.kind.name}: {parameter.name} must be {parameter.type.__name__}, as"
                f" the rule declares, not {number!r}"
            )
        return made

    def _opened_edges(self, parameter: RuleParameter) -> Edges:
        name = parameter.name
        if name not in self._edges:
            nodes = self._lattice.width * self._lattice.height
            self._edges[name] = opened_edges(name, self._attribute(parameter), nodes)
        return self._edges[name]

    def _table(self, parameter: RuleParameter) -> Opened:
        opened = self._tables.get(parameter.name)
        if opened is None:
            kind: Any = parameter.table
            matrix = self._attribute(parameter)
            extent = self._space.width, self._space.height
            vacant = None
            if not any(rule.checked.calls(random_free) for rule in self._rules):
                searched = any(rule.checked.calls(*SEARCHES) for rule in self._rules)
                vacant = UNCOUNTED if searched else UNLISTED
            room = max(rule.room for rule in self._rules)
            opened = Opened.of(
                kind, matrix, self._lattice, extent, self._births, vacant=vacant, room=room
            )
            self._tables[parameter.name] = opened
        return opened

    def _attribute(self, parameter: RuleParameter) -> Any:
        if parameter.name not in self._space.kind.fields.names:
            raise MisuseError(
                f"{self._space.kind.name} has no attribute {parameter.name}, which a rule expects;"
                " declare it in the class, or pass a number to `run`"
            )
        value: Any = getattr(self._space, parameter.name)
        if not parameter.array:
            return value
        dtype, convert = (
            (np.int16, to_cells) if parameter.item == "int16" else (np.float64, to_reals)
        )
        plain = type(value) is np.ndarray and value.flags.c_contiguous and value.flags.aligned
        if plain and value.dtype == dtype:
            return value  # pyright: ignore[reportUnknownVariableType]
        # The method may have assigned what only becomes such a matrix in the string.
        try:
            matrix = convert(value)
        except Unfit as unfit:
            raise MisuseError(f"{self._space.kind.name}.{parameter.name} must be {unfit}") from None
        setattr(self._space, parameter.name, matrix)
        return matrix


def _guarded(name: str, array: Any) -> Any:
    """A whole array as a rule sees it that runs as Python."""
    return Guarded(name, array, np.empty(0, np.int64), ALL)
