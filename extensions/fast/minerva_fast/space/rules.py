"""Rules: functions for one inhabitant or cell, which run for all of them in a declared order."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import Enum
from functools import cached_property, partial

from minerva_bus.errors import MisuseError
from minerva_fast.space.checking import check_rule
from minerva_fast.space.compiling import RuleLoop
from minerva_fast.space.driving import RuleDriver
from minerva_fast.space.field import near
from minerva_fast.space.independent import Independence, independence
from minerva_fast.space.kernels import Kernel
from minerva_fast.space.occupancy import random_at, random_free, within
from minerva_fast.space.opened import loops_of_table
from minerva_fast.space.parameters import BEFORE, RuleParameter, parameters_of
from minerva_fast.space.read_only import only_read
from minerva_fast.space.simultaneous import check_simultaneous


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
