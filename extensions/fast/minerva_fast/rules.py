"""Rules: functions for one inhabitant or cell, which run for all of them in a declared order.

A parameter of a rule is an attribute of the space or a number. The checker notes what an activation
reads and changes. A SIMULTANEOUS rule whose result depends on the order of its activations is
refused: what such a rule reads of its subject it must read from `before`, unless no activation
changes it. Several threads may share the activations of an *independent* rule. It has no draws,
writes only to its own row or cell (`birds.vx[i]`), and reads other rows only in what it does not
change.
"""

from __future__ import annotations

import ast
import inspect
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from types import FunctionType
from typing import Any, Final, cast, get_type_hints

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.types import Cells, Reals
from minerva_fast.draws import PLACE, Draws, interpreting, shuffle
from minerva_fast.driving import PURPOSE, Loop
from minerva_fast.functions import ANY
from minerva_fast.machine_code import Kernel, load_kernel
from minerva_fast.origin import Origin, Undefined, Unreadable
from minerva_fast.places import (
    ALIVE,
    READING,
    ROWS,
    TOO_MANY,
    CellGrid,
    Edges,
    beside,
    copy,
    go_to,
)
from minerva_fast.statements import (
    FIRST_TURN,
    LAST_TURN,
    Results,
    Statements,
    is_counted,
    printed_functions,
    stored,
)
from minerva_fast.tables import BEFORE, InField, Inhabitants, columns_of, loops_of_table
from minerva_fast.values import (
    NUMBERS,
    STEP,
    ColumnAccess,
    FunctionScope,
    Given,
    Items,
    Method,
    Reference,
    RuleGrid,
    RuleTable,
    ValueKind,
    indented,
)


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


@dataclass(frozen=True)
class CheckedRule:
    """A rule that can be compiled.

    Attributes:
        text: of the generated module.
        readable: whether its source is kept; else it runs as Python.
        method: what was collected of the rule.
        only_read: the matrices that it does not change, and `before`.
        independent: whether its activations may run in several threads, with the same result.

    """

    text: str
    method: Method
    only_read: frozenset[str]
    independent: bool
    readable: bool = True

    def calls(self, *functions: Any) -> bool:
        """Whether the rule, or a function that it calls, may call one of these functions."""
        return not self.readable or not self.method.called.keys().isdisjoint(functions)


_UNREADABLE: Final = CheckedRule("", Method(""), frozenset([BEFORE]), False, readable=False)
"""A rule whose source is not kept."""


class SpaceRule:
    """A rule with its parameters; see `rule`."""

    def __init__(self, function: Callable[..., None], order: Activation, births: int) -> None:
        self.name = function.__qualname__
        self.order = order
        self.function = cast("FunctionType", function)
        self.__doc__ = function.__doc__
        self.parameters = parameters_of(function, self.name)
        self.subject = self.parameters[0]
        """The table or matrix for whose rows or cells it runs."""
        self.sees_before = any(p.name == BEFORE for p in self.parameters)
        self.births = births
        """The most copies that one activation may make in a table."""
        self._checked: CheckedRule | None = None
        try:
            self._check()
        except Undefined:  # such as a function below the rule
            pass
        except Unreadable as error:
            self._checked = _UNREADABLE
            warnings.warn(f"{error}; it runs as Python", stacklevel=4)

    def _check(self) -> CheckedRule:
        self._checked = checked_rule(self)
        return self._checked

    @property
    def checked(self) -> CheckedRule:
        """The rule as it can be compiled. Raises NotCompilable."""
        return self._checked or self._check()

    @property
    def as_python(self) -> bool:
        """Whether it runs as Python."""
        return interpreting() or not self.checked.readable

    @property
    def room(self) -> int:
        """The room that a table needs for the newborns of one activation."""
        return self.births if self.checked.calls(copy) else 0

    @cached_property
    def tables(self) -> tuple[RuleParameter, ...]:
        """The parameters that are tables of the space as it is."""
        return tuple([p for p in self.parameters if p.table and p.name != BEFORE])

    def prepare(self) -> None:
        """Compile it now, unless it is to run as Python. Raises MisuseError."""
        if not self.as_python:
            if not self.checked.method.current():  # such as a constant of a notebook
                self._check()
            self.compiled()

    def compiled(self) -> Kernel:
        """The machine code: `run(begin, end, rows, progress, draws, *arguments)`.

        `rows` are all rows, which it puts into their order; unless it does, it needs none. Raises
        MisuseError.
        """
        return load_kernel(self.checked.text, PURPOSE)

    def interpret(
        self,
        begin: int,
        end: int,
        rows: NDArray[np.int64],
        progress: NDArray[np.int64],
        draws: Draws,
        arguments: Sequence[Any],
    ) -> int:
        """The same as Python; stops early if a table has too little room for newborns."""
        tables = [a for p, a in zip(self.parameters, arguments, strict=True) if p in self.tables]
        subject = arguments[0]
        if begin == 0 and self.order is SHUFFLED:
            shuffle(draws, rows)
        for k in range(begin, end):
            # An int of Python, since one of numpy has other arithmetic.
            i = int(rows[k]) if self.order is SHUFFLED else k
            progress[PLACE] = k
            if self.subject.table is not None and not subject.links[ALIVE, i]:
                continue
            counts = [int(table.counts[ROWS]) for table in tables]
            room = [t.links.shape[1] - n for t, n in zip(tables, counts, strict=True)]
            if min(room, default=self.room) < self.room:
                return k
            self.function(i, *arguments)
            for table, count in zip(tables, counts, strict=True):
                if table.counts[ROWS] > count + self.births:
                    raise IndexError(TOO_MANY)
        return end


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


