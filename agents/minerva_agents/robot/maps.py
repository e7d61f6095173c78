"""Reader for maps of the ROS map_server: a floor image with a YAML file.

  map.yaml   image, resolution, origin, negate, occupied_thresh, free_thresh, mode
  map.pgm    one pixel per cell, dark where occupied

The keys are those of the map_server (https://wiki.ros.org/map_server), with two additions:
`markers: {name: [x, y]}` and `start: [x, y, yaw_degrees]`, in metres of the world. A map_server
ignores them, and unknown keys are ignored here. Images other than PGM need Pillow, and YAML that
is not JSON needs PyYAML.
"""

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.floor_images import INSTALL, read_bytes, read_image
from minerva_agents.robot.grids import MapError
from minerva_agents.robot.occupancy import FREE, OCCUPIED, UNKNOWN, MapPose, Marker, OccupancyMap

# A larger file is damaged or hostile.
_MAX_YAML_BYTES = 1_000_000
_YAML_SUFFIXES = (".yaml", ".yml", ".json")
_REQUIRED = (
    "map files need image, resolution, origin, negate, occupied_thresh (usually 0.65)"
    " and free_thresh (0.196)"
)


def load_map(path: str | Path) -> OccupancyMap:
    """Read a map: a map_server YAML file and its image, or an image alone.

    A pixel of brightness s, from 0 (black) to 1 (white), is occupied with probability p = 1 - s, or
    p = s under `negate`. In modes `trinary` and `scale` a cell is occupied if p > occupied_thresh,
    free if p < free_thresh and unknown otherwise (the grades of `scale` are no ground to drive on).
    In mode `raw` the pixel value is the occupancy in percent: p = pixel / 100 under the same
    thresholds, unknown above 100, and `negate` does not apply, as in ROS 2. Pixels that are not
    opaque are unknown, whereas the map_server blends alpha into the brightness in mode `trinary`.

    An image alone has cells of 0.05 m, its lower left corner at (0, 0) and the map_server's default
    thresholds 0.65 and 0.196. Raises MapError, naming the file, for invalid input.
    """
    path = Path(path)
    if path.suffix.lower() not in _YAML_SUFFIXES:
        return OccupancyMap(_read_cells(path, _Reading()), 0.05)
    keys = _Keys(str(path), _read_yaml(path))
    resolution = keys.number("resolution")
    if resolution <= 0:
        raise keys.wrong("resolution", resolution, "metres for each cell, more than 0")
    x, y, turn = keys.numbers("origin", 3)
    cells = _read_cells(path.parent / keys.text("image"), _reading(keys))
    occupancy = OccupancyMap(cells, resolution, x, y, math.degrees(turn))
    return replace(occupancy, markers=_markers(keys, occupancy), start=_start(keys, occupancy))


# --- the YAML file ------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Keys:
    """The keys of a map file, with checks whose errors name the key."""

    source: str
    values: Mapping[object, object]

    def wrong(self, key: str, value: object, expected: str) -> MapError:
        shown = repr(value) if len(repr(value)) <= 60 else repr(value)[:57] + "..."
        return MapError(f"{self.source}: {key} is {shown}; expected {expected}")

    def of(self, key: str) -> object:
        if key not in self.values:
            raise MapError(f"{self.source}: key {key} is missing; add it: {_REQUIRED}")
        return self.values[key]

    def text(self, key: str) -> str:
        value = self.of(key)
        if not isinstance(value, str) or not value:
            raise self.wrong(key, value, "a string")
        return value

    def number(self, key: str) -> float:
        number = _number(self.of(key))
        if number is None:
            raise self.wrong(key, self.of(key), "a finite number")
        return number

    def numbers(self, key: str, count: int) -> tuple[float, ...]:
        return self.numbers_in(key, self.of(key), count)

    def numbers_in(self, key: str, value: object, count: int) -> tuple[float, ...]:
        expected = f"a list of {count} finite numbers"
        if not isinstance(value, list):
            raise self.wrong(key, value, expected)
        items = cast("list[object]", value)
        numbers = [number for item in items if (number := _number(item)) is not None]
        if not len(numbers) == len(items) == count:
            raise self.wrong(key, items, expected)
        return tuple(numbers)


