"""Status of a world and its members, and log lines, as plain data: PROTOCOL.md, section 13."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from math import isfinite, nan
from typing import Any, get_type_hints

from minerva_bus.errors import ProtocolError
from minerva_bus.wire.plain import (
    as_bool,
    as_int,
    as_list,
    as_map,
    as_number,
    as_scalar,
    as_text,
    as_texts,
)
from minerva_bus.world.operator import (
    CollectedSeries,
    FileStatus,
    LogEntry,
    LogLine,
    MemberStatus,
    NormStatus,
    OrderStatus,
    WorldStatus,
)


def _from_minus_one(plain: Any, what: str) -> int:
    return as_int(plain, what, -1)


_SCALARS: dict[Any, Any] = {str: as_text, int: _from_minus_one, float: as_number, bool: as_bool}


def plain_status(status: WorldStatus) -> dict[str, Any]:
    """A status as plain data, by the names of its fields."""
    return asdict(status, dict_factory=_listed)


def _listed(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in pairs}  # pyright: ignore[reportUnknownArgumentType, reportUnknownVariableType]


def plain_lines(lines: tuple[LogLine, ...]) -> list[dict[str, Any]]:
    """Log lines as plain data."""
    return [asdict(line) for line in lines]


def read_status(plain: Any) -> WorldStatus:
    """A status from plain data. Raises ProtocolError."""
    given = as_map(plain, "a status")
    members = [_read(MemberStatus, item) for item in as_list(given.get("members", []), "members")]
    happenings = [_read(LogEntry, item) for item in as_list(given.get("happenings", []), "events")]
    norms = [_read(NormStatus, item) for item in as_list(given.get("norms", []), "norms")]
    files = [_read(FileStatus, item) for item in as_list(given.get("files", []), "files")]
    return _read(
        WorldStatus,
        given,
        members=tuple(members),
        happenings=tuple(happenings),
        norms=tuple(norms),
        files=tuple(files),
    )


def read_lines(plain: Any) -> tuple[LogLine, ...]:
    """Log lines from plain data. Raises ProtocolError."""
    return tuple([_read(LogLine, item) for item in as_list(plain, "lines")])


def plain_orders(orders: Sequence[OrderStatus]) -> list[dict[str, Any]]:
    """Orders of people as plain data."""
    return [asdict(order) for order in orders]


def read_orders(plain: Any) -> tuple[OrderStatus, ...]:
    """Orders of people from plain data. Raises ProtocolError."""
    return tuple([_read(OrderStatus, item) for item in as_list(plain, "orders")])


def plain_series(series: Sequence[CollectedSeries]) -> list[dict[str, Any]]:
    """Collected series as plain data; nil stands for NaN."""
    return [
        {
            "name": each.name,
            "unit": each.unit,
            "frames": list(each.frames),
            "values": [value if isfinite(value) else None for value in each.values],
        }
        for each in series
    ]


def read_series(plain: Any) -> tuple[CollectedSeries, ...]:
    """Collected series from plain data. Raises ProtocolError."""
    return tuple([_series(as_map(item, "a series")) for item in as_list(plain, "series")])


def _series(given: Mapping[str, Any]) -> CollectedSeries:
    frames = [as_int(frame, "a frame") for frame in as_list(given.get("frames", []), "frames")]
    values = [
        nan if value is None else as_number(value, "a value")
        for value in as_list(given.get("values", []), "values")
    ]
    if len(frames) != len(values):
        raise ProtocolError(f"a series has {len(frames)} frames and {len(values)} values")
    name, unit = as_text(given.get("name"), "the name"), as_text(given.get("unit", ""), "the unit")
    return CollectedSeries(name, unit, tuple(frames), tuple(values))


def _read(kind: type[Any], plain: Any, **read: Any) -> Any:
    """A dataclass of scalars, tuples of text and maps of numbers from plain data."""
    given, hints = as_map(plain, kind.__name__), get_type_hints(kind)
    for field in fields(kind):
        # Unknown keys are ignored: the protocol allows later versions to add some.
        if field.name not in read and field.name in given:
            read[field.name] = _value(hints[field.name], given[field.name], field.name)
    try:
        return kind(**read)
    except TypeError as error:
        raise ProtocolError(f"{kind.__name__}: {error}") from None


def _value(hint: Any, plain: Any, name: str) -> Any:
    scalar = _SCALARS.get(hint)
    if scalar is not None:
        return scalar(plain, name)
    if hint == tuple[str, ...]:
        return as_texts(plain, name)
    if hint == Mapping[str, float]:
        return {key: as_number(item, name) for key, item in as_map(plain, name).items()}
    return {
        key: as_scalar(item, f"{name}: {key[:40]}") for key, item in as_map(plain, name).items()
    }
