"""Maps of floors: cells and markers, files of the ROS map_server, and places on a map.

A map file is a floor image with a YAML file:

  map.yaml   image, resolution, origin, negate, occupied_thresh, free_thresh, mode
  map.pgm    one pixel per cell, dark where occupied

The keys are those of the map_server (https://wiki.ros.org/map_server), with two additions:
`markers: {name: [x, y]}` and `start: [x, y, yaw_degrees]`, in metres of the world. A map_server
ignores them, and unknown keys are ignored here. Images other than PGM need Pillow, and YAML that
is not JSON needs PyYAML. Files are untrusted: their size is checked before they are read, and that
of the image before it is decoded. Each error is a MapError that names the file.

Without `markers` and `start`, places are computed: where a robot fits, where it starts, where
markers go. A robot is a disc. It fits on a cell if no occupied, unknown or outside cell has its
centre within the disc, consistent with `grid.inflate`.
"""

import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from heapq import heappop, heappush
from itertools import chain, islice
from pathlib import Path
from typing import Final, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grid import MapError, clearance, inflate
from minerva_agents.robot.pose import Cell
from minerva_bus import portable
from minerva_bus.files import note_read
from minerva_bus.values import fast_dataclass
from minerva_bus.wording import install

FREE: Final = 0
OCCUPIED: Final = 100
UNKNOWN: Final = -1

Point: TypeAlias = tuple[float, float]
MapPose: TypeAlias = tuple[float, float, float]
Numbers = TypeVar("Numbers", float, NDArray[np.float64])


@fast_dataclass
class Marker:
    """A named position on a floor, in metres of the world."""

    name: str
    x: float
    y: float


# Without slots, because `room` is cached in the instance.
@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """A floor, cell by cell, as in nav_msgs/OccupancyGrid.

    `cells` is int16, read-only, [row, column]; rows grow along the map's x, columns along its y; 0
    is free, 100 occupied, -1 unknown. A cell's side is `resolution` metres. The outer corner of
    cell (0, 0) lies at (`x`, `y`) metres in the world, and the map's x axis is rotated `angle`
    degrees counter-clockwise from the world's. `start` is (x, y, degrees), or None if not given.
    """

    cells: NDArray[np.int16]
    resolution: float
    x: float = 0.0
    y: float = 0.0
    angle: float = 0.0
    markers: tuple[Marker, ...] = ()
    start: MapPose | None = None

    @property
    def obstacles(self) -> NDArray[np.bool_]:
        """True where a robot must not be: every cell not known to be free."""
        return self.cells != FREE

    @cached_property
    def room(self) -> NDArray[np.float64]:
        """Clearance in cells; everything outside the map counts as an obstacle.

        Cached and read-only.
        """
        room = clearance(_walled(self.obstacles))[1:-1, 1:-1]
        room.setflags(write=False)
        return room

    def equals(self, other: "OccupancyMap") -> bool:
        """True if both describe the same floor with the same cells."""
        own, theirs = self._frame(), other._frame()
        return own == theirs and np.array_equal(self.cells, other.cells)

    def holds(self, x: float, y: float) -> bool:
        """True if a world position in metres lies on the map."""
        # Not by `cell_at`: a finite position may be infinitely many cells away.
        row, column = self._cells_to(x, y)
        return 0 <= row < self.cells.shape[0] and 0 <= column < self.cells.shape[1]

    def cell_at(self, x: float, y: float) -> tuple[int, int]:
        """Cell of a world position in metres; it may lie outside the map."""
        row, column = self._cells_to(x, y)
        return math.floor(row), math.floor(column)

    def centre_of(self, cell: tuple[int, int]) -> Point:
        """World position of a cell's centre, in metres."""
        return self.point(cell[0] + 0.5, cell[1] + 0.5)

    def corner_of(self, cell: tuple[int, int]) -> Point:
        """World position of the corner of a cell nearest to cell (0, 0), in metres."""
        return self.point(float(cell[0]), float(cell[1]))

    def point(self, row: Numbers, column: Numbers) -> tuple[Numbers, Numbers]:
        """World position in metres of rows and columns from the map's origin, with fractions."""
        cos, sin = self._heading()
        along, across = row * self.resolution, column * self.resolution
        return self.x + cos * along - sin * across, self.y + sin * along + cos * across

    def _cells_to(self, x: float, y: float) -> Point:
        """The rows and columns from the origin of the map to a world position, as fractions."""
        cos, sin = self._heading()
        east, north = x - self.x, y - self.y
        along, across = cos * east + sin * north, cos * north - sin * east
        return along / self.resolution, across / self.resolution

    def _frame(self) -> tuple[object, ...]:
        return self.resolution, self.x, self.y, self.angle, self.markers, self.start

    def _heading(self) -> Point:
        return portable.cos_sin(math.radians(self.angle))


