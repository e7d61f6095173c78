"""Maps of the ROS map_server: an image of a floor and a YAML file that says how to read it.

    map.yaml   image, resolution, origin, negate, occupied_thresh, free_thresh, mode
    map.pgm    a pixel for each cell, dark where something stands

The keys mean what they mean to the map_server (https://wiki.ros.org/map_server). Two more are
ours: `markers: {name: [x, y]}` and `start: [x, y, yaw_degrees]`, in metres of the world; a
map_server passes over them, as we pass over keys that we do not know. PGM is read here; other
images need Pillow, and YAML that is not JSON as well needs PyYAML.
"""

import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grids import MapError
from minerva_agents.robot.occupancy import FREE, OCCUPIED, UNKNOWN, Marker, OccupancyMap, Pose
from minerva_bus.outputs import note_read

_MOST_CELLS = 100_000_000
_MOST_IMAGE_BYTES = 800_000_000
_MOST_YAML_BYTES = 1_000_000
_YAML_SUFFIXES = (".yaml", ".yml", ".json")
_INSTALL = "install it with: pip install 'minerva-bus[maps]'"


def load_map(path: str | Path) -> OccupancyMap:
    """Read a map: a map_server YAML file and its image, or an image alone.

    A pixel of shade s, from 0 for black to 1 for white, is occupied with p = 1 - s, or p = s under
    `negate`. In the modes `trinary` and `scale` a cell is occupied where p > occupied_thresh, free
    where p < free_thresh and unknown between (`scale` has grades there, which are no ground for a
    robot to drive on). In mode `raw` the pixel, of 0 to 255, is itself the percentage of
    occupation: p = pixel / 100 under the same thresholds, unknown above 100, and `negate` has no
    part in it, as in ROS 2. A pixel that is not opaque is unknown; the map_server mixes its alpha
    into the shade instead in mode `trinary`.

    An image alone has cells of 0.05 m, its lower left corner at (0, 0) and the map_server's usual
    thresholds of 0.65 and 0.196. Raises MapError, which names the file, for whatever is wrong.
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
    made = OccupancyMap(cells, resolution, x, y, math.degrees(turn))
    return replace(made, markers=_markers(keys, made), start=_start(keys, made))


# --- the YAML file ------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Keys:
    """The keys of a map file, each with a check that says which one is wrong and how."""

    source: str
    values: Mapping[object, object]

    def wrong(self, key: str, found: object, expected: str) -> MapError:
        shown = repr(found) if len(repr(found)) <= 60 else repr(found)[:57] + "..."
        return MapError(f"{self.source}: {key} is {shown}; expected {expected}")

    def of(self, key: str) -> object:
        if key not in self.values:
            raise MapError(f"{self.source}: there is no {key}; a map file needs this key, add it")
        return self.values[key]

    def text(self, key: str) -> str:
        found = self.of(key)
        if not isinstance(found, str) or not found:
            raise self.wrong(key, found, "a text")
        return found

    def number(self, key: str) -> float:
        number = _number(self.of(key))
        if number is None:
            raise self.wrong(key, self.of(key), "a finite number")
        return number

    def numbers(self, key: str, count: int) -> tuple[float, ...]:
        return self.numbers_in(key, self.of(key), count)

    def numbers_in(self, key: str, found: object, count: int) -> tuple[float, ...]:
        expected = f"a list of {count} finite numbers"
        if not isinstance(found, list):
            raise self.wrong(key, found, expected)
        items = cast("list[object]", found)
        numbers = [number for item in items if (number := _number(item)) is not None]
        if not len(numbers) == len(items) == count:
            raise self.wrong(key, items, expected)
        return tuple(numbers)


def _number(found: object) -> float | None:
    """A finite number or None; also from a text, for PyYAML takes 5e-2 for one."""
    if isinstance(found, bool) or not isinstance(found, int | float | str):
        return None
    try:
        number = float(found)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _read_yaml(path: Path) -> Mapping[object, object]:
    try:
        text = _read(path, _MOST_YAML_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MapError(f"{path}: byte {error.start} is not UTF-8; save the file as UTF-8") from None
    try:
        found: object = json.loads(text)
    except ValueError:
        found = _parse_yaml(path, text)
    except RecursionError:
        raise MapError(f"{path}: nested too deep; expected the keys of a map") from None
    if not isinstance(found, dict):
        kind = type(found).__name__
        raise MapError(f"{path}: holds one {kind}; expected keys such as image and resolution")
    return cast("dict[object, object]", found)


def _parse_yaml(path: Path, text: str) -> object:
    try:
        import yaml  # late: a map in JSON needs no library
    except ImportError:
        raise MapError(f"{path}: is YAML, which needs PyYAML; {_INSTALL}") from None
    try:
        parsed = yaml.parse(text, Loader=yaml.SafeLoader)  # pyright: ignore
        events = cast("Iterable[object]", parsed)
        if any(getattr(event, "anchor", None) for event in events):
            # Nested aliases let a few lines grow to fill all memory.
            raise MapError(f"{path}: has YAML anchors or aliases; write their values out")
        return cast(object, yaml.safe_load(text))
    except yaml.YAMLError as error:
        raise MapError(f"{path}: not YAML: {' '.join(str(error).split())}") from None
    except (LookupError, AttributeError, TypeError, RecursionError) as error:
        # What PyYAML lets escape on tags that do not suit their values, as in `!!int ''`.
        raise MapError(f"{path}: not YAML of plain values ({type(error).__name__})") from None
    except ValueError as error:
        raise error if isinstance(error, MapError) else MapError(f"{path}: {error}") from None


def _markers(keys: _Keys, on: OccupancyMap) -> tuple[Marker, ...]:
    found = keys.values.get("markers")
    if found is None:
        return ()
    if not isinstance(found, dict):
        raise keys.wrong("markers", found, "names with places, {kitchen: [x, y]}")
    made: list[Marker] = []
    for name, place in cast("dict[object, object]", found).items():
        if not isinstance(name, str) or not name:
            raise keys.wrong("markers", name, "a text as the name; put it in quotes")
        x, y = keys.numbers_in(f"markers.{name}", place, 2)
        if not on.holds(x, y):
            raise keys.wrong(f"markers.{name}", [x, y], "a place on the map, in metres")
        made.append(Marker(name, x, y))
    return tuple(made)


def _start(keys: _Keys, on: OccupancyMap) -> Pose | None:
    if keys.values.get("start") is None:
        return None
    x, y, angle = keys.numbers("start", 3)
    if not on.holds(x, y):
        raise keys.wrong("start", [x, y, angle], "a place on the map, in metres, and degrees")
    return x, y, angle


# --- from shades to cells -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Reading:
    """How shades become cells; the values of an image that comes alone."""

    occupied: float = 0.65
    free: float = 0.196
    negate: bool = False
    mode: str = "trinary"

    def cells(self, most: int) -> NDArray[np.int16]:
        """The cell's value for each level from 0 to the most, int16 of shape (most + 1,)."""
        levels = np.arange(most + 1)
        p = levels / most if self.negate else (most - levels) / most
        if self.mode == "raw":
            p = np.rint(levels / most * 255) / 100
        made = np.where(p > self.occupied, OCCUPIED, np.where(p < self.free, FREE, UNKNOWN))
        if self.mode == "raw":
            made[p > 1] = UNKNOWN
        return made.astype(np.int16)