def loops_of(rules: Iterable[SpaceRule]) -> list[SpaceRule | Loop]:
    """Rules and the loops that open their tables, each once."""
    loops: dict[SpaceRule | Loop, None] = {}
    for each in rules:
        for parameter in each.parameters:
            if parameter.table is not None:
                loops |= dict.fromkeys(loops_of_table(parameter.table))
        loops[each] = None
    return list(loops)


# --- parameters ---

_MATRICES: Final = ((Cells, "int16"), (Reals, "float64"))


@dataclass(frozen=True)
class RuleParameter:
    """A parameter of a rule: an attribute of the space, or a number, by its name."""

    name: str
    type: Any

    @cached_property
    def table(self) -> type[Inhabitants] | None:
        """The class of a table."""
        if isinstance(self.type, type) and issubclass(self.type, Inhabitants):
            return self.type
        return None

    @cached_property
    def item(self) -> str:
        """The type of the items of a matrix, of which a rule sees the cells in one dimension."""
        return next((item for matrix, item in _MATRICES if self.type == matrix), "")

    @cached_property
    def number(self) -> bool:
        """Whether it is a number."""
        return self.type in (int, float, bool)

    @cached_property
    def array(self) -> bool:
        """Whether the space must have an array for it."""
        return self.table is not None or bool(self.item) or self.type is Edges

    @cached_property
    def draws(self) -> bool:
        """Whether it is the random stream."""
        return self.type == Draws

    def reference(self, subject: str) -> Reference | None:
        """What it is in a compiled rule; None for a number."""
        own = self.name in (subject, BEFORE)
        if self.table is not None:
            return RuleTable(self.name, self.table, own)
        if self.draws:
            return Given.CHANCE
        if self.item:
            before = self.name == BEFORE
            fixed = f"change the subject of the rule: {self.name} is the state before it" * before
            text, cells = f"m_{self.name}", self.item == "int16"
            kind = ValueKind.INT if cells else ValueKind.REAL
            item = self.item if cells else "real"
            return Items(text, kind, f"len({text})", 0, self.name, "", item, fixed, own)
        return None if self.number else RuleGrid(f"g_{self.name}", self.type)

    def machine(self, *, only_read: bool) -> tuple[str, str]:
        """The argument for it: its type, of names of `library`, and its name.

        Args:
            only_read: whether machine code must change no number of it, so that it may have the
                memory of the string.

        """
        if self.table is not None:
            return f"typed({self.table.rows.__name__}, {only_read})", f"t_{self.name}"
        if self.item:
            return f"cells({self.item}, 1, {only_read})", f"m_{self.name}"
        if self.number:
            return NUMBERS[self.type].machine, f"v_{self.name}"
        return ("cells(uint64)" if self.draws else f"typed({self.type.__name__})"), f"g_{self.name}"

    def parts(self) -> Iterator[tuple[str, str]]:
        """The variables that a rule may use of a table or grid, with their texts."""
        name, rows = self.name, f"t_{self.name}"
        if self.type is CellGrid:
            yield f"g_{name}", _grid(f"g_{name}", "-1")
        if self.table is None:
            return
        for column in columns_of(self.table):
            yield f"c_{name}_{column}", f"{rows}.values[{self.table.names.index(column)}]"
        for column in ("cell", *self.table.searched):
            yield f"c_{name}_{column}", f"{rows}.{column}"
        in_field = issubclass(self.table, InField)
        yield f"g_{name}", f"{rows}.field" if in_field else _grid(f"{rows}.lattice", "-1")
        yield f"links_{name}", f"{rows}.links"
        yield f"n_{name}", f"{rows}.counts"


