"""Attributes, data of events and readings as vectors of numbers with names."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.collect.collector import Rows
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.scene import Scene, walk
from minerva_bus.world.readings import Battery, Odometry, Position, Reading, Scan

_NUMBERS: Final = ("real", "int", "bool")


def is_numeric(field: Field) -> bool:
    """Whether a field is a number, a bool, or one of a few words."""
    return field.type.kind in _NUMBERS or bool(field.type.words)


@dataclass(frozen=True, slots=True)
class RowVectors:
    """Fields of agents or events as vectors: bools as 0 and 1, words one-hot."""

    fields: tuple[Field, ...]

    @property
    def names(self) -> list[str]:
        """A name for each number: `speed`, `gait=walk`."""
        return [name for field in self.fields for name in _names(field)]

    def of_rows(self, rows: Rows) -> NDArray[np.float32]:
        """The vectors of all rows, shape (count, width)."""
        blocks = [_block(rows.column(field.name), field.type.words) for field in self.fields]
        if not blocks:
            return np.empty((rows.count, 0), np.float32)
        return np.concatenate(blocks, axis=1).astype(np.float32)


def _names(field: Field) -> list[str]:
    return [f"{field.name}={word}" for word in field.type.words] or [field.name]


def _block(column: NDArray[Any], words: Sequence[str]) -> NDArray[np.float64]:
    if words:
        return np.stack([column == word for word in words], axis=1).astype(np.float64)
    return column.astype(np.float64)[:, None]


# --- strings ---


def numbers_in(string: Scene) -> dict[str, float]:
    """The numeric parameters of a string by `SYMBOL.name`; those of one name are added up."""
    sums: dict[str, float] = {}
    for opens, node in walk(string):
        if opens:
            for name, value in zip(node.names, node.values, strict=True):
                if isinstance(value, int | float):
                    key = f"{node.symbol}.{name}"
                    sums[key] = sums.get(key, 0.0) + float(value)
    return sums


# --- readings ---


def reading_names(reading: Reading) -> list[str]:
    """A name for each number of `reading_vector`; none for images and sightings."""
    if isinstance(reading, Scan):
        return [f"{reading.first + n * reading.step:g}" for n in range(len(reading.ranges))]
    if isinstance(reading, Odometry):
        return ["x", "y", "angle", "speed", "turn"]
    if isinstance(reading, Battery):
        return ["charge", "volts"]
    return ["latitude", "longitude", "altitude"] if isinstance(reading, Position) else []


def reading_vector(reading: Reading) -> NDArray[np.float64]:
    """The numbers of a reading, in metres, degrees and volts.

    A scan has `range_max` where a beam hits nothing, and 0 where nothing was measured.
    """
    if isinstance(reading, Scan):
        ranges = np.asarray(reading.ranges, np.float64)
        return np.clip(np.nan_to_num(ranges, posinf=math.inf), 0.0, reading.range_max)
    if isinstance(reading, Odometry):
        numbers = (reading.x, reading.y, reading.angle, reading.speed, reading.turn)
    elif isinstance(reading, Battery):
        numbers = (reading.charge, reading.volts)
    elif isinstance(reading, Position):
        numbers = (reading.latitude, reading.longitude, reading.altitude or 0.0)
    else:
        numbers = ()
    return np.array(numbers, np.float64)
