"""Spaces: agents whose state is a lattice or a field with its inhabitants.

    class Meadow(Space, symbol="AMeadow"):
        sheep: Reals
        grass: Cells

        @on("eDay")
        def day(self, day, moment):
            self.run(moment, graze, grow)

The inhabitants are state of the space, in the string like all state: matrices of tables
(`minerva_bus.space.tables`). λ of the space applies rules to them, each as one compiled function.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, cast

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.space.draws import Draws
from minerva_bus.space.lattice import CellGrid
from minerva_bus.space.named import rules_of
from minerva_bus.space.occupancy import ROWS
from minerva_bus.space.opened import Opened
from minerva_bus.space.rules import BEFORE, RuleParameter, SpaceRule, loops_of
from minerva_bus.world.agent import Agent
from minerva_bus.world.context import Context


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

        Args:
            moment: the context of λ; all draws continue its stream `chance`.
            rules: functions marked with `rule`.
            data: numbers for parameters of rules, by name.

        Raises:
            MisuseError: a rule has a parameter that neither the space nor `data` has, an attribute
                does not fit, or a rule cannot be compiled.

        """
        frame = _InFrame(self, moment, data)
        for each in rules:
            frame.apply(each)
        frame.close()

    @classmethod
    def machine_code(cls) -> Iterator[tuple[str, Callable[[], object]]]:
        """Also the rules that methods of the space name, with the functions that compile them."""
        yield from super().machine_code()
        for loop in loops_of(rules_of(cls)):
            yield f"{loop.name} of {cls.__name__}", loop.prepare


class _InFrame:
    """A space while rules are applied: its tables and matrices as arrays, opened once."""

    def __init__(self, space: Space, moment: Context, data: dict[str, float]) -> None:
        self._space = space
        self._moment = moment
        self._data = data
        self._lattice = CellGrid(int(space.width), int(space.height), space.periodic)
        self._births = np.array([space.births])
        self._draws: Draws = np.array([moment.chance.word], np.uint64)
        self._tables: dict[str, Opened] = {}

    def apply(self, rule: SpaceRule) -> None:
        """Run a rule for all rows that exist at its start."""
        subject = rule.subject
        rows = np.arange(self._count(subject))
        before = self._snapshot(subject) if any(p.name == BEFORE for p in rule.parameters) else []
        begin = 0
        while True:
            for parameter in rule.parameters if rule.births else ():
                if parameter.table is not None and parameter.name != BEFORE:
                    self._table(parameter).reserve(rule.births)
            arguments: list[Any] = []
            for parameter in rule.parameters:
                arguments += before if parameter.name == BEFORE else self._arguments(parameter)
            begin = rule.drive(begin, rows, self._draws, *arguments)
            if begin == len(rows):
                return

    def close(self) -> None:
        """Write everything back to the space and its stream."""
        for name, table in self._tables.items():
            setattr(self._space, name, table.close())
        self._space.births = int(self._births[0])
        self._moment.chance.word = int(self._draws[0])

    def _count(self, subject: RuleParameter) -> int:
        if subject.table is not None:
            return int(self._table(subject).arrays["counts"][ROWS])
        return self._attribute(subject).size

    def _snapshot(self, subject: RuleParameter) -> list[Any]:
        if subject.table is not None:
            return self._table(subject).snapshot().arguments()
        return [argument.copy() for argument in self._arguments(subject)]

    def _arguments(self, parameter: RuleParameter) -> list[Any]:
        if parameter.table is not None:
            return self._table(parameter).arguments()
        if parameter.type == Draws:
            return [self._draws]
        if parameter.type is CellGrid:
            return [*self._lattice]
        if parameter.matrix:
            self._attribute(parameter)
            return [self._space.writable(parameter.name).reshape(-1)]
        if parameter.name in self._data:
            return [self._data[parameter.name]]
        return [self._attribute(parameter)]

    def _table(self, parameter: RuleParameter) -> Opened:
        opened = self._tables.get(parameter.name)
        if opened is None:
            kind: Any = parameter.table
            matrix = self._attribute(parameter)
            extent = self._space.width, self._space.height
            opened = Opened.of(kind, matrix, self._lattice, extent, self._births)
            self._tables[parameter.name] = opened
        return opened

    def _attribute(self, parameter: RuleParameter) -> Any:
        if parameter.name not in self._space.kind.fields.names:
            raise MisuseError(
                f"{self._space.kind.name} has no attribute {parameter.name}, which a rule expects;"
                " declare it in the class, or pass a number to `run`"
            )
        value: Any = getattr(self._space, parameter.name)
        if (parameter.table or parameter.matrix) and not isinstance(value, np.ndarray):
            raise MisuseError(f"{self._space.kind.name}.{parameter.name} must be a matrix")
        return cast("Any", value)
