"""The loop of a rule over its rows or cells, as the source of a function."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from minerva_fast.space.compiling import RuleLoop
from minerva_fast.space.draws import shuffle
from minerva_fast.space.edges import Edges
from minerva_fast.space.field import FieldGrid
from minerva_fast.space.guarded import ALL, Guard
from minerva_fast.space.kernels import Kernel
from minerva_fast.space.lattice import CellGrid, beside, surrounded
from minerva_fast.space.occupancy import ALIVE, FOUND, ROWS, TOO_MANY
from minerva_fast.space.parameters import BEFORE, SHAPES, RuleParameter
from minerva_fast.space.parts import PLACE, TURNS
from minerva_fast.space.tables import INDEX, InField, Inhabitants


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
