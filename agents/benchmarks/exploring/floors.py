"""Floors to explore: generated from seeds, and downloaded maps if they are available.

Generated floors are bool matrices [row, column] of cells of a given side in metres; True is solid.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.maps import FREE, OCCUPIED, MapPose, OccupancyMap, load_map

Solid: TypeAlias = NDArray[np.bool_]

DATA = Path(__file__).parents[4] / "shared" / "data"
_WALL = 0.15


@dataclass(frozen=True, slots=True)
class Named:
    """A floor with its name, and whether it was held out from tuning."""

    name: str
    floor: OccupancyMap
    held_out: bool


def empty(metres: float, side: float) -> Solid:
    """A hall with outer walls only."""
    count = round(metres / side)
    solid = np.zeros((count, count), np.bool_)
    edge = max(1, round(_WALL / side))
    solid[:edge] = solid[-edge:] = True
    solid[:, :edge] = solid[:, -edge:] = True
    return solid


def _squares(metres: float, side: float, count: int) -> Solid:
    """A hall divided by walls into `count` by `count` squares without doors."""
    step, solid = metres / count, empty(metres, side)
    for index in range(1, count):
        _box(solid, side, index * step - _WALL / 2, 0, index * step + _WALL / 2, metres)
        _box(solid, side, 0, index * step - _WALL / 2, metres, index * step + _WALL / 2)
    return solid


def hall(metres: float, side: float, seed: int) -> Solid:
    """An empty hall, identical for all seeds."""
    return empty(metres, side)


def start_in_hall(metres: float, seed: int) -> MapPose:
    """Random start of the robot in a hall, the only difference between halls."""
    chance = random.Random(f"hall {metres} {seed}")
    x, y = (round(chance.uniform(1.0, metres - 1.0), 2) for _ in range(2))
    return x, y, chance.uniform(-180.0, 180.0)


def pillars(metres: float, side: float, seed: int) -> Solid:
    """Square pillars of 0.4 m on a grid, each slightly displaced."""
    solid, chance = empty(metres, side), random.Random(f"pillars {seed}")
    step = chance.uniform(2.0, 3.5)
    for row in range(1, int(metres / step)):
        for column in range(1, int(metres / step)):
            x, y = row * step + chance.uniform(-0.3, 0.3), column * step + chance.uniform(-0.3, 0.3)
            _box(solid, side, x - 0.2, y - 0.2, x + 0.2, y + 0.2)
    return solid


def clutter(metres: float, side: float, seed: int) -> Solid:
    """Boxes and discs of many sizes at random places."""
    solid, chance = empty(metres, side), random.Random(f"clutter {seed}")
    rows, columns = np.ogrid[: solid.shape[0], : solid.shape[1]]
    for _ in range(int(metres * metres * chance.uniform(0.06, 0.12))):
        x, y = chance.uniform(0, metres), chance.uniform(0, metres)
        size = chance.uniform(0.1, 0.9)
        if chance.random() < 0.5:
            wide = chance.uniform(0.1, 0.9)
            _box(solid, side, x - size, y - wide, x + size, y + wide)
        else:
            near = _span(x, size, side, len(solid)), _span(y, size, side, len(solid))
            far = (rows[near[0]] * side - x) ** 2 + (columns[:, near[1]] * side - y) ** 2
            solid[near] |= far <= size * size
    return solid


def maze(metres: float, side: float, seed: int) -> Solid:
    """A maze with few loops from removed walls; corridors are 1.2 to 2 m wide."""
    chance = random.Random(f"maze {seed}")
    count = max(3, int(metres / chance.uniform(1.4, 2.2)))
    step, solid = metres / count, _squares(metres, side, count)
    for first, second in [*_tree(count, chance), *_loops(count, chance)]:
        _open(solid, side, step, first, second, (step - _WALL) / 2)
    return solid


def rooms(metres: float, side: float, seed: int) -> Solid:
    """Rooms of 3 to 6 m with doors of 0.8 to 1.1 m to some of their neighbours."""
    chance = random.Random(f"rooms {seed}")
    count = max(2, int(metres / chance.uniform(3.0, 6.0)))
    step, solid = metres / count, _squares(metres, side, count)
    for first, second in [*_tree(count, chance), *_loops(count, chance), *_loops(count, chance)]:
        shift = chance.uniform(-0.3, 0.3) * step
        _open(solid, side, step, first, second, chance.uniform(0.4, 0.55), shift)
    return solid


def office(metres: float, side: float, seed: int) -> Solid:
    """Corridors of 2 m, offices of 3 to 5 m on both sides, one door each, and some furniture."""
    solid, chance = empty(metres, side), random.Random(f"office {seed}")
    deep = chance.uniform(4.0, 5.0)
    left = 0.0
    while left + 2 * deep + 2.0 <= metres + 0.5:
        for wall in (left + deep, left + deep + 2.0, left + 2 * deep + 2.0):
            _box(solid, side, wall - _WALL / 2, 0, wall + _WALL / 2, metres)
        for low, door in ((left, left + deep), (left + deep + 2.0, left + deep + 2.0)):
            _offices(solid, side, metres, (low, low + deep, door), chance)
        left += 2 * deep + 2.0
    corridors = int(left / (2 * deep + 2.0))
    for index in range(1, corridors):
        wall = index * (2 * deep + 2.0)
        _box(solid, side, wall - deep - 0.3, 0.3, wall + deep + 0.3, 2.0, value=False)
    return solid


KINDS: dict[str, Callable[[float, float, int], Solid]] = {
    "hall": hall,
    "pillars": pillars,
    "clutter": clutter,
    "maze": maze,
    "rooms": rooms,
    "office": office,
}


def generated(seed: int, *, held_out: bool) -> Iterator[Named]:
    """A floor of each kind in several sizes, from 10 m to 200 m."""
    for kind, sizes in (
        ("hall", (10, 25, 60)),
        ("pillars", (10, 30)),
        ("clutter", (15, 30)),
        ("maze", (10, 20)),
        ("rooms", (15, 30)),
        ("office", (24, 40)),
    ):
        for metres in sizes:
            yield Named(f"{kind}-{metres}-{seed}", floor_of(kind, metres, seed), held_out)


def large(seed: int, *, held_out: bool) -> Iterator[Named]:
    """Floors whose runs take minutes."""
    for kind, metres in (("hall", 200), ("pillars", 100), ("rooms", 100), ("office", 100)):
        yield Named(f"{kind}-{metres}-{seed}", floor_of(kind, metres, seed), held_out)


def floor_of(kind: str, metres: float, seed: int) -> OccupancyMap:
    """A generated floor."""
    side = 0.05 if metres <= 60 else 0.1
    solid = KINDS[kind](metres, side, seed)
    cells = np.where(solid, OCCUPIED, FREE).astype(np.int16)
    cells.setflags(write=False)
    start = start_in_hall(metres, seed) if kind == "hall" else None
    return OccupancyMap(cells, side, start=start)


def of_others() -> Iterator[Named]:
    """Maps of ROS and of MovingAI, if they are available.

    The cells of MovingAI's maps have sides of 0.8 m (rooms, whose doors are one cell wide), 0.15 m
    (maze) and 0.4 m (Berlin); the maps are cropped to a size that a robot can explore in minutes.
    """
    for path in ("ros_maps/depot.yaml", "ros_maps/turtlebot3/map.yaml"):
        if (DATA / path).is_file():
            yield Named(
                path.split("/")[-2] if "turtle" in path else "depot", load_map(DATA / path), False
            )
    for name, side, cells in (
        ("32room_000", 0.8, 66),
        ("maze512-8-0", 0.15, 128),
        ("Berlin_0_256", 0.4, 128),
    ):
        path = DATA / "movingai" / f"{name}.map"
        if path.is_file():
            yield Named(name, _movingai(path, side, cells), False)


def _movingai(path: Path, side: float, most: int) -> OccupancyMap:
    lines = path.read_text().splitlines()[4:]
    solid = np.array([[letter not in ".GS" for letter in line] for line in lines])[:most, :most]
    fine = max(1, math.ceil(side / 0.1))
    solid = np.pad(np.kron(solid, np.ones((fine, fine), np.bool_)), 1, constant_values=True)
    cells = np.where(solid, OCCUPIED, FREE).astype(np.int16)
    cells.setflags(write=False)
    return OccupancyMap(cells, side / fine)


def _span(middle: float, reach: float, side: float, count: int) -> slice:
    first = round((middle - reach) / side)
    return slice(max(0, first), max(0, min(count, round((middle + reach) / side) + 1)))


def _box(
    solid: Solid, side: float, x0: float, y0: float, x1: float, y1: float, *, value: bool = True
) -> None:
    """Fill a rectangle given in metres."""
    rows = slice(max(0, round(x0 / side)), max(0, round(x1 / side)))
    columns = slice(max(0, round(y0 / side)), max(0, round(y1 / side)))
    solid[rows, columns] = value


Square: TypeAlias = tuple[int, int]


def _tree(count: int, chance: random.Random) -> Iterator[tuple[Square, Square]]:
    """Pairs of neighbouring squares that form a spanning tree."""
    stack, seen = [(0, 0)], {(0, 0)}
    while stack:
        row, column = stack[-1]
        ways = [(row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)]
        ways = [w for w in ways if w not in seen and 0 <= w[0] < count and 0 <= w[1] < count]
        if not ways:
            stack.pop()
            continue
        other = chance.choice(ways)
        seen.add(other)
        stack.append(other)
        yield (row, column), other


def _loops(count: int, chance: random.Random) -> Iterator[tuple[Square, Square]]:
    for _ in range(count * count // 10):
        row, column = chance.randrange(count - 1), chance.randrange(count - 1)
        yield (row, column), chance.choice([(row + 1, column), (row, column + 1)])


def _open(
    solid: Solid,
    side: float,
    step: float,
    square: Square,
    other: Square,
    half: float,
    shift: float = 0.0,
) -> None:
    """Make a door of width 2 * `half` between two squares, `shift` off the middle of the wall."""
    x, y = (square[0] + other[0] + 1) / 2 * step, (square[1] + other[1] + 1) / 2 * step
    thick = _WALL / 2 + 2 * side
    if square[0] != other[0]:
        _box(solid, side, x - thick, y + shift - half, x + thick, y + shift + half, value=False)
    else:
        _box(solid, side, x + shift - half, y - thick, x + shift + half, y + thick, value=False)


def _offices(
    solid: Solid,
    side: float,
    metres: float,
    span: tuple[float, float, float],
    chance: random.Random,
) -> None:
    low, high, door = span
    y = 0.0
    while y < metres - 1.5:
        wide = chance.uniform(3.0, 5.0)
        end = metres if y + wide > metres - 2.5 else y + wide
        _box(solid, side, low, end - _WALL / 2, high, end + _WALL / 2)
        at, half = chance.uniform(y + 0.8, end - 0.8), chance.uniform(0.4, 0.55)
        thick = _WALL / 2 + 2 * side
        _box(solid, side, door - thick, at - half, door + thick, at + half, value=False)
        desk = chance.uniform(low + 1.2, high - 1.2), chance.uniform(y + 1.0, end - 1.0)
        _box(solid, side, desk[0] - 0.4, desk[1] - 0.3, desk[0] + 0.4, desk[1] + 0.3)
        y = end