@dataclass(frozen=True, slots=True)
class _Image:
    """Levels of brightness from 0 to `most`, (height, width), top row first, and what is hidden."""

    levels: NDArray[np.uint16]
    most: int
    hidden: NDArray[np.bool_] | None = None


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
    """Cells as [row, column] = [x, y]: the image's columns from the left, its rows from below."""
    image = _read_image(path)
    seen = reading.cells(image.most)[image.levels]
    if image.hidden is not None:
        seen[image.hidden] = UNKNOWN
    cells = np.ascontiguousarray(seen[::-1].T)
    cells.setflags(write=False)
    return cells


def _read_image(path: Path) -> _Image:
    data = _read(path, _MOST_IMAGE_BYTES)
    is_pgm = path.suffix.lower() == ".pgm" or data[:2] in (b"P2", b"P5")
    return _read_pgm(path, data) if is_pgm else _read_with_pillow(path)


def _read(path: Path, most: int) -> bytes:
    try:
        if not path.is_file():
            raise MapError(f"{path}: is not a file; expected a map or its image, check the name")
        size = path.stat().st_size
        if size > most:
            raise MapError(f"{path}: has {size} bytes; expected at most {most}")
        note_read(path)
        return path.read_bytes()
    except OSError as error:
        raise MapError(f"{path}: cannot be read: {error.strerror}; check its permissions") from None


