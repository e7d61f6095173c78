"""All combinations of options: what `--set planner=random,astar --set seed=0:50` stands for."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Final, cast

from minerva_bus.errors import MisuseError
from minerva_bus.launch.resuming import option_text
from minerva_bus.launch.typed import toml_value
from minerva_bus.settings.overrides import Overrides

MOST: Final = 1_000_000
SEED: Final = "seed"
FRAMES: Final = "frames"
_RANGE = re.compile(r"(-?[0-9.]+(?:e-?[0-9]+)?):(-?[0-9.]+(?:e-?[0-9]+)?)(?::([0-9.e-]+))?")

Combination = tuple[str, ...]
"""A value for each key, as a command line has it."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Keys, each with its values: world options, `PROCESS.KEY` as in `run --set`, `seed`."""

    values: Mapping[str, tuple[str, ...]]

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys in the order in which they were given."""
        return tuple(self.values)

    def __len__(self) -> int:
        count = 1
        for one in self.values.values():
            count *= len(one)
        return count

    def __iter__(self) -> Iterator[Combination]:
        """Every combination; the last key changes first."""
        return product(*self.values.values())

    def overrides(self, combination: Combination, given: Overrides) -> Overrides:
        """The settings of a combination, over those given for all runs."""
        pairs = dict(zip(self.keys, combination, strict=True))
        seed = pairs.pop(SEED, None)
        settings = [f"{key}={value}" for key, value in pairs.items() if "." in key]
        options = {key: value for key, value in pairs.items() if "." not in key}
        number = None if seed is None else int(seed)
        return Overrides(options, tuple(settings), seed=number, rate=0.0).over(given)


def parse_grid(settings: Sequence[str]) -> Grid:
    """A grid from `KEY=VALUE,VALUE,...` and `KEY=FROM:TO[:STEP]`. Raises MisuseError."""
    values: dict[str, tuple[str, ...]] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        key = key.strip().replace("-", "_") if "." not in key else key.strip()
        if not equals or not key:
            raise MisuseError(f"--set {setting}: expected KEY=VALUE,VALUE,... or KEY=FROM:TO")
        if key in values:
            raise MisuseError(f"--set {setting}: {key} is set already; name all values at once")
        values[key] = _values(setting, text)
    if SEED in values:
        for one in values[SEED]:
            if not re.fullmatch(r"-?[0-9]+", one):
                raise MisuseError(f"--set seed: {one!r} is no whole number")
    grid = Grid(values)
    if len(grid) > MOST:
        raise MisuseError(f"{len(grid)} combinations are too many; at most {MOST}")
    return grid


def _values(setting: str, text: str) -> tuple[str, ...]:
    found: list[str] = []
    for part in _parts(text):
        bounds = _RANGE.fullmatch(part.strip())
        found += _ranged(setting, *bounds.groups()) if bounds else [part.strip()]
    plain = [_canonical(one) for one in found]
    if len(set(plain)) < len(plain):
        twice, _ = Counter(plain).most_common(1)[0]
        raise MisuseError(f"--set {setting}: {twice!r} stands there twice")
    return tuple(plain)


def _parts(text: str) -> list[str]:
    """Values with commas between, as TOML has them in a list, or else as they are."""
    listed = toml_value(f"[{text}]")
    if isinstance(listed, list) and listed:
        values = cast("list[Any]", listed)
        if all(isinstance(one, str | int | float | list | dict) for one in values):
            return [option_text(one) for one in values]
    return text.split(",")


def _ranged(setting: str, first: str, end: str, step: str | None) -> list[str]:
    """From the first on, up to the end but not with it, as Python's range has it."""
    try:
        begin, stop, by = _number(first), _number(end), _number(step or "1")
    except ValueError:
        raise MisuseError(f"--set {setting}: {first}:{end} is no range of numbers") from None
    if by <= 0 or stop <= begin:
        raise MisuseError(f"--set {setting}: the range {first}:{end} is empty")
    if (stop - begin) / by > MOST:
        raise MisuseError(f"--set {setting}: over {MOST} values")
    found: list[str] = []
    while (value := begin + len(found) * by) < stop:
        found.append(option_text(round(value, 12) if isinstance(value, float) else value))
    return found


def _number(text: str) -> int | float:
    try:
        return int(text)
    except ValueError:
        return float(text)


def _canonical(text: str) -> str:
    """A value as it is always written: 0.50 is 0.5."""
    value: Any = toml_value(text)
    return option_text(value) if isinstance(value, int | float) else text