def _grid(name: str, inner: str) -> str:
    """A grid with another inner cell; if that is a constant, `beside` has no test for it."""
    return f"CellGrid({name}.width, {name}.height, {name}.periodic, {inner})"


def parameters_of(function: Callable[..., None], name: str) -> tuple[RuleParameter, ...]:
    """The parameters of a rule after the row. Raises MisuseError."""
    hints = get_type_hints(function)
    names = list(inspect.signature(function).parameters)
    parameters = tuple([RuleParameter(each, hints.get(each)) for each in names[1:]])
    if not parameters or not (parameters[0].table or parameters[0].item):
        raise MisuseError(
            f"{name}: expected (i: int, subject, ...), where the subject is a table, Cells or Reals"
        )
    known = (Draws, CellGrid, Edges, Cells, Reals, *NUMBERS)
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


# --- checks ---


def checked_rule(made: SpaceRule) -> CheckedRule:
    """Check a rule. Raises NotCompilable."""
    origin = Origin.of(made.function)
    row = next(iter(inspect.signature(made.function).parameters))
    method = Method(f"{origin.name}, a rule")
    known = {p.name: p.reference(made.subject.name) for p in made.parameters}
    references = {name: each for name, each in known.items() if each is not None}
    kinds = {p.name: NUMBERS[p.type] for p in made.parameters if p.number}
    again = row in stored(origin.tree)
    if again:  # another row from some place on
        kinds[row] = ValueKind.INT
    else:
        references[row] = Given.OWN_ROW
    scope = FunctionScope(origin, references, kinds, assigned=set(kinds))
    lines = Statements(method, scope, Results()).function()
    if again:
        lines = [f"v_{row} = v_own", *lines]
        del kinds[row]
    subject, changed = made.subject.name, {a.owner for a in scope.accesses if a.writes}
    if made.order is SIMULTANEOUS:
        _check_simultaneous(subject, scope.accesses, sees_before=made.sees_before)
    only_read = {p.name for p in made.parameters if p.item and p.name not in changed} | {BEFORE}
    given = sorted(scope.reads) + [f"v_{p.name}" for p in made.parameters if p.number]
    given = ["v_own", *[name for name in given if name != "v_own"]]
    head = f"def rule({', '.join(['progress', 'words', 'i', *given])}):"
    loop = "\n".join(_loop(made, method, only_read, given, is_counted(method, lines)))
    text = printed_functions(method, ["@inlined", head, *indented(lines)])
    dependent = made.order is SHUFFLED or method.draws or not _independent(subject, scope, method)
    return CheckedRule(f"{text}\n\n{loop}\n", method, frozenset(only_read), not dependent)


def _check_simultaneous(
    subject: str, accesses: Sequence[ColumnAccess], *, sees_before: bool
) -> None:
    """Raise NotCompilable if a rule reads of its subject what other activations change."""
    own = [access for access in accesses if access.owner == subject]
    changed = {access.column for access in own if access.writes}
    elsewhere = {access.column for access in own if access.writes and not access.own}
    for access in own:
        among = elsewhere if access.own else changed
        if not access.writes and (access.column in among or (access.column == ANY and changed)):
            shown = "before" if sees_before else f"a parameter `before` of the type of {subject}"
            raise access.origin.problem(
                access.node,
                f"a read of {subject} that depends on the order of a SIMULTANEOUS rule",
                f"read it from {shown}, the state before the rule, or declare ORDERED",
            )