# --- map files ------------------------------------------------------------------------------------


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


@fast_dataclass
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


@fast_dataclass
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


# --- images ---------------------------------------------------------------------------------------


# Limits of the memory that a damaged or hostile file can take.
_MAX_CELLS = 100_000_000
_MAX_BYTES = 800_000_000

INSTALL = f"install it with: {install('maps')}"


@fast_dataclass
class FloorImage:
    """Brightness levels from 0 to `most`, (height, width), top row first, and hidden pixels."""

    levels: NDArray[np.uint16]
    most: int
    hidden: NDArray[np.bool_] | None = None


def read_image(path: Path) -> FloorImage:
    """Decode an image file; raises MapError, naming the file, for invalid input."""
    data = read_bytes(path, _MAX_BYTES)
    is_pgm = path.suffix.lower() == ".pgm" or data[:2] in (b"P2", b"P5")
    return _read_pgm(path, data) if is_pgm else _read_with_pillow(path)


def read_bytes(path: Path, most: int) -> bytes:
    """Contents of a file of at most `most` bytes; raises MapError, naming the file."""
    try:
        if not path.is_file():
            raise MapError(f"{path}: not a file; expected a map or its image. Check the name")
        size = path.stat().st_size
        if size > most:
            raise MapError(f"{path}: has {size} bytes; expected at most {most}")
        note_read(path)
        return path.read_bytes()
    except OSError as error:
        raise MapError(f"{path}: cannot read: {error.strerror}; check its permissions") from None


def _check_size(path: Path, width: int, height: int) -> None:
    if not 0 < width * height <= _MAX_CELLS:
        raise MapError(
            f"{path}: the image is {width} x {height}; expected 1 to {_MAX_CELLS} pixels. "
            "Scale it down or use a coarser resolution"
        )


_SPACE = b" \t\n\v\f\r"
_GAP = re.compile(rb"(?:[ \t\n\v\f\r]|#[^\n\r]*[\n\r])+")
_NUMBER = re.compile(rb"[0-9]{1,9}(?![0-9])")
_COMMENT = re.compile(rb"#[^\n\r]*")


def _read_pgm(path: Path, data: bytes) -> FloorImage:
    """Decode a PGM image, plain (P2) or raw (P5), 8 or 16 bits, as specified in netpbm's pgm(5)."""
    if data[:2] not in (b"P2", b"P5"):
        raise MapError(f"{path}: starts with {data[:2]!r}; expected P2 or P5, a PGM image")
    width, at = _header_number(path, data, 2, "width")
    height, at = _header_number(path, data, at, "height")
    most, at = _header_number(path, data, at, "maxval")
    _check_size(path, width, height)
    if not 1 <= most <= 65535:
        raise MapError(f"{path}: maxval is {most}; expected 1 to 65535")
    if at >= len(data) or data[at] not in _SPACE:
        raise MapError(f"{path}: maxval is followed by {data[at : at + 1]!r}; expected white space")
    read_levels = _plain_levels if data[:2] == b"P2" else _raw_levels
    levels = read_levels(path, data[at + 1 :], width * height, most)
    if levels.max() > most:
        raise MapError(f"{path}: a pixel is {levels.max()}; expected at most maxval, {most}")
    return FloorImage(levels.astype(np.uint16).reshape(height, width), most)


