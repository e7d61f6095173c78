"""Status of a world and its members, and log lines, as plain data: PROTOCOL.md, section 13.

A value is a map by the names of the fields of its class. Unknown names are ignored, because the
protocol allows later versions to add some.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, fields, is_dataclass
from functools import cache
from math import isfinite, nan
from typing import Any, Final, get_args, get_origin, get_type_hints

from minerva_bus.errors import ProtocolError
from minerva_bus.wire.plain import as_bool, as_int, as_list, as_map, as_number, as_scalar, as_text
from minerva_bus.world.operator import CollectedSeries, LogLine, OrderStatus, WorldStatus

_SCALARS: Final[dict[Any, Callable[[Any, str], Any]]] = {
    str: as_text,
    int: lambda plain, what: as_int(plain, what, -1),
    float: as_number,
    bool: as_bool,
    bool | int | float | str: as_scalar,
}


def plain_status(status: WorldStatus) -> dict[str, Any]:
    """A status as plain data, by the names of its fields."""
    return asdict(status, dict_factory=_listed)


def _listed(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in pairs}  # pyright: ignore[reportUnknownArgumentType, reportUnknownVariableType]


def plain_entries(entries: Iterable[LogLine | OrderStatus]) -> list[dict[str, Any]]:
    """Log lines or orders of people as plain data."""
    return [asdict(entry) for entry in entries]


def read_status(plain: Any) -> WorldStatus:
    """A status from plain data. Raises ProtocolError."""
    return _value(WorldStatus, plain, "a status")


def read_lines(plain: Any) -> tuple[LogLine, ...]:
    """Log lines from plain data. Raises ProtocolError."""
    return _value(tuple[LogLine, ...], plain, "lines")


def read_orders(plain: Any) -> tuple[OrderStatus, ...]:
    """Orders of people from plain data. Raises ProtocolError."""
    return _value(tuple[OrderStatus, ...], plain, "orders")


def plain_series(series: Iterable[CollectedSeries]) -> list[dict[str, Any]]:
    """Collected series as plain data; nil stands for NaN."""
    return [
        asdict(each, dict_factory=_listed)
        | {"values": [value if isfinite(value) else None for value in each.values]}
        for each in series
    ]


def read_series(plain: Any) -> tuple[CollectedSeries, ...]:
    """Collected series from plain data. Raises ProtocolError."""
    series: tuple[CollectedSeries, ...] = _value(tuple[CollectedSeries, ...], plain, "series")
    for each in series:
        if len(each.frames) != len(each.values):
            count = f"{len(each.frames)} frames and {len(each.values)} values"
            raise ProtocolError(f"a series has {count}")
    return series


def _value(hint: Any, plain: Any, what: str) -> Any:
    """Plain data as a value of this type. Raises ProtocolError."""
    if (scalar := _SCALARS.get(hint)) is not None:
        return scalar(plain, what)
    if is_dataclass(hint):
        return _entry(hint, plain, what)
    if hint == tuple[float, ...]:  # The values of a series.
        return tuple(
            [nan if item is None else as_number(item, what) for item in as_list(plain, what)]
        )
    of = get_args(hint)
    if get_origin(hint) is tuple:
        return tuple([_value(of[0], item, what) for item in as_list(plain, what)])
    items = as_map(plain, what).items()
    return {key: _value(of[1], item, f"{what}: {key[:40]}") for key, item in items}


_hints: Final = cache(get_type_hints)


def _entry(kind: Any, plain: Any, what: str) -> Any:
    given, hints = as_map(plain, what), _hints(kind)
    names = [field.name for field in fields(kind) if field.name in given]
    try:
        return kind(**{name: _value(hints[name], given[name], name) for name in names})
    except TypeError as error:
        raise ProtocolError(f"{kind.__name__}: {error}") from None
