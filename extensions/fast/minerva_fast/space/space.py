"""Spaces: agents whose state is a lattice or a field with its inhabitants.

    class Meadow(Space, symbol="AMeadow"):
        sheep: Reals
        grass: Cells

        @on("eDay")
        def day(self, day, moment):
            self.run(moment, graze, grow)

The inhabitants are state of the space, in the string like all state: matrices of tables
(`minerva_fast.space.tables`). λ of the space applies rules to them, each as one compiled function.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from minerva_bus.world.agent import Agent
from minerva_bus.world.context import Context
from minerva_fast.space.named import rules_of
from minerva_fast.space.opened_space import OpenedSpace
from minerva_fast.space.rules import SpaceRule, loops_of


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
            try:
                failed = frame.failure()
            except Exception:
                frame.reset()
                raise
            if failed is None:
                frame.close()
                return
            frame.reset()
            as_python[failed.rule] = failed.place

    @classmethod
    def machine_code(cls) -> Iterator[tuple[str, Callable[[], object]]]:
        """Also the rules that methods of the space name, with the functions that compile them."""
        yield from super().machine_code()
        for loop in loops_of(rules_of(cls)):
            yield f"{loop.name} of {cls.__name__}", loop.prepare
