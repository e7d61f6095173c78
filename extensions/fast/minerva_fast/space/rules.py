"""Rules: functions for one inhabitant or cell, which run for all of them in a declared order.

A parameter of a rule is an attribute of the space or a number. The loop of a rule over its rows or
cells is the source of a function.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property, partial
from typing import Any, Final, get_type_hints

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.types import Cells, Reals
from minerva_fast.space.checking import ParameterAccess, check_rule, only_read
from minerva_fast.space.compiling import PLACE, TURNS, RuleLoop
from minerva_fast.space.dependences import Independence, check_simultaneous, independence
from minerva_fast.space.kernels import ALL, Draws, Guard, Kernel, shuffle
from minerva_fast.space.places import (
    ALIVE,
    FOUND,
    ROWS,
    TOO_MANY,
    CellGrid,
    Edges,
    FieldGrid,
    beside,
    near,
    random_at,
    random_free,
    surrounded,
    within,
)
from minerva_fast.space.tables import INDEX, InField, Inhabitants, columns_of, loops_of_table


class Activation(Enum):
    """The order in which a rule runs for the inhabitants of a table, or for the cells of a matrix.

    - SIMULTANEOUS: each sees the state before the rule, as the parameter `before`.
    - ORDERED: one after another, by row; each sees what the earlier ones have changed.
    - SHUFFLED: one after another, in an order that the frame's random stream decides.
    """

    SIMULTANEOUS = "simultaneous"
    ORDERED = "ordered"
    SHUFFLED = "shuffled"


SIMULTANEOUS, ORDERED, SHUFFLED = Activation


class SpaceRule:
    """A rule with its parameters; see `rule`."""

    def __init__(self, function: Callable[..., None], order: Activation, births: int) -> None:
        self.name = function.__qualname__
        self.order = order
        self.births = births
        self.kernel = Kernel(function)
        self.__doc__ = function.__doc__
        self.parameters = parameters_of(function, self.name)
        self.subject = self.parameters[0]
        """The table or matrix for whose rows or cells it runs."""
        self.sees_before = any(p.name == BEFORE for p in self.parameters)
        checked = {p.name: known for p in self.parameters if (known := p.checked) is not None}
        self._check_uses = partial(check_rule, self.kernel.function, checked)
        self._check()
        matrices = [p.name for p in self.parameters if p.matrix]
        self.only_read = only_read(self.kernel.function, matrices)
        """The matrices that it does not change, and `before`: the compiler and Python refuse it."""
        if self.sees_before:
            self.only_read |= {BEFORE}
        driver = RuleDriver(self.kernel, self.parameters, order is SHUFFLED, births, self.only_read)
        self.drive = driver.loop(self.name, self._check)

    @cached_property
    def tables(self) -> tuple[RuleParameter, ...]:
        """The parameters that are tables of the space as it is."""
        return tuple([p for p in self.parameters if p.table and p.name != BEFORE])

    @cached_property
    def takes_free_cells(self) -> bool:
        """Whether it, or a kernel that it calls, calls `random_free`."""
        return random_free in self.kernel.called

    @cached_property
    def searches(self) -> bool:
        """Whether it, or a kernel that it calls, searches for the rows of cells."""
        return bool({near, random_at, random_free, within} & {*self.kernel.called})

    @cached_property
    def independence(self) -> Independence:
        """Whether its activations may run in several threads, with the same result."""
        if self.order is SHUFFLED or any(p.draws for p in self.parameters):
            return Independence(independent=False)
        return independence(self.kernel.function)

    def _check(self) -> None:
        """Raise NotCompilable if the rule cannot be compiled or does not fit its order."""
        self._check_uses()
        if self.order is SIMULTANEOUS:
            check_simultaneous(self.kernel.function)


def rule(order: Activation, *, births: int = 1) -> Callable[[Callable[..., None]], SpaceRule]:
    """Mark a function `(i, subject, ...)` as a rule of a space, run by `Space.run`.

    `i` is a row of `subject`, a table, or a cell of it, a matrix. Other parameters are, by name and
    annotation: tables and matrices (`Cells`, `Reals`: arrays of shape (cells,)) of the space,
    `Edges` (a `Reals` of the space, made by `Edges.of`), `CellGrid`, `Draws`, and numbers, from
    attributes of the space or from `Space.run`. With SIMULTANEOUS, the parameter `before` is the
    subject as it was before the rule.

    Args:
        order: the order of activation.
        births: the most copies that one activation may make in a table.

    Raises:
        MisuseError: a parameter has no annotation, or one that a rule cannot have.
        NotCompilable: the rule uses something that cannot be compiled.

    Example:
        >>> @rule(SHUFFLED)
        ... def graze(i: int, sheep: Sheep, grass: Cells, draws: Draws):
        ...     move_to(sheep, i, next_cell(sheep.lattice, sheep.cell[i], draws))

    """
    # A type checker knows this; people who have none read the message.
    if not isinstance(order, Activation):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError("a rule needs its order of activation: write @rule(SHUFFLED)")

    def mark(function: Callable[..., None]) -> SpaceRule:
        return SpaceRule(function, order, births)

    return mark


def loops_of(rules: Iterable[SpaceRule]) -> list[RuleLoop]:
    """The loops of rules and of opening their tables, each once."""
    loops: dict[int, RuleLoop] = {}
    for each in rules:
        for parameter in each.parameters:
            if parameter.table is not None:
                loops |= {id(loop): loop for loop in loops_of_table(parameter.table)}
        loops[id(each.drive)] = each.drive
    return list(loops.values())


BEFORE: Final = "before"

_NUMBERS: Final = {int: "int64", float: "float64", bool: "boolean"}
_MATRICES: Final = ((Cells, "int16"), (Reals, "float64"))
_INDEX_TYPES: Final = (
    "int64[:, ::1]", "int64[:, ::1]", "int64[::1]", "int64[::1]", "int64[::1]",
)  # fmt: skip
"""Those of a table's index after `values`."""
_ON_LATTICE: Final = ("int64[::1]",)
_IN_FIELD: Final = (
    "int64[::1]", "float64[::1]", "float64[::1]",
    "int64[::1]", "int64[::1]", "float64[::1]", "float64[::1]",
)  # fmt: skip
SHAPES: Final = {
    CellGrid: ("int64", "int64", "boolean"),
    FieldGrid: ("float64", "float64", "boolean", "int64", "int64"),
    Edges: ("int64[::1]", "int64[::1]"),
}
"""The numba types of the arguments for shapes and graphs."""


