"""A floor from a map_server map, and the ranges of beams on it."""

import numpy as np
from ruamel.yaml import YAML

TOUCH = 1e-9
"""Metres between a beam and a wall that count as touching."""


class Floor:
    """A map_server map: occupied cells, and distances to them."""

    def __init__(self, path):
        options = YAML(typ="safe").load(path.read_text())
        image = read_pgm(path.parent / options["image"])
        dark = image / 255 if options["negate"] else 1 - image / 255
        # Unknown cells are walls, too. Indexed [x, y], y upwards.
        self.walls = (dark >= options["free_thresh"])[::-1].T
        self.cell = options["resolution"]
        self.origin = options["origin"][:2]
        self.start = options.get("start", [0.0, 0.0, 0.0])
        self.markers = options.get("markers", {})

    def ranges(self, x, y, angles, most):
        """Exact distance in metres to the first wall in each direction; inf beyond `most`.

        A beam that passes within `TOUCH` of a wall ends there, as in the simulated laser.
        """
        x0, y0 = (x - self.origin[0]) / self.cell, (y - self.origin[1]) / self.cell
        cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
        reach = most / self.cell
        steps = np.arange(int(reach) + 2)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            down = np.where(cos > 0, np.floor(x0) + 1 + steps - x0, np.ceil(x0) - 1 - steps - x0)
            along = np.where(sin > 0, np.floor(y0) + 1 + steps - y0, np.ceil(y0) - 1 - steps - y0)
            crossings = np.concatenate([down / cos, along / sin], axis=1)
        crossings = np.where(np.isfinite(crossings) & (crossings <= reach), crossings, np.inf)
        probes = np.where(np.isfinite(crossings), crossings, 0)
        touch, hit = TOUCH / self.cell, np.zeros(probes.shape, bool)
        # Each crossing has a cell on both sides, and four cells at a corner.
        for down, along in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            rows = np.floor(x0 + probes * cos + down * touch).astype(int)
            columns = np.floor(y0 + probes * sin + along * touch).astype(int)
            inside = (rows >= 0) & (rows < self.walls.shape[0])
            inside &= (columns >= 0) & (columns < self.walls.shape[1])
            hit |= ~inside | self.walls[np.where(inside, rows, 0), np.where(inside, columns, 0)]
        return np.where(hit, crossings, np.inf).min(axis=1) * self.cell

    def is_free(self, x, y, radius):
        """True if a disc overlaps no wall."""
        row, column = (x - self.origin[0]) / self.cell, (y - self.origin[1]) / self.cell
        reach = radius / self.cell
        first, last = int(row - reach), int(row + reach) + 1
        left, right = int(column - reach), int(column + reach) + 1
        rows, columns = np.mgrid[first:last, left:right]
        near_x = np.clip(row, rows, rows + 1) - row
        near_y = np.clip(column, columns, columns + 1) - column
        walls = self.walls[max(0, first) : last, max(0, left) : right]
        if walls.shape != rows.shape:
            return False
        return not (walls & (near_x**2 + near_y**2 < reach**2)).any()


def read_pgm(path):
    """A binary PGM as rows, top row first."""
    data = path.read_bytes()
    words, at = [], 0
    while len(words) < 4:
        end = at
        while not data[end : end + 1].isspace():
            end += 1
        if data[at : at + 1] == b"#":
            end = data.index(b"\n", at)
        elif end > at:
            words.append(data[at:end])
        at = end + 1
    width, height = int(words[1]), int(words[2])
    return np.frombuffer(data, np.uint8, width * height, at).reshape(height, width)