def _header_number(path: Path, data: bytes, at: int, name: str) -> tuple[int, int]:
    """The number after a gap, and the offset where it ends."""
    gap = _GAP.match(data, at)
    number = gap and _NUMBER.match(data, gap.end())
    if not number:
        raise MapError(
            f"{path}: {name} is invalid: {data[at : at + 12]!r} at byte {at}; "
            "expected white space and a number of at most 9 digits"
        )
    return int(number.group()), number.end()


def _raw_levels(path: Path, body: bytes, count: int, most: int) -> NDArray[np.integer]:
    kind = np.dtype(np.uint8 if most < 256 else ">u2")
    size = count * kind.itemsize
    if len(body) < size or body[size:].strip(_SPACE):
        raise MapError(
            f"{path}: {len(body)} bytes follow the header; expected {size}, "
            f"{kind.itemsize} for each of {count} pixels. The file is damaged"
        )
    return np.frombuffer(body, kind, count)


def _plain_levels(path: Path, body: bytes, count: int, _most: int) -> NDArray[np.integer]:
    words = _COMMENT.sub(b"", body).split()
    if len(words) != count:
        raise MapError(
            f"{path}: {len(words)} numbers follow the header; expected {count}, "
            "one per pixel. The file is damaged"
        )
    strange = next((word for word in words if not _NUMBER.fullmatch(word)), None)
    if strange is not None:
        raise MapError(f"{path}: invalid pixel {strange[:20]!r}; expected a number")
    return np.array([int(word) for word in words], np.int64)


def _read_with_pillow(path: Path) -> FloorImage:
    try:
        from PIL import Image  # late: maps in PGM need no library
    except ImportError:
        raise MapError(f"{path}: images other than PGM need Pillow; {INSTALL}") from None
    try:
        note_read(path)
        with Image.open(path) as image:
            # Pillow has read the header only, so an image that is too large is rejected before it
            # is decoded.
            _check_size(path, *image.size)
            # Modes of 16 and 32 bits, which RGBA would cut off.
            deep = image.mode.startswith("I")
            if image.mode in ("1", "L") and not image.has_transparency_data:
                # The same brightness as below, without four channels.
                return FloorImage(np.asarray(image.convert("L"), np.uint16), 255)
            pixels = np.asarray(image if deep else image.convert("RGBA"))
    except MapError:
        raise
    except Exception as error:  # decoders raise many types for damaged files
        raise MapError(f"{path}: not a readable image: {error}; expected PGM or PNG") from None
    if deep:
        return FloorImage(np.clip(pixels, 0, 65535).astype(np.uint16), 65535)
    # The sum instead of the mean of the channels, which would have to be rounded.
    shades = pixels[..., :3].sum(axis=2, dtype=np.uint16)
    return FloorImage(shades, 3 * 255, pixels[..., 3] < 255)


# --- places on a map ------------------------------------------------------------------------------


_MIN_BLOCK_M = 0.1
_MAX_BLOCKS = 20_000
_DIAGONAL = math.sqrt(2.0)


def free_component(
    floor: OccupancyMap, radius_m: float, at: Point | None = None
) -> NDArray[np.bool_]:
    """Cells where a disc of this radius (m) fits and between which it can move.

    Of several such regions, the one that contains the point `at` (m, world frame), or without `at`
    the largest, the first among equals. Bool, in the shape of the map's cells. Raises MapError if
    the disc fits nowhere, or not at the point.
    """
    labels = _labels(floor, radius_m)
    if at is not None:
        return labels == _label_at(floor, labels, radius_m, at)
    sizes = np.bincount(labels.ravel())
    if sizes.size == 1:
        raise MapError(
            f"a disc of radius {radius_m} m fits nowhere on the map of "
            f"{labels.shape[0]} x {labels.shape[1]} cells of {floor.resolution} m; "
            "use a smaller radius, or check the map's thresholds"
        )
    return labels == 1 + int(np.argmax(sizes[1:]))


def roomiest(floor: OccupancyMap, radius_m: float, at: Point | None = None) -> MapPose:
    """The position with the most clearance in that region, as (x, y, 0 degrees).

    The first cell among equals. Raises MapError like `free_component`.
    """
    component = free_component(floor, radius_m, at)
    best = np.argmax(np.where(component, floor.room, -1.0))
    row, column = np.unravel_index(best, component.shape)
    return (*_place(floor, (int(row), int(column))), 0.0)