def _check_size(path: Path, width: int, height: int) -> None:
    if not 0 < width * height <= _MOST_CELLS:
        raise MapError(
            f"{path}: the image is {width} x {height}; expected 1 to {_MOST_CELLS} pixels, "
            "make it smaller or its resolution coarser"
        )


# --- images -------------------------------------------------------------------------------------


_SPACE = b" \t\n\v\f\r"
_GAP = re.compile(rb"(?:[ \t\n\v\f\r]|#[^\n\r]*[\n\r])+")
_NUMBER = re.compile(rb"[0-9]{1,9}(?![0-9])")
_COMMENT = re.compile(rb"#[^\n\r]*")


def _read_pgm(path: Path, data: bytes) -> _Image:
    """One PGM image, plain (P2) or raw (P5), of 8 or 16 bits, as netpbm's pgm(5) describes it."""
    if data[:2] not in (b"P2", b"P5"):
        raise MapError(f"{path}: starts with {data[:2]!r}; expected P2 or P5, a PGM image")
    width, at = _header_number(path, data, 2, "width")
    height, at = _header_number(path, data, at, "height")
    most, at = _header_number(path, data, at, "maxval")
    _check_size(path, width, height)
    if not 1 <= most <= 65535:
        raise MapError(f"{path}: maxval is {most}; expected 1 to 65535")
    if at >= len(data) or data[at] not in _SPACE:
        raise MapError(f"{path}: after maxval comes {data[at : at + 1]!r}; expected white space")
    read_levels = _plain_levels if data[:2] == b"P2" else _raw_levels
    levels = read_levels(path, data[at + 1 :], width * height, most)
    if levels.max() > most:
        raise MapError(f"{path}: a pixel is {levels.max()}; expected at most maxval, {most}")
    return _Image(levels.astype(np.uint16).reshape(height, width), most)


def _header_number(path: Path, data: bytes, at: int, name: str) -> tuple[int, int]:
    """The number that stands behind a gap, and where it ends."""
    gap = _GAP.match(data, at)
    number = gap and _NUMBER.match(data, gap.end())
    if not number:
        raise MapError(
            f"{path}: {name} cannot be read from {data[at : at + 12]!r} at byte {at}; "
            "expected white space and a number of at most 9 digits"
        )
    return int(number.group()), number.end()


def _raw_levels(path: Path, body: bytes, count: int, most: int) -> NDArray[np.integer]:
    kind = np.dtype(np.uint8 if most < 256 else ">u2")
    size = count * kind.itemsize
    if len(body) < size or body[size:].strip(_SPACE):
        raise MapError(
            f"{path}: {len(body)} bytes follow the header; expected {size}, "
            f"{kind.itemsize} for each of {count} pixels; the file is damaged"
        )
    return np.frombuffer(body, kind, count)


def _plain_levels(path: Path, body: bytes, count: int, _most: int) -> NDArray[np.integer]:
    words = _COMMENT.sub(b"", body).split()
    if len(words) != count:
        raise MapError(
            f"{path}: {len(words)} numbers follow the header; expected {count}, "
            "one for each pixel; the file is damaged"
        )
    strange = next((word for word in words if not _NUMBER.fullmatch(word)), None)
    if strange is not None:
        raise MapError(f"{path}: a pixel reads {strange[:20]!r}; expected a number")
    return np.array([int(word) for word in words], np.int64)


def _read_with_pillow(path: Path) -> _Image:
    try:
        from PIL import Image  # late: a map in PGM needs no library
    except ImportError:
        raise MapError(f"{path}: is no PGM image, which needs Pillow; {_INSTALL}") from None
    try:
        note_read(path)
        with Image.open(path) as image:
            _check_size(path, *image.size)
            deep = image.mode.startswith("I")
            pixels = np.asarray(image if deep else image.convert("RGBA"))
    except MapError:
        raise
    except Exception as error:  # decoders of damaged files raise nearly anything
        raise MapError(f"{path}: is no readable image: {error}; expected PGM or PNG") from None
    if deep:
        return _Image(np.clip(pixels, 0, 65535).astype(np.uint16), 65535)
    shades = pixels[..., :3].sum(axis=2, dtype=np.uint16)
    return _Image(shades, 3 * 255, pixels[..., 3] < 255)
