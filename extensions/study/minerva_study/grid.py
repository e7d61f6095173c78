"""All combinations of options, as in `--set planner=random,astar --set seed=0:50`."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod
from typing import Any, Final, cast

from minerva_bus.collect.data_tables import SEED
from minerva_bus.errors import MisuseError
from minerva_bus.launch.toml_tables import option_text, toml_value
from minerva_bus.settings.world_settings import Overrides

MAX_COMBINATIONS: Final = 1_000_000
_RANGE = re.compile(r"(-?[0-9.]+(?:e-?[0-9]+)?):(-?[0-9.]+(?:e-?[0-9]+)?)(?::([0-9.e-]+))?")

Combination = tuple[str, ...]
"""A value for each key, as text on a command line."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Keys with their values: options of the world, `PROCESS.KEY` as in `run --set`, `seed`."""

    values: Mapping[str, tuple[str, ...]]

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys, in the order of the command line."""
        return tuple(self.values)

    def __len__(self) -> int:
        return prod(map(len, self.values.values()))

    def __iter__(self) -> Iterator[Combination]:
        """All combinations; the last key changes first."""
        return product(*self.values.values())

    def overrides(self, combination: Combination, given: Overrides) -> Overrides:
        """The settings of a combination, over those given for all runs."""
        pairs = dict(zip(self.keys, combination, strict=True))
        seed = pairs.pop(SEED, None)
        settings = [f"{key}={value}" for key, value in pairs.items() if "." in key]
        options = {key: value for key, value in pairs.items() if "." not in key}
        number = None if seed is None else int(seed)
        # Rate 0: a study runs as fast as possible.
        return Overrides(options, tuple(settings), seed=number, rate=0.0).over(given)


@dataclass(frozen=True, slots=True)
class ListedGrid(Grid):
    """Some combinations of keys and values, in their order."""

    listed: tuple[Combination, ...] = ()

    def __len__(self) -> int:
        return len(self.listed)

    def __iter__(self) -> Iterator[Combination]:
        return iter(self.listed)


def parse_grid(settings: Sequence[str]) -> Grid:
    """A grid from `KEY=VALUE,VALUE,...` and `KEY=FROM:TO[:STEP]`. Raises MisuseError."""
    values: dict[str, tuple[str, ...]] = {}
    for setting in settings:
        key, text = key_and_values(setting)
        if not key:
            raise MisuseError(f"--set {setting}: expected KEY=VALUE,VALUE,... or KEY=FROM:TO")
        if key in values:
            raise MisuseError(f"--set {setting}: {key} is already set; give all values together")
        values[key] = _values(setting, text)
    if SEED in values:
        for seed in values[SEED]:
            if not re.fullmatch(r"-?[0-9]+", seed):
                raise MisuseError(f"--set seed: {seed!r} is not a whole number")
    grid = Grid(values)
    if len(grid) > MAX_COMBINATIONS:
        raise MisuseError(f"{len(grid)} combinations are too many; at most {MAX_COMBINATIONS}")
    return grid


def key_and_values(setting: str) -> tuple[str, str]:
    """The parts of `KEY=VALUES`; the key is empty if one of them is missing."""
    key, equals, text = setting.partition("=")
    # As on the command line, where `--max-speed` sets `max_speed`.
    key = key.strip().replace("-", "_") if "." not in key else key.strip()
    return (key, text) if equals else ("", "")


def _values(setting: str, text: str) -> tuple[str, ...]:
    values: list[str] = []
    for part in parts_of(text):
        bounds = _RANGE.fullmatch(part.strip())
        values += _ranged(setting, *bounds.groups()) if bounds else [_canonical(part.strip())]
    if len(set(values)) < len(values):
        twice, _ = Counter(values).most_common(1)[0]
        raise MisuseError(f"--set {setting}: {twice!r} is given twice")
    return tuple(values)


def parts_of(text: str) -> list[str]:
    """Values separated by commas: the items of a TOML list, or else plain text."""
    # TOML first, because texts and lists may contain commas.
    listed = toml_value(f"[{text}]")
    if isinstance(listed, list) and listed:
        values = cast("list[Any]", listed)
        if all(isinstance(value, str | int | float | list | dict) for value in values):
            return [option_text(value) for value in values]
    return text.split(",")


def _ranged(setting: str, first: str, end: str, step: str | None) -> list[str]:
    """The numbers of a range without its end, as in Python."""
    try:
        begin, stop, by = _number(first), _number(end), _number(step or "1")
    except ValueError:
        raise MisuseError(f"--set {setting}: {first}:{end} is not a range of numbers") from None
    if by <= 0 or stop <= begin:
        raise MisuseError(f"--set {setting}: the range {first}:{end} is empty")
    if (stop - begin) / by > MAX_COMBINATIONS:
        raise MisuseError(f"--set {setting}: over {MAX_COMBINATIONS} values")
    values: list[str] = []
    while (value := begin + len(values) * by) < stop:
        # Rounded, because 3 * 0.1 is 0.30000000000000004.
        values.append(option_text(round(value, 12) if isinstance(value, float) else value))
    return values


def _number(text: str) -> int | float:
    try:
        return int(text)
    except ValueError:
        return float(text)


def _canonical(text: str) -> str:
    """A value in canonical form: 0.50 is 0.5."""
    value: Any = toml_value(text)
    return option_text(value) if isinstance(value, int | float) else text
