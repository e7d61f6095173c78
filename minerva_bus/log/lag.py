"""The lag between regions in the description of a record.

lag = [frames, regions, every]
regions = {"ids": count}
    | {"grid": [[name, [border, ...]], ...], "by_condition": bool}
    | {"tree": split, "by_condition": bool}
split = [name, border, split or nil, split or nil]
"""

from __future__ import annotations

from typing import Any

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.lag import Lag
from minerva_bus.regions.lag import RegionLag
from minerva_bus.regions.partition import ById, ByPosition, Partition
from minerva_bus.regions.tree import ByTree, Split
from minerva_bus.wire.plain import as_bool, as_int, as_list, as_map, as_number, as_text


def plain_lag(lag: Lag | None) -> list[Any] | None:
    """A lag as plain data."""
    if not isinstance(lag, RegionLag):
        return None
    return [lag.frames, _plain(lag.partition), lag.every]


def read_lag(plain: Any) -> RegionLag | None:
    """The lag of plain data. Raises ProtocolError."""
    if plain is None:
        return None
    frames, partition, every = _items(plain, 3)
    regions = _partition(as_map(partition, "regions"))
    return RegionLag(as_int(frames, "lag"), regions, as_int(every, "every"))


def _plain(partition: Partition) -> dict[str, Any]:
    if isinstance(partition, ByPosition):
        columns = [list(borders) for borders in (partition.across, partition.down)]
        grid = [[name, of] for name, of in zip(partition.names, columns, strict=True)]
        return {"grid": grid, "by_condition": partition.by_condition}
    if isinstance(partition, ByTree):
        return {"tree": _plain_split(partition.root), "by_condition": partition.by_condition}
    return {"ids": partition.count}


def _partition(plain: dict[str, Any]) -> Partition:
    if "ids" in plain:
        return ById(as_int(plain["ids"], "ids"))
    by_condition = as_bool(plain.get("by_condition"), "by_condition")
    if "tree" in plain:
        return ByTree(_split(plain["tree"]), by_condition=by_condition)
    across, down = (_items(each, 2) for each in _items(plain.get("grid"), 2))
    borders = [
        tuple([as_number(border, "a border") for border in as_list(of, "borders")])
        for _, of in (across, down)
    ]
    names = as_text(across[0], "a name"), as_text(down[0], "a name")
    return ByPosition(borders[0], borders[1], names, by_condition=by_condition)


def _plain_split(split: Split | None) -> list[Any] | None:
    if split is None:
        return None
    return [split.name, split.at, _plain_split(split.below), _plain_split(split.above)]


def _split(plain: Any) -> Split:
    name, at, below, above = _items(plain, 4)
    parts = [None if part is None else _split(part) for part in (below, above)]
    return Split(as_text(name, "a name"), as_number(at, "a border"), *parts)


def _items(plain: Any, count: int) -> list[Any]:
    items = as_list(plain, "lag")
    if len(items) != count:
        raise ProtocolError(f"lag: expected {count} items, got {len(items)}")
    return items
