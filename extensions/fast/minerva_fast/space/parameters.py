"""Parameters of rules: what a rule sees of an attribute of the space, or of a number."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, get_type_hints

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.types import Cells, Reals
from minerva_fast.space.checking import ParameterAccess
from minerva_fast.space.draws import Draws
from minerva_fast.space.edges import Edges
from minerva_fast.space.field import FieldGrid
from minerva_fast.space.lattice import CellGrid
from minerva_fast.space.tables import InField, Inhabitants, columns_of

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