@dataclass(frozen=True)
class RuleParameter:
    """A parameter of a rule: an attribute of the space, or a number, by its name."""

    name: str
    type: Any

    @cached_property
    def table(self) -> type[Inhabitants] | None:
        """The class of a table."""
        return (
            self.type
            if isinstance(self.type, type) and issubclass(self.type, Inhabitants)
            else None
        )

    @cached_property
    def matrix(self) -> bool:
        """Whether it is a matrix, of which a rule sees the cells in one dimension."""
        return any(self.type == matrix for matrix, _ in _MATRICES)

    @cached_property
    def number(self) -> bool:
        """Whether it is a number."""
        return self.type in (int, float, bool)

    @cached_property
    def array(self) -> bool:
        """Whether the space must have an array for it."""
        return self.table is not None or self.matrix or self.type is Edges

    @cached_property
    def draws(self) -> bool:
        """Whether it is the random stream."""
        return self.type == Draws

    @property
    def checked(self) -> ParameterAccess | None:
        """What a rule may do with it; None for numbers."""
        before = self.name == BEFORE
        if self.table is not None:
            changed = [] if before else [n for n in self.table.names if n not in self.table.fixed]
            return ParameterAccess(self.table.type._fields, tuple(changed), before)
        if self.draws:
            return ParameterAccess(draws=True)
        return ParameterAccess(before=before) if self.matrix else None

    def types(self, *, only_read: bool = False) -> list[str]:
        """The numba types of the arguments that it consists of.

        Args:
            only_read: whether machine code must change no number of it, so that it may have the
                memory of the string.

        """
        if self.table is not None:
            values, column = [_array("float64", size, only_read) for size in (2, 1)]
            columns = [column] * len(columns_of(self.table))
            field = issubclass(self.table, InField)
            extra = _IN_FIELD if field else _ON_LATTICE
            shape = SHAPES[FieldGrid if field else CellGrid]
            return [values, *_INDEX_TYPES, *columns, *extra, *shape]
        if self.draws:
            return ["uint64[::1]"]
        if self.type is CellGrid or self.type is Edges:
            return [*SHAPES[self.type]]
        for matrix, item in _MATRICES:
            if self.type == matrix:
                return [_array(item, 1, only_read)]
        return [_NUMBERS[self.type]]


