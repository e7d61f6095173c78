"""Generated floor plans: rooms and corridors in a raster, connected by doors."""

import json
import random
from itertools import accumulate

import numpy as np

SIDE = 0.05
WALL = 3


def in_cells(metres):
    return round(metres / SIDE)


class FloorPlan:
    """A floor plan, determined by its seed; each room can be reached from each other.

    Robots start in the first room; the marker is in the last one, in a corner or in the middle.
    """

    def __init__(self, seed):
        self.random = random.Random(seed)
        columns, rows = self.random.choice([(2, 1), (2, 2), (3, 1), (3, 2), (2, 3)])
        self.xs = self.lines(columns, 3.2)
        self.ys = self.lines(rows, 2.4)
        self.cells = self.walls()
        self.open_doors()
        self.marker = self.place()

    def lines(self, count, first):
        """Positions of walls along an axis in m; rooms below 2 m are corridors."""
        sides = [self.random.choice([1.5, 2.4, 3.2, 4.0]) for _ in range(count)]
        return list(accumulate([max(first, sides[0]), *sides[1:]], initial=0.0))

    def walls(self):
        cells = np.zeros([in_cells(lines[-1]) + WALL for lines in (self.xs, self.ys)], np.bool_)
        for x in map(in_cells, self.xs):
            cells[x : x + WALL] = True
        for y in map(in_cells, self.ys):
            cells[:, y : y + WALL] = True
        return cells

    def open_doors(self):
        """Doors of a random spanning tree of the rooms, and some more."""
        rooms = [(i, j) for i in range(len(self.xs) - 1) for j in range(len(self.ys) - 1)]
        pairs = [(a, b) for a in rooms for b in ((a[0] + 1, a[1]), (a[0], a[1] + 1)) if b in rooms]
        self.random.shuffle(pairs)
        groups = {room: {room} for room in rooms}
        for a, b in pairs:
            if b in groups[a] and self.random.random() < 0.7:
                continue
            groups[a] |= groups[b]
            for room in groups[a]:
                groups[room] = groups[a]
            self.open_door(a, b)

    def open_door(self, a, b):
        axis = 0 if a[0] != b[0] else 1
        along = (self.ys, self.xs)[axis]
        number = a[1 - axis]
        width = in_cells(self.random.choice([0.8, 0.9, 1.0, 1.2]))
        first, last = in_cells(along[number]) + 2 * WALL, in_cells(along[number + 1]) - WALL - width
        begin = self.random.randint(first, max(first, last))
        wall = in_cells((self.xs, self.ys)[axis][b[axis]])
        cut = np.s_[wall : wall + WALL], np.s_[begin : begin + width]
        self.cells[cut if axis == 0 else cut[::-1]] = False

    def place(self):
        x, y = self.xs[-1], self.ys[-1]
        if self.random.random() < 0.4:
            return [round((x + self.xs[-2]) / 2, 2), round((y + self.ys[-2]) / 2, 2)]
        gap = self.random.choice([0.5, 0.8])
        return [round(x - gap, 2), round(y - gap, 2)]

    def save(self, folder):
        """Write the map for the map_server; returns the path of its YAML file."""
        return save_map(folder, self.cells, self.marker)


def save_map(folder, walls, marker):
    """Write a map with a start at the lower left and one marker, `bed`."""
    image = np.where(walls.T[::-1], 0, 254).astype(np.uint8)
    head = f"P5 {image.shape[1]} {image.shape[0]} 255\n".encode()
    (folder / "plan.pgm").write_bytes(head + image.tobytes())
    keys = {"image": "plan.pgm", "resolution": SIDE, "origin": [0.0, 0.0, 0.0], "negate": 0}
    keys |= {"occupied_thresh": 0.65, "free_thresh": 0.196}
    keys |= {"start": [0.8, 0.8, 90.0], "markers": {"bed": marker}}
    path = folder / "plan.yaml"
    path.write_text(json.dumps(keys))
    return path


def hall(folder, **keys):
    """The map of a hall of 6 m x 4 m, with these keys in its file; returns the path of the file."""
    image = np.zeros((40, 60), np.uint8)
    image[1:-1, 1:-1] = 254
    (folder / "hall.pgm").write_bytes(b"P5\n60 40\n255\n" + image.tobytes())
    written = {"image": "hall.pgm", "resolution": 0.1, "origin": [0.0, 0.0, 0.0], "negate": 0}
    written |= {"occupied_thresh": 0.65, "free_thresh": 0.196}
    (folder / "hall.yaml").write_text(json.dumps(written | keys))
    return str(folder / "hall.yaml")
