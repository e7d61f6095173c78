"""The effect of the order of activation on the small models of the comparison.

    python -m benchmarks.comparison.activation [--seeds 10] [--json]

Prints the mean and the deviation of each statistic after all steps (forest fire: after 20), with
the order that the model declares and with another one. Birds in a simultaneous order look at the
flock as it was before the step.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from importlib import import_module
from unittest.mock import patch

from benchmarks.command import Option, Table, options
from benchmarks.comparison.models import flocking
from benchmarks.comparison.models.flocking_at_once import fly_at_once
from benchmarks.comparison.models.forest_fire import BURNT, FIRE, TREE
from benchmarks.comparison.parameters import PARAMETERS
from minerva_bus import Cells
from minerva_fast import (
    ORDERED,
    Activation,
    CellGrid,
    beside,
    rule,
)
from minerva_fast.rules import SpaceRule

STEPS = {"forest_fire": 20}
COLUMNS = {"model": "<12", "activation": "<13", "statistic": "<9", "mean": ">9.3f", "±": ">8.3f"}


@rule(ORDERED)
def burn_in_order(cell: int, forest: Cells, lattice: CellGrid):
    if forest[cell] == FIRE:
        forest[cell] = BURNT
    elif forest[cell] == TREE:
        for dx, dy in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            other = beside(lattice, cell, dx, dy)
            if other >= 0 and forest[other] == FIRE:
                forest[cell] = FIRE


def in_order(space_rule: SpaceRule, order: Activation) -> SpaceRule:
    """The same rule with another order."""
    return rule(order, births=space_rule.births)(space_rule.function)


def variants() -> Iterator[tuple[str, str, dict[str, SpaceRule]]]:
    """Models, the names of their orders, and the rules that replace theirs."""
    for model, names in (("wolf_sheep", ("graze", "hunt")), ("schelling", ("settle",))):
        module = import_module(f"benchmarks.comparison.models.{model}")
        yield model, "shuffled", {}
        yield model, "ordered", {name: in_order(getattr(module, name), ORDERED) for name in names}
    yield "flocking", "shuffled", {}
    yield "flocking", "ordered", {"fly": in_order(flocking.fly, ORDERED)}
    yield "flocking", "simultaneous", {"fly": fly_at_once}
    yield "forest_fire", "simultaneous", {}
    yield "forest_fire", "ordered", {"burn": burn_in_order}


def rows(seeds: int) -> Iterator[dict[str, object]]:
    """A row for each model, order and statistic."""
    for model, order, rules in variants():
        module = import_module(f"benchmarks.comparison.models.{model}")
        parameters = PARAMETERS[model, "small"]
        if model in STEPS:
            parameters = replace(parameters, steps=STEPS[model])
        with ExitStack() as stack:
            for name, replacement in rules.items():
                stack.enter_context(patch.object(module, name, replacement))
            runs = [module.run(parameters, seed)() for seed in range(seeds)]
        for name in runs[0]:
            values = [run[name] for run in runs]
            spread = statistics.stdev(values) if seeds > 1 else 0.0
            yield {"model": model, "activation": order, "statistic": name,
                   "mean": statistics.fmean(values), "deviation": spread}  # fmt: skip


def main() -> None:
    """Print the table."""
    arguments = options(__doc__, seeds=Option(10, "runs of each"))
    table = Table(COLUMNS, as_json=arguments.json)
    for row in rows(arguments.seeds):
        table.row(row)


if __name__ == "__main__":
    main()
