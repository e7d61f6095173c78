"""What the worlds of a vector environment exchange: arrays in memory that processes share.

Each world has a row in each array. Processes that are forked later use the same memory, so nothing
is copied or serialized between them.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import (
    create_shared_memory,  # pyright: ignore[reportUnknownVariableType]
    read_from_shared_memory,
)
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.text_and_digest import SIZE
from minerva_learning.acting import AnySpace

Batch = NDArray[Any] | dict[str, Any]
"""An array with a row for each world, or a dictionary of them for a `Dict` space."""


class SharedArrays:
    """Observations, actions and results of `worlds` worlds, as arrays in shared memory.

    `ends` has columns for terminated and truncated; `digest` is of bytes.
    """

    def __init__(self, observation: AnySpace, action: AnySpace, worlds: int) -> None:
        row = spaces.Dict(
            {
                "observation": observation,
                "action": action,
                "reward": spaces.Box(-np.inf, np.inf, (), np.float64),
                "ends": spaces.MultiBinary(2),
                "frame": spaces.Box(0, np.iinfo(np.int64).max, (), np.int64),
                "digest": spaces.Box(0, 255, (SIZE,), np.uint8),
            }
        )
        # Locks of other start methods would start a process of their own.
        context = cast("Any", multiprocessing.get_context("fork"))
        memory = cast("Any", create_shared_memory(row, worlds, context))
        arrays = cast("dict[str, Any]", read_from_shared_memory(row, memory, worlds))
        self.observation: Batch = arrays["observation"]
        self.action: Batch = arrays["action"]
        self.reward: NDArray[np.float64] = arrays["reward"]
        self.ends: NDArray[np.int8] = arrays["ends"]
        self.frame: NDArray[np.int64] = arrays["frame"]
        self.digest: NDArray[np.uint8] = arrays["digest"]

    def put_actions(self, actions: Any) -> None:
        """Store the actions of all worlds. Raises MisuseError if they do not fit."""
        _put_all(self.action, actions)

    def infos(self) -> dict[str, Any]:
        """The frame of each world, in the form of Gymnasium's vector environments."""
        return {"frame": self.frame.copy(), "_frame": np.ones(len(self.frame), np.bool_)}


def put(batch: Batch, row: int, value: Any) -> None:
    """Write the value of one world."""
    if isinstance(batch, dict):
        for name, part in batch.items():
            put(part, row, value[name])
    else:
        batch[row] = value


def taken(batch: Batch, row: int) -> Any:
    """The value of one world."""
    if isinstance(batch, dict):
        return {name: taken(part, row) for name, part in batch.items()}
    return batch[row]


def each(batch: Batch) -> list[Any]:
    """The value of each world or agent; as `taken`, in half of its time."""
    if isinstance(batch, dict):
        parts = map(each, batch.values())
        return [dict(zip(batch, values, strict=True)) for values in zip(*parts, strict=True)]
    return list(batch)


def copied(batch: Batch) -> Any:
    """A copy, which the next step does not change."""
    if isinstance(batch, dict):
        return {name: copied(part) for name, part in batch.items()}
    return batch.copy()


def _put_all(batch: Batch, values: Any) -> None:
    if isinstance(batch, dict):
        named = cast("Mapping[str, Any]", values if isinstance(values, Mapping) else {})
        if named.keys() != batch.keys():
            raise MisuseError(
                f"the actions are {values!r:.60}; expected a dictionary of {[*batch]}"
            )
        for name, part in batch.items():
            _put_all(part, named[name])
        return
    batch[...] = checked_rows(values, batch.shape, batch.dtype)


def checked_rows(actions: Any, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Actions as an array of this shape. Raises MisuseError."""
    array = np.asarray(actions)
    # Neither rows that repeat by broadcasting nor choices that are cut to whole numbers.
    if array.shape != shape or not np.can_cast(array.dtype, dtype, "same_kind"):
        raise MisuseError(
            f"the actions have shape {array.shape} and type {array.dtype}; expected {shape} and"
            f" {dtype}: a row for each"
        )
    return array
