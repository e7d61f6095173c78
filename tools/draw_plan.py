"""Draw the robot's floor plan: run `python tools/draw_plan.py`.

An office of 18 m x 12 m in cells of 0.05 m, written as a map_server pair (office.pgm, office.yaml)
into agents/minerva_agents/robot/plan. Lengths are metres from the lower left corner, x to the
right, y up; a box is (left, bottom, right, top), a disc (x, y, radius). Walls are solid black;
furniture has a black outline around an area that no laser can see. Every run writes the same
files.
"""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Box = tuple[float, float, float, float]
Disc = tuple[float, float, float]
Picture = NDArray[np.uint8]
Mask = NDArray[np.bool_]

FOLDER = Path(__file__).parents[1] / "agents" / "minerva_agents" / "robot" / "plan"
WIDTH, HEIGHT, CELL = 18.0, 12.0, 0.05
FREE, UNKNOWN, OCCUPIED = 254, 205, 0

ROOMS: dict[str, tuple[Box, ...]] = {
    "corridor": ((0.2, 5.0, 13.8, 6.6), (12.2, 5.0, 13.8, 11.8)),
    "reception": ((0.2, 0.2, 4.6, 4.85),),
    "office": ((4.75, 0.2, 9.2, 4.85),),
    "workshop": ((9.35, 0.2, 13.8, 4.85),),
    "lab": ((13.95, 0.2, 17.8, 6.6),),
    "kitchen": ((13.95, 6.75, 17.8, 11.8),),
    "meeting": ((6.95, 6.75, 12.05, 11.8),),
    "store": ((4.6, 6.75, 6.8, 9.0),),
    "library": ((0.2, 6.75, 4.45, 11.8), (0.2, 9.15, 6.8, 11.8)),
}

DOORS: dict[str, Box] = {
    "reception": (3.0, 4.85, 4.0, 5.0),
    "office": (5.2, 4.85, 6.2, 5.0),
    "workshop": (11.8, 4.85, 12.8, 5.0),
    "lab": (13.8, 5.3, 13.95, 6.3),
    "kitchen": (13.8, 9.7, 13.95, 10.7),
    "meeting": (7.6, 6.6, 8.6, 6.75),
    "store": (5.2, 6.6, 6.2, 6.75),
    "library": (1.0, 6.6, 2.0, 6.75),
    "from the office to the workshop": (9.2, 1.2, 9.35, 2.2),
    "from the meeting room to the corridor": (12.05, 8.2, 12.2, 9.2),
}

BOXES: tuple[Box, ...] = (
    # reception: a counter with a seat behind it, a sofa
    (2.9, 2.2, 4.6, 2.8), (3.6, 1.6, 4.0, 2.0), (0.2, 2.4, 0.9, 4.2),
    # office: three desks with a chair each, a shelf
    (4.75, 0.7, 5.55, 2.3), (5.65, 1.3, 6.05, 1.7),
    (6.4, 0.2, 8.0, 1.0), (7.0, 1.1, 7.4, 1.5),
    (8.4, 2.8, 9.2, 4.4), (7.9, 3.4, 8.3, 3.8),
    (6.6, 4.5, 8.0, 4.85),
    # workshop: a bench in the middle, shelves, a cabinet
    (10.6, 1.7, 12.3, 2.7), (10.2, 0.2, 13.2, 0.6), (13.3, 1.5, 13.8, 3.3),
    # lab: benches along the wall and in the middle, a shelf
    (17.1, 0.8, 17.8, 5.8), (14.9, 1.9, 16.05, 4.3), (14.4, 0.2, 16.2, 0.6),
    # kitchen: worktops in a corner, a table with four chairs, a fridge
    (17.2, 8.0, 17.8, 11.8), (15.0, 11.2, 17.8, 11.8), (17.1, 6.75, 17.8, 7.45),
    (14.9, 8.0, 16.2, 8.7), (15.05, 8.8, 15.4, 9.15), (15.7, 8.8, 16.05, 9.15),
    (15.05, 7.55, 15.4, 7.9), (15.7, 7.55, 16.05, 7.9),
    # meeting: a sideboard
    (8.3, 11.4, 10.7, 11.8),
    # store: a shelf, crates
    (4.6, 8.6, 6.8, 9.0), (6.35, 8.0, 6.8, 8.5), (4.6, 6.75, 5.0, 7.35),
    # library: shelves along the wall and free ones, an armchair
    (0.2, 7.6, 0.55, 11.4), (1.55, 8.1, 3.5, 8.5), (1.55, 9.6, 3.5, 10.0),
    # corridor: a copier, a cupboard
    (9.6, 6.2, 10.6, 6.6), (12.2, 11.4, 13.4, 11.8),
)  # fmt: skip