def spread(
    floor: OccupancyMap, count: int, radius_m: float, start: MapPose, least: int | None = None
) -> tuple[Marker, ...]:
    """Up to `count` positions, "A", "B", "C" and on, far from the start and from each other.

    Farthest-point sampling [Gonzalez 1985]: each position is the farthest, by path, from the start
    and all previous ones. Paths are measured over blocks of cells, 0.1 m or larger to bound their
    number. Where positions with twice the radius of clearance exist, only those are used, so that a
    robot can turn. Raises MapError if the robot does not fit at the start, or if fewer than `least`
    (default: `count`) positions exist.
    """
    component = free_component(floor, radius_m, start[:2])
    room = np.where(component, floor.room, 0.0)
    row, column = floor.cell_at(start[0], start[1])
    cells = list(islice(_far_cells(floor, room, radius_m, (row, column)), count))
    if len(cells) < (count if least is None else least):
        raise MapError(
            f"there is room for {len(cells)} places a robot's width apart, of {count} "
            f"requested; use fewer, or a radius smaller than {radius_m} m"
        )
    return tuple([Marker(_name(index), *_place(floor, cell)) for index, cell in enumerate(cells)])


def _far_cells(
    floor: OccupancyMap, room: NDArray[np.float64], radius_m: float, start: Cell
) -> Iterator[Cell]:
    """Cells, each the farthest by path from all previous ones, at least a robot's width apart."""
    side = _block_side(floor, room)
    blocks = _blocks(room, side).max(axis=(1, 3))
    roomy = blocks > 2 * _in_cells(floor, radius_m)
    candidates = roomy if roomy.any() else blocks > 0
    # Paths may lead through narrow blocks in which no position may lie.
    distances = np.where(blocks > 0, np.inf, -1.0)
    source = (start[0] // side, start[1] // side)
    while True:
        lower(distances, source)
        far = np.where(candidates, distances, -1.0)
        source = divmod(int(np.argmax(far)), far.shape[1])
        if far[source] * side <= 2 * _in_cells(floor, radius_m):
            return
        yield _roomiest_cell(room, source, side)


@lru_cache(maxsize=1)
def _labels(floor: OccupancyMap, radius_m: float) -> NDArray[np.intp]:
    """Regions in which a disc of this radius can move; cached, as several functions use them."""
    # Not by `room`: the distances of all cells take ten times as long as cells within one radius.
    radius = min(_in_cells(floor, radius_m), float(sum(floor.cells.shape)))
    labels = regions(~inflate(_walled(floor.obstacles), radius)[1:-1, 1:-1])
    labels.setflags(write=False)
    return labels


def _walled(obstacles: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """A grid with obstacles all around it."""
    return np.pad(obstacles, 1, constant_values=True)


def _in_cells(floor: OccupancyMap, radius_m: float) -> float:
    if not (math.isfinite(radius_m) and radius_m > 0):
        raise MapError(f"the radius is {radius_m}; expected metres > 0")
    return radius_m / floor.resolution


def _place(floor: OccupancyMap, cell: Cell) -> Point:
    """The cell's centre, rounded to 0.1 mm so that coordinates print without rounding noise."""
    x, y = floor.centre_of(cell)
    return round(x, 4), round(y, 4)


def _label_at(floor: OccupancyMap, labels: NDArray[np.intp], radius_m: float, at: Point) -> int:
    label = int(labels[floor.cell_at(*at)]) if floor.holds(*at) else 0
    if not label:
        raise MapError(
            f"a disc of radius {radius_m} m does not fit at ({at[0]}, {at[1]}) m; "
            "expected a position on the map, free and that far from walls. Use another one, or a "
            "smaller radius"
        )
    return label


def regions(free: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Connected regions of free cells, numbered from 1; 0 where not free.

    Cells connect by their sides; a diagonal without a cut corner connects no further cells. Runs
    along the rows are merged where they touch, which takes far fewer steps than cell by cell.
    """
    # Number the runs of free cells along the rows.
    begins = free & ~np.pad(free, ((0, 0), (1, 0)))[:, :-1]
    runs = np.where(free, np.cumsum(begins).reshape(free.shape), 0)
    touching = free[:-1] & free[1:]
    most = int(runs.max(initial=0)) + 1
    # Pairs of touching runs, each as one integer, so that sorting brings repeats together.
    pairs = np.sort(runs[:-1][touching] * most + runs[1:][touching])
    roots = list(range(most))
    for run, neighbour in (divmod(pair, most) for pair in pairs[_firsts(pairs)].tolist()):
        # Merge by union-find. The lower number becomes the root, so regions are numbered in the
        # order of their first cells.
        first, second = sorted((_root(roots, run), _root(roots, neighbour)))
        roots[second] = first
    merged = np.array([_root(roots, run) for run in range(most)])
    # Renumber the remaining roots without gaps; 0 stays for blocked cells.
    numbers = np.cumsum(np.bincount(merged, minlength=most) > 0) - 1
    return numbers[merged][runs]


def _firsts(ordered: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Mask of items of a sorted array that differ from their predecessors."""
    return np.concatenate((np.ones(min(1, ordered.size), np.bool_), ordered[1:] != ordered[:-1]))


def _root(roots: list[int], run: int) -> int:
    while roots[run] != run:
        # Path halving keeps the trees flat.
        roots[run] = roots[roots[run]]
        run = roots[run]
    return run


def _block_side(floor: OccupancyMap, room: NDArray[np.float64]) -> int:
    """Side of a block in cells."""
    side = max(1, round(_MIN_BLOCK_M / floor.resolution))
    return max(side, math.ceil(math.sqrt(np.count_nonzero(room) / _MAX_BLOCKS)))


def _blocks(room: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    """The grid as blocks, (block rows, side, block columns, side), padded with 0."""
    rows, columns = room.shape
    padded = np.pad(room, ((0, -rows % side), (0, -columns % side)))
    return padded.reshape(padded.shape[0] // side, side, padded.shape[1] // side, side)


def _roomiest_cell(room: NDArray[np.float64], block: Cell, side: int) -> Cell:
    inside = _blocks(room, side)[block[0], :, block[1], :]
    row, column = divmod(int(np.argmax(inside)), side)
    return block[0] * side + row, block[1] * side + column


def lower(distances: NDArray[np.float64], source: Cell) -> None:
    """Lower distances (in blocks, -1 where blocked) in place by paths from another source.

    Dijkstra's algorithm (1959), pruned where another source is closer.
    """
    width = distances.shape[1] + 2
    # A list, because reading single items of an array is slow.
    flat: list[float] = np.pad(distances, 1, constant_values=-1.0).ravel().tolist()
    first = (source[0] + 1) * width + source[1] + 1
    flat[first] = 0.0
    queue = [(0.0, first)]
    while queue:
        distance, cell = heappop(queue)
        # A shorter path to this cell was found after the entry had been queued.
        if distance > flat[cell]:
            continue
        for step, length in _moves(flat, cell, width):
            if distance + length < flat[cell + step]:
                flat[cell + step] = distance + length
                heappush(queue, (distance + length, cell + step))
    distances[:] = np.array(flat).reshape(-1, width)[1:-1, 1:-1]


def _moves(flat: list[float], cell: int, width: int) -> list[tuple[int, float]]:
    down, up = flat[cell + width] >= 0, flat[cell - width] >= 0
    right, left = flat[cell + 1] >= 0, flat[cell - 1] >= 0
    moves = [(width, 1.0), (-width, 1.0), (1, 1.0), (-1, 1.0)]
    if down and right:
        moves.append((width + 1, _DIAGONAL))
    if down and left:
        moves.append((width - 1, _DIAGONAL))
    if up and right:
        moves.append((1 - width, _DIAGONAL))
    if up and left:
        moves.append((-1 - width, _DIAGONAL))
    return moves


def _name(index: int) -> str:
    """A, B, ..., Z, AA, AB, ..., like spreadsheet columns."""
    before, letter = divmod(index, 26)
    return (_name(before - 1) if before else "") + chr(ord("A") + letter)