def _number(value: object) -> float | None:
    """A finite number or None; accepts text, because PyYAML reads 5e-2 as text."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _read_yaml(path: Path) -> Mapping[object, object]:
    try:
        # Some editors begin a file with a byte order mark.
        text = read_bytes(path, _MAX_YAML_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MapError(f"{path}: byte {error.start} is not UTF-8; save the file as UTF-8") from None
    try:
        parsed: object = json.loads(text, object_pairs_hook=partial(_unique, path))
    except MapError:
        raise
    except ValueError:
        parsed = _parse_yaml(path, text)
    except RecursionError:
        raise MapError(f"{path}: nested too deeply; expected the keys of a map") from None
    if not isinstance(parsed, dict):
        kind = type(parsed).__name__
        raise MapError(f"{path}: contains {kind}; expected keys such as image and resolution")
    return cast("dict[object, object]", parsed)


def _parse_yaml(path: Path, text: str) -> object:
    try:
        import yaml  # imported late: maps in JSON need no library
    except ImportError:
        raise MapError(f"{path}: YAML needs PyYAML; {INSTALL}") from None
    try:
        parsed = yaml.parse(text, Loader=yaml.SafeLoader)  # pyright: ignore
        events = cast("Iterable[object]", parsed)
        if any(getattr(event, "anchor", None) for event in events):
            # Nested aliases can expand a few lines until memory is full.
            raise MapError(
                f"{path}: YAML anchors and aliases are not supported; write the values out"
            )
        _check_keys(path, cast(object, yaml.compose(text, Loader=yaml.SafeLoader)))
        return cast(object, yaml.safe_load(text))
    except yaml.YAMLError as error:
        raise MapError(f"{path}: not YAML: {' '.join(str(error).split())}") from None
    except (LookupError, AttributeError, TypeError, RecursionError) as error:
        # PyYAML raises these for tags that do not match their values, as in `!!int ''`.
        raise MapError(f"{path}: not YAML with plain values ({type(error).__name__})") from None
    except ValueError as error:
        raise error if isinstance(error, MapError) else MapError(f"{path}: {error}") from None


def _check_keys(path: Path, node: object) -> None:
    """Raise MapError if a mapping in a node of a YAML document has a key twice."""
    children: object = getattr(node, "value", None)
    if not isinstance(children, list):
        return
    pairs = [each for each in cast("list[object]", children) if isinstance(each, tuple)]
    keys = [getattr(cast("tuple[object, object]", key), "value", None) for key, _ in pairs]
    _unique(path, [(key, None) for key in keys if isinstance(key, str)])
    for part in chain(*pairs) if pairs else cast("list[object]", children):
        _check_keys(path, cast(object, part))


def _unique(path: Path, pairs: Sequence[tuple[str, object]]) -> dict[str, object]:
    """A mapping of pairs. Raises MapError for equal keys: a marker would be lost silently."""
    counts = Counter(key for key, _ in pairs)
    for key, count in counts.items():
        if count > 1:
            raise MapError(f"{path}: key {key} is there {count} times; rename or remove the others")
    return dict(pairs)


def _markers(keys: _Keys, on: OccupancyMap) -> tuple[Marker, ...]:
    entries = keys.values.get("markers")
    if entries is None:
        return ()
    if not isinstance(entries, dict):
        raise keys.wrong("markers", entries, "names with positions, {kitchen: [x, y]}")
    markers: list[Marker] = []
    for name, place in cast("dict[object, object]", entries).items():
        if not isinstance(name, str) or not name:
            raise keys.wrong("markers", name, "a string as the name; put it in quotes")
        x, y = keys.numbers_in(f"markers.{name}", place, 2)
        if not on.holds(x, y):
            raise keys.wrong(f"markers.{name}", [x, y], "a position on the map, in metres")
        markers.append(Marker(name, x, y))
    return tuple(markers)


def _start(keys: _Keys, on: OccupancyMap) -> MapPose | None:
    if keys.values.get("start") is None:
        return None
    x, y, angle = keys.numbers("start", 3)
    if not on.holds(x, y):
        raise keys.wrong("start", [x, y, angle], "a position on the map in metres, and degrees")
    return x, y, angle


# --- from shades to cells -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Reading:
    """Conversion of brightness to cells; the defaults apply to an image alone."""

    occupied: float = 0.65
    free: float = 0.196
    negate: bool = False
    mode: str = "trinary"

    def cells(self, maximum: int) -> NDArray[np.int16]:
        """Cell value for each level from 0 to `maximum`, int16 of shape (maximum + 1,)."""
        levels = np.arange(maximum + 1)
        p = levels / maximum if self.negate else (maximum - levels) / maximum
        if self.mode == "raw":
            # Deeper images are scaled to 8 bits, for which this mode is defined.
            p = np.rint(levels / maximum * 255) / 100
        codes = np.where(p > self.occupied, OCCUPIED, np.where(p < self.free, FREE, UNKNOWN))
        if self.mode == "raw":
            codes[p > 1] = UNKNOWN
        return codes.astype(np.int16)


def _reading(keys: _Keys) -> _Reading:
    occupied, free = keys.number("occupied_thresh"), keys.number("free_thresh")
    if not 0 <= free <= occupied <= 1:
        raise keys.wrong(
            "free_thresh, occupied_thresh", [free, occupied], "0 <= free <= occupied <= 1"
        )
    negate = keys.of("negate")
    if negate not in (0, 1):
        raise keys.wrong("negate", negate, "0 or 1")
    mode = keys.values.get("mode", "trinary")
    if mode not in ("trinary", "scale", "raw"):
        raise keys.wrong("mode", mode, "trinary, scale or raw")
    return _Reading(occupied, free, bool(negate), str(mode))


def _read_cells(path: Path, reading: _Reading) -> NDArray[np.int16]:
    """Cells as [row, column] = [x, y]: image columns from the left, rows from below."""
    image = read_image(path)
    seen = reading.cells(image.most)[image.levels]
    if image.hidden is not None:
        seen[image.hidden] = UNKNOWN
    cells = np.ascontiguousarray(seen[::-1].T)
    cells.setflags(write=False)
    return cells