DISCS: tuple[Disc, ...] = (
    # the round table of the meeting room, and six chairs
    (9.5, 9.1, 0.75),
    (10.55, 9.1, 0.22), (10.02, 10.0, 0.22), (8.98, 10.0, 0.22),
    (8.45, 9.1, 0.22), (8.98, 8.2, 0.22), (10.02, 8.2, 0.22),
    # the library's reading table and two chairs
    (5.3, 10.55, 0.45), (4.62, 10.55, 0.2), (5.3, 11.25, 0.2),
    # plants, a pillar drill
    (4.2, 0.6, 0.25), (0.55, 5.4, 0.2), (6.5, 9.5, 0.2), (11.65, 11.4, 0.25), (9.85, 4.35, 0.3),
)  # fmt: skip

MARKERS: dict[str, tuple[float, float]] = {
    "reception": (1.4, 1.3),
    "office": (7.0, 2.9),
    "workshop": (11.4, 3.75),
    "lab": (15.3, 5.45),
    "kitchen": (15.6, 10.2),
    "meeting": (11.1, 7.6),
    "store": (5.7, 7.6),
    "library": (2.6, 10.9),
}
START = (1.4, 1.3, 90.0)


def main() -> None:
    """Write both files and print their paths."""
    FOLDER.mkdir(exist_ok=True)
    picture = draw()
    header = f"P5\n{picture.shape[1]} {picture.shape[0]}\n255\n".encode()
    (FOLDER / "office.pgm").write_bytes(header + picture.tobytes())
    (FOLDER / "office.yaml").write_text(describe(), encoding="utf-8", newline="\n")
    print(f"wrote {FOLDER / 'office.pgm'} and {FOLDER / 'office.yaml'}")


def draw() -> Picture:
    """The picture, (240, 360) pixels, top row first."""
    floor = np.full((round(HEIGHT / CELL), round(WIDTH / CELL)), OCCUPIED, np.uint8)
    for boxes in ROOMS.values():
        for box in boxes:
            floor[_box(box)] = FREE
    for box in DOORS.values():
        floor[_box(box)] = FREE
    for shape in (*map(_box, BOXES), *map(_disc, DISCS)):
        inside = _shrunk(shape)
        floor[shape & ~inside] = OCCUPIED
        floor[inside] = UNKNOWN
    return np.ascontiguousarray(floor[::-1])


def describe() -> str:
    """The YAML file, written as JSON, which is also YAML, so that reading it needs no library."""
    keys: dict[str, object] = {
        "image": "office.pgm",
        "resolution": CELL,
        "origin": [0.0, 0.0, 0.0],
        "mode": "trinary",
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
        "start": START,
    }
    lines = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in keys.items()]
    places = [f"    {json.dumps(name)}: {json.dumps(place)}" for name, place in MARKERS.items()]
    lines.append('  "markers": {\n' + ",\n".join(places) + "\n  }")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _box(box: Box) -> Mask:
    left, bottom, right, top = (round(edge / CELL) for edge in box)
    mask = np.zeros((round(HEIGHT / CELL), round(WIDTH / CELL)), np.bool_)
    mask[bottom:top, left:right] = True
    return mask


def _disc(disc: Disc) -> Mask:
    x, y, radius = disc
    rows, columns = np.ogrid[: round(HEIGHT / CELL), : round(WIDTH / CELL)]
    return np.hypot((columns + 0.5) * CELL - x, (rows + 0.5) * CELL - y) <= radius


def _shrunk(shape: Mask) -> Mask:
    """The shape without its outline; rays cannot pass the outline between two corners."""
    inside = shape.copy()
    for down in (-1, 0, 1):
        for across in (-1, 0, 1):
            inside &= np.roll(shape, (down, across), axis=(0, 1))
    return inside


if __name__ == "__main__":
    main()