def _array(item: str, dimensions: int, only_read: bool) -> str:
    return f"Array({item}, {dimensions}, 'C', readonly={only_read})"


def parameters_of(function: Callable[..., None], name: str) -> tuple[RuleParameter, ...]:
    """The parameters of a rule after the row. Raises MisuseError."""
    hints = get_type_hints(function)
    names = list(inspect.signature(function).parameters)
    parameters = tuple([RuleParameter(each, hints.get(each)) for each in names[1:]])
    if not parameters or not (parameters[0].table or parameters[0].matrix):
        raise MisuseError(
            f"{name}: expected (i: int, subject, ...), where the subject is a table, Cells or Reals"
        )
    known = (Draws, CellGrid, Edges, Cells, Reals, *_NUMBERS)
    for parameter in parameters:
        if parameter.type is None:
            raise MisuseError(
                f"{name}: {parameter.name} has no type; write one, as in {parameter.name}: int"
            )
        if parameter.table is None and not any(parameter.type == each for each in known):
            raise MisuseError(
                f"{name}: {parameter.name} must be a table, Cells, Reals, Draws, CellGrid,"
                f" Edges, int, float or bool, not {parameter.type}"
            )
        if parameter.name == BEFORE and parameter.type != parameters[0].type:
            raise MisuseError(f"{name}: `before` must have the type of {parameters[0].name}")
    return parameters


