"""Tables of studies: what runs have collected, or their outcomes, with a column for each option."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from numpy.typing import NDArray

from minerva_analysis.tables import plain_value, typed_column
from minerva_bus.api.world import World
from minerva_bus.collect.data_tables import (
    DataTable,
    Gathered,
    read_columns,
    table_path,
)
from minerva_bus.collect.plans import Entries, TablePlan, plans_of, read_entries
from minerva_bus.launch.toml_tables import option_text
from minerva_study.grid import Combination, Grid
from minerva_study.results import ResultTable
from minerva_study.sweep_runs import Sweep

_BOOLS: Final = {"true": True, "false": False}


def collected_of(world: World, collect: Any) -> tuple[Entries, list[TablePlan]]:
    """What runs of a world collect (None: as the world says), and the tables of it."""
    entries = read_entries(collect) if collect is not None else world.file.collect.entries
    return entries, plans_of(entries, world.vocabulary)


def collected_tables(
    runs: Sweep, combinations: Grid, plans: Sequence[TablePlan]
) -> tuple[dict[str, DataTable], dict[str, list[Combination]]]:
    """The collected rows of all runs by table, and the combination of each row."""
    tables = {plan.name: Gathered(plan.name, plan.columns) for plan in plans}
    keys: dict[str, list[Combination]] = {plan.name: [] for plan in plans}
    several = len(plans) > 1
    # In the order of the grid: runs finish in any order, and the table must not depend on it.
    for combination in combinations:
        for plan in plans if not runs.rows[combination].error else ():
            part = table_path(runs.part(combination), plan.name, several)
            rows = read_columns(part, plan.name, plan.columns)
            tables[plan.name].rows(rows.to_dict())
            keys[plan.name] += [combination] * len(rows)
    return {name: gathered.table for name, gathered in tables.items()}, keys


def outcome_table(runs: Sweep) -> DataTable:
    """The outcome of each run, as the table of `minerva sweep`."""
    return data_table("runs", runs.table)


def data_table(name: str, results: ResultTable) -> DataTable:
    """Results of a study as a table in columns; a missing number is nan, a missing text is ""."""
    types: dict[str, str] = {}
    columns: dict[str, NDArray[Any]] = {}
    for column in results.columns:
        types[column], columns[column] = typed_column(results.column(column), option_text)
    return DataTable(name, types, columns)


def with_keys(names: Sequence[str], keys: Sequence[Combination], table: DataTable) -> DataTable:
    """A table with a column for each of these options; `keys` are those of each row."""
    types: dict[str, str] = {}
    columns: dict[str, NDArray[Any]] = {}
    for at, name in enumerate(names):
        # An option may have the name of a collected column.
        own = f"{name}_" if name in table.columns else name
        types[own], columns[own] = typed_column(
            [plain_value(combination[at], _BOOLS) for combination in keys], option_text
        )
    return DataTable(table.name, types | table.types, columns | table.to_dict())
