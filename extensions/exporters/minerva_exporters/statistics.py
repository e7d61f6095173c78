"""Statistics of a feature, as LeRobot's policies need them to normalise data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Statistics = Mapping[str, Any]
"""min, max, mean, std, quantiles, and the number of samples, as nested lists."""

_QUANTILES: Final = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_SHADES: Final = 256


def vector_statistics(rows: NDArray[Any]) -> Statistics:
    """Of the vectors of an episode, shape (count, width)."""
    values = rows.astype(np.float64)
    numbers = {
        "min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0),
        **{name: np.quantile(values, part, axis=0) for name, part in _QUANTILES.items()},
    }  # fmt: skip
    return {**{name: each.tolist() for name, each in numbers.items()}, "count": [len(rows)]}


class Shades:
    """How often each shade occurs in each channel of images."""

    def __init__(self, channels: int) -> None:
        self._counts = np.zeros((channels, _SHADES), np.int64)
        self._images = 0

    def add(self, pixels: NDArray[np.uint8]) -> None:
        """Count an image, shape (height, width, channels)."""
        self._images += 1
        for channel, counts in enumerate(self._counts):
            counts += np.bincount(pixels[:, :, channel].ravel(), minlength=_SHADES)

    def statistics(self) -> Statistics:
        """Of all channels from 0 to 1, each of shape (channels, 1, 1)."""
        shades = np.arange(_SHADES) / (_SHADES - 1)
        parts = self._counts / self._counts.sum(1, keepdims=True)
        mean = parts @ shades
        below = np.cumsum(parts, axis=1)
        first = lambda part: shades[np.argmax(below >= part, axis=1)]  # noqa: E731
        least = shades[np.argmax(self._counts > 0, axis=1)]
        most = shades[_SHADES - 1 - np.argmax(self._counts[:, ::-1] > 0, axis=1)]
        numbers = {
            "min": least, "max": most, "mean": mean,
            "std": np.sqrt(np.maximum(parts @ shades**2 - mean**2, 0.0)),
            **{name: first(part) for name, part in _QUANTILES.items()},
        }  # fmt: skip
        shaped = {name: each.reshape(-1, 1, 1).tolist() for name, each in numbers.items()}
        return {**shaped, "count": [self._images]}


def merged(parts: Sequence[Statistics]) -> Statistics:
    """The statistics of several episodes; quantiles are their weighted means."""
    counts = np.array([part["count"][0] for part in parts], np.float64)

    def of(name: str) -> NDArray[np.float64]:
        return np.array([part[name] for part in parts], np.float64)

    def weighted(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.average(values, axis=0, weights=counts)

    mean = weighted(of("mean"))
    spread = weighted(of("std") ** 2 + of("mean") ** 2) - mean**2
    numbers = {
        "min": of("min").min(0), "max": of("max").max(0), "mean": mean,
        "std": np.sqrt(np.maximum(spread, 0.0)),
        **{name: weighted(of(name)) for name in _QUANTILES},
    }  # fmt: skip
    shown = {name: each.tolist() for name, each in numbers.items()}
    return {**shown, "count": [int(counts.sum())]}