def _independent(subject: str, scope: FunctionScope, method: Method) -> bool:
    """Whether no activation depends on another, as far as is known."""
    for access in scope.accesses:
        # The cell of a row changes later, if several threads move rows.
        alone = access.owner == subject and access.own and access.column != "cell"
        moved = access.owner == subject and access.own and isinstance(access.node, ast.Call)
        if (access.writes or access.owner == subject) and not (alone or moved):
            return False
    moves = [
        a for a in scope.accesses if a.writes and a.column == "x" and isinstance(a.node, ast.Call)
    ]
    # A second move would change the order of a cell's rows, unless it happens at once.
    once = len(moves) <= 1 and not any(access.looped for access in moves)
    return once and method.called.keys() <= {go_to, *READING}


# --- the loop ---


def _loop(
    made: SpaceRule, method: Method, only_read: set[str], given: Sequence[str], counted: bool
) -> Iterator[str]:
    """The loop over the rows of a rule."""
    arguments = [p.machine(only_read=p.name in only_read) for p in made.parameters]
    arguments += [(f"cells({each.kind.machine})", each.text) for each in method.lists.values()]
    types, names = zip(*arguments, strict=True)
    first = "int64", "int64", "cells(int64)", "cells(int64)", "cells(uint64)"
    yield f"@kernel(int64({', '.join([*first, *types])}))"
    yield f"def run({', '.join(['begin', 'end', 'rows', 'progress', 'words', *names])}):"
    activation = [*_activation(made, method, given, counted)]
    # Only what is used: numba takes long for each column.
    used = set(re.findall(r"\w+", " ".join(activation)))
    for parameter in made.parameters:
        yield from [f"{STEP}{name} = {text}" for name, text in parameter.parts() if name in used]
    if made.order is SHUFFLED:
        yield from [f"{STEP}if begin == 0:", f"{STEP * 2}shuffle(words, rows)"]
    yield f"{STEP}for k in range(begin, end):"
    yield from indented(indented(activation))
    yield f"{STEP}return end"


def _activation(
    made: SpaceRule, method: Method, given: Sequence[str], counted: bool
) -> Iterator[str]:
    """The lines for one row."""
    tables = [p.name for p in made.parameters if p.table and p.name != BEFORE]
    copies = copy in method.called
    yield "v_own = rows[k]" if made.order is SHUFFLED else "v_own = k"
    yield f"progress[{PLACE}] = k"
    if counted:
        yield FIRST_TURN
    if made.subject.table is not None:
        yield f"if not links_{made.subject.name}[{ALIVE}, v_own]:"
        yield f"{STEP}continue"
    if copies:
        limit = made.births
        room = [f"links_{name}.shape[1] - n_{name}[{ROWS}] < {limit}" for name in tables]
        yield from [f"if {' or '.join(room)}:", f"{STEP}return k"] if limit else []
        yield from [f"u_{name} = n_{name}[{ROWS}]" for name in tables]
    yield from _calls(made, method, given)
    if copies:
        over = [f"n_{name}[{ROWS}] > u_{name} + {made.births}" for name in tables]
        yield from [f"if {' or '.join(over)}:", f"{STEP}raise IndexError"]
    if counted:
        yield from LAST_TURN


def _calls(made: SpaceRule, method: Method, given: Sequence[str]) -> Iterator[str]:
    """The call of the rule, and in front of it that for a cell with 8 neighbours.

    `beside` is an addition there, so half of the time of a cellular automaton is saved.
    """
    grids = [
        f"g_{p.name}" for p in made.parameters if p.type is CellGrid and f"g_{p.name}" in given
    ]
    call = f"rule({', '.join(['progress', 'words', '0', *given])})"
    if not (grids and made.subject.item and beside in method.called):
        yield call
        return
    inner = [_grid(name, "v_own") if name in grids else name for name in given]
    yield f"if surrounded({grids[0]}, v_own):"
    yield f"{STEP}rule({', '.join(['progress', 'words', '0', *inner])})"
    yield "else:"
    yield STEP + call
