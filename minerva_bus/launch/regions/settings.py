"""The table [regions] of a world file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any, Final, cast

from minerva_bus.errors import nearest
from minerva_bus.launch.specs import load
from minerva_bus.launch.table import Table
from minerva_bus.launch.worldfile import Process
from minerva_bus.regions.lag import RegionLag
from minerva_bus.regions.partition import ByFunction, ById, ByPosition, Partition
from minerva_bus.regions.tree import ByTree, Split
from minerva_bus.settings.declaring import settings_of
from minerva_bus.settings.tables import MAX_REGIONS, RegionSettings

_PARTS: Final = "below", "above"
"""Keys of the parts of a split, beside the attribute."""


def read_regions(top: Table, path: Path) -> tuple[Partition | None, RegionLag | None]:
    """The regions of a world file and command line, and the lag between them.

    Without regions, the world has one coordinator, which applies the lag, too. Raises
    WorldFileError.
    """
    settings, table = top.read(RegionSettings), top.table("regions")
    is_off = "regions" in top.overrides.values and not settings.count  # --regions 0
    if is_off and not settings.lag and settings.move_every == 1:
        return None, None
    if is_off:  # The lag is that between the regions of the file.
        count = settings_of(RegionSettings)["count"]
        settings = replace(settings, count=table.get(count.key, count.kind, count.default))
    partition = _partition(top, table, settings, path)
    lag = _lag(table, settings, partition)
    return None if is_off else partition, lag


def read_hosts(top: Table, processes: Iterable[Process]) -> tuple[str, ...]:
    """The tables of agents that have processes of their own in each region. Raises WorldFileError.

    What a command does is only known from its hello: a region refuses it if it has no agents.
    """
    hosts, tables = top.read(RegionSettings).hosts, dict[str, None]()
    for process in processes:
        if process.agents or process.command:
            tables[process.table] = None
    for name in hosts:
        if name not in tables:
            known = [*tables]
            hint = nearest(name, known, f"agents and commands: {', '.join(known) or 'none'}")
            top.table("regions").wrong("hosts", f"names no process of agents, {name!r}{hint}")
    return hosts


def _lag(table: Table, settings: RegionSettings, partition: Partition | None) -> RegionLag | None:
    if not settings.lag:
        if settings.move_every > 1:
            table.wrong("move_every", "lets regions run ahead by the lag between them: add lag")
        return None
    if partition is None:
        table.wrong("lag", "is between regions: add count, grid or tree")
    if settings.balance:
        text = "needs borders that stay where they are, since they decide which events wait"
        table.wrong("lag", f"{text}: remove balance")
    if settings.function:
        text = "needs regions by id, grid or tree, which records contain and can compute again"
        table.wrong("lag", f"{text}: remove function")
    if settings.move_every > 1 and (settings.reach != "everywhere" or settings.halo):
        # Agents may be elsewhere than in the region that runs them.
        table.wrong("move_every", 'needs reach = "everywhere", and no halo')
    if isinstance(partition, ByPosition | ByTree):  # A record continues with or without halos.
        partition = replace(partition, halo=False)
    lag = RegionLag(settings.lag, partition, settings.move_every)
    return lag if partition.count > 1 else None


def _partition(top: Table, table: Table, settings: RegionSettings, path: Path) -> Partition | None:
    given = [name for name in ("grid", "tree", "function") if getattr(settings, name)]
    if len(given) > 1:
        table.wrong(given[1], f"and {given[0]} are both given; expected one of them")
    if settings.grid is not None or settings.tree is not None:
        return _by_position(top, table, settings)
    if settings.balance:
        table.wrong("balance", "moves the borders of regions by position: add grid or tree")
    if settings.reach != "everywhere":
        table.wrong("reach", "is about conditions on positions: add grid or tree")
    if settings.halo:
        table.wrong("halo", "is about positions near borders: add grid or tree")
    if not settings.count:
        if settings.function and "count" not in table:
            table.wrong("function", "needs the number of regions: add count")
        return None
    if not settings.function:
        return ById(settings.count)
    with table.loading("function"):
        function: Any = load(settings.function, path.parent)
    if not callable(function):
        table.wrong("function", f"names {settings.function}, which is not a function")
    return ByFunction(settings.count, function)


def _by_position(top: Table, table: Table, settings: RegionSettings) -> Partition:
    name, partition = (
        ("grid", _grid(table, cast("dict[str, Any]", settings.grid)))
        if settings.grid is not None
        else ("tree", ByTree(_split(table, settings.tree)))
    )
    cells = partition.count
    if cells > MAX_REGIONS:
        table.wrong(name, f"has {cells} cells; expected at most {MAX_REGIONS}")
    if settings.count not in (0, cells):
        what = f"the {name} has {cells} cells; omit it, or change the {name}"
        top.wrong_setting(RegionSettings, "count", f"is {settings.count}, but {what}")
    by_condition = settings.reach == "condition"
    balance, halo = settings.balance, settings.halo
    return replace(partition, balance=balance, by_condition=by_condition, halo=halo)


def _grid(table: Table, grid: dict[str, Any]) -> ByPosition:
    if not 1 <= len(grid) <= 2:
        table.wrong("grid", "must have one or two attributes, such as { x = [8, 16], y = [7] }")
    borders = [_borders(table, name, values) for name, values in grid.items()]
    names = [*grid, *grid][:2]
    return ByPosition(borders[0], *borders[1:], names=(names[0], names[1]))


def _split(table: Table, value: object) -> Split:
    """A split of a tree, read from its table."""
    split = cast("dict[str, object]", value) if isinstance(value, dict) else {}
    names = [name for name in split if name not in _PARTS]
    at = split[names[0]] if len(names) == 1 else None
    if type(at) not in (int, float) or not isfinite(cast("float", at)):
        expected = "must split at a number of one attribute, such as { x = 8 }"
        table.wrong("tree", f"{expected}, not {value!r:.60}")
    below, above = (_split(table, split[part]) if part in split else None for part in _PARTS)
    return Split(names[0], float(cast("float", at)), below, above)


def _borders(table: Table, name: str, values: object) -> tuple[float, ...]:
    numbers = cast("list[float]", values) if isinstance(values, list) else [float("nan")]
    if not all(type(each) in (int, float) and isfinite(each) for each in numbers):
        table.wrong("grid", f"must have a list of numbers for {name}, not {values!r:.40}")
    if any(low >= high for low, high in pairwise(numbers)):
        table.wrong("grid", f"must have ascending borders for {name}, not {values!r:.40}")
    return tuple(map(float, numbers))