@dataclass(frozen=True)
class RuleDriver:
    """The loop `drive` of a rule.

    Attributes:
        kernel: the rule.
        parameters: those after the row; the first is the subject.
        shuffled: whether the loop puts the rows into a random order.
        births: the most copies that one activation may make in a table.
        only_read: the names of the matrices and tables that it must not change.

    """

    kernel: Kernel[..., None]
    parameters: Sequence[RuleParameter]
    shuffled: bool
    births: int
    only_read: frozenset[str]

    def loop(self, name: str, check: Callable[[], None]) -> RuleLoop:
        """A loop over the rows at `begin` to `end`; `progress` is that of `parts.new_progress`.

        `rows` are all rows, which the loop puts into their order; unless it does, it needs none.
        It stops early, and returns the place, if a table has too little room for newborns.
        """
        heads, types, calls, scope = self._arguments()
        lines = [
            f"def drive(begin, end, rows, progress, draws, {', '.join(heads)}):",
            *[f"    p{number} = {call}" for number, call in enumerate(calls)],
            *(["    if begin == 0:", "        shuffle(draws, rows)"] if self.shuffled else []),
            "    for k in range(begin, end):",
            # An int of Python, since one of numpy has other arithmetic.
            "        i = int(rows[k])" if self.shuffled else "        i = k",
            f"        progress[{PLACE}], progress[{TURNS}] = k, 0",
            *[f"        {line}" for line in self._activation()],
            "    return end",
            "",
        ]
        first = ("int64", "int64", "int64[::1]", "int64[::1]", "uint64[::1]")
        signature = f"int64({', '.join([*first, *types])})"
        return RuleLoop(name, "\n".join(lines), scope, signature, check)

    def _arguments(self) -> tuple[list[str], list[str], list[str], dict[str, Any]]:
        """Arguments of the driver with their types, and the parameters that they form."""
        heads, types, calls, scope = list[str](), list[str](), list[str](), dict[str, Any]()
        for number, parameter in enumerate(self.parameters):
            arguments = parameter.types(only_read=parameter.name in self.only_read)
            names = [f"a{number}_{part}" for part in range(len(arguments))]
            heads += names
            types += arguments
            calls.append(_built(parameter, names, number, scope))
        scope |= {"rule": self.kernel, "shuffle": shuffle, "surrounded": surrounded}
        return heads, types, calls, scope

    def _activation(self) -> Iterator[str]:
        """The lines for one row."""
        tables = [n for n, p in enumerate(self.parameters) if p.table and p.name != BEFORE]
        if self.parameters[0].table is not None:
            yield f"if not p0.links[{ALIVE}, i]:"
            yield "    continue"
        if tables and self.births:
            room = [f"p{n}.links.shape[1] - p{n}.counts[{ROWS}] < {self.births}" for n in tables]
            yield f"if {' or '.join(room)}:"
            yield "    return k"
        yield from [f"u{n} = p{n}.counts[{ROWS}]" for n in tables]
        yield from self._calls()
        if tables:
            over = [f"p{n}.counts[{ROWS}] > u{n} + {self.births}" for n in tables]
            yield f"if {' or '.join(over)}:"
            yield f"    raise IndexError({TOO_MANY!r})"

    def _calls(self) -> Iterator[str]:
        """The call of the rule, and in front of it that for a cell with 8 neighbours.

        `beside` is an addition there, so half of the time of a cellular automaton is saved.
        """
        given = [f"p{number}" for number in range(len(self.parameters))]
        grids = [number for number, p in enumerate(self.parameters) if p.type is CellGrid]
        call = f"rule(i, {', '.join(given)})"
        if not (grids and self.parameters[0].matrix and beside in self.kernel.called):
            yield call
            return
        for number in grids:
            given[number] = f"CellGrid(p{number}.width, p{number}.height, p{number}.periodic, i)"
        yield f"if surrounded(p{grids[0]}, i):"
        yield f"    rule(i, {', '.join(given)})"
        yield "else:"
        yield f"    {call}"


def _built(parameter: RuleParameter, names: list[str], number: int, scope: dict[str, Any]) -> str:
    """The expression of a parameter's value from the arguments of the driver."""
    if parameter.table is not None:
        return _table(parameter.name, parameter.table, names, number, scope)
    if parameter.matrix:
        scope[f"g{number}"] = Guard(parameter.name)
        return f"g{number}({names[0]}, rows)"
    if parameter.type is CellGrid:
        scope["CellGrid"] = CellGrid
        return f"CellGrid({', '.join(names)}, -1)"
    if parameter.type is Edges:
        scope["Edges"] = Edges
        for name, field in zip(names, Edges._fields, strict=True):
            scope[f"g_{name}"] = Guard(f"{parameter.name}.{field}")
        return f"Edges({', '.join([f'g_{name}({name}, rows)' for name in names])})"
    return names[0]


def _table(
    name: str, kind: type[Inhabitants], names: list[str], number: int, scope: dict[str, Any]
) -> str:
    """The tuple of a table, whose columns and lists of neighbours are guarded."""
    shape = FieldGrid if issubclass(kind, InField) else CellGrid
    scope |= {f"T{number}": kind.type, shape.__name__: shape}
    size = len(SHAPES[shape])
    counts = names[INDEX.index("counts")]
    made = names[:-size]
    for part in range(INDEX.index("cell"), len(made)):
        field = kind.type._fields[part]
        guard = f"g{number}_{part}"
        scope[guard] = Guard(f"{name}.{field}", _slot(kind, field))
        made[part] = f"{guard}({names[part]}, {counts})"
    inner = f"{shape.__name__}({', '.join(names[-size:])}{', -1' if shape is CellGrid else ''})"
    return f"T{number}({', '.join([*made, inner])})"


def _slot(kind: type[Inhabitants], field: str) -> int:
    """The item of `counts` with the number of items that an array of a table has."""
    if field in kind.sorted_rows:
        return ALL
    return FOUND if field in kind.extra else ROWS
