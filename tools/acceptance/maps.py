"""Maps of ROS 2: cells, scale and origin of the maps of nav2, and a world on them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from minerva_agents.robot.grid import MapError
from minerva_agents.robot.maps import OccupancyMap, load_map
from minerva_bus import MinervaError, run
from tools.acceptance.suite import MissingSuiteError, Outcome, Result, Suite, judged

NO_IMAGE = "the repository has no such image: the map is refused with the name of the file"
FRAMES = 3

_NUMBERS = re.compile(r"g_valid_image_content\[\] = \{([^}]*)\}")


def _keys(path: Path) -> dict[str, Any]:
    import yaml

    return yaml.safe_load(path.read_text(encoding="utf-8"))


def _cells(image: Path, keys: dict[str, Any]) -> Any:
    """The cells of a map in the modes trinary and scale, as the map_server's page defines them."""
    from PIL import Image

    shade = np.asarray(Image.open(image).convert("L"), dtype=float) / 255
    occupancy = shade if keys["negate"] else 1 - shade
    cells = np.full(shade.shape, -1)
    cells[occupancy < keys["free_thresh"]] = 0
    cells[occupancy > keys["occupied_thresh"]] = 100
    return cells


def _problems(floor: OccupancyMap, cells: Any, keys: dict[str, Any]) -> Iterator[str]:
    """What differs from cells in the order of an image, and from the keys of the file."""
    ours = floor.cells.T[::-1]
    if ours.shape != cells.shape:
        yield f"{ours.shape} cells; expected {cells.shape}"
    elif (ours != cells).any():
        yield f"{(ours != cells).sum()} cells differ"
    x, y, turn = keys["origin"]
    if (floor.resolution, floor.x, floor.y) != (keys["resolution"], x, y):
        yield f"a cell has {floor.resolution} m, at {floor.x}, {floor.y}"
    if abs(np.radians(floor.angle) - turn) > 1e-12:
        yield f"turned by {floor.angle}°"


def _map_results(path: Path, name: str) -> Iterator[Result]:
    keys = _keys(path)
    image = path.parent / keys["image"]
    try:
        floor = load_map(path)
    except MapError as error:
        refused = not image.exists() and image.name in str(error)
        outcome = Outcome.EXPECTED if refused else Outcome.FAILED
        yield Result(name, outcome, NO_IMAGE if refused else str(error))
        return
    yield judged(name, _problems(floor, _cells(image, keys), keys))
    if keys.get("mode") != "scale" and "keepout" not in path.stem:  # Those are filters of maps.
        yield judged(f"{name}, the world robot", _robot_problems(path))


def _robot_problems(path: Path) -> Iterator[str]:
    try:
        done = run("robot", frames=FRAMES, map=str(path))
    except MinervaError as error:
        yield str(error)
    else:
        if done.frames != FRAMES:
            yield f"it ends after {done.frames} frames"


def _format_results(folder: Path) -> Iterator[Result]:
    """The same map in the formats of images, with the cells that the suite's own tests expect."""
    source = (folder / "test_constants.cpp").read_text(encoding="utf-8")
    text = _NUMBERS.search(source)
    numbers = [int(number) for number in text[1].split(",") if number.strip()] if text else []
    cells = np.array(numbers).reshape(10, 10)[::-1]
    written = (folder / "testmap.yaml").read_text(encoding="utf-8")
    with TemporaryDirectory(prefix="minerva-acceptance-") as place:
        for image in sorted(folder.glob("testmap.[!y]*")):
            file = Path(place, "map.yaml")
            file.write_text(written.replace("testmap.png", str(image)), encoding="utf-8")
            yield judged(image.name, _problems(load_map(file), cells, _keys(file)))


def _results(folder: Path) -> Iterator[Result]:
    if not (find_spec("yaml") and find_spec("PIL")):
        raise MissingSuiteError("it needs PyYAML and Pillow: pip install 'minerva-bus[maps]'")
    tests = folder / "nav2_map_server" / "test"
    for path in (*sorted(folder.rglob("maps/*.yaml")), tests / "invalid_image.yaml"):
        yield from _map_results(path, str(path.relative_to(folder).with_suffix("")))
    yield from _format_results(tests)


NAV2 = Suite(
    "nav2",
    "ros-navigation/navigation2",
    ".",
    "the reader of maps: cells, scale and origin; the world `robot` on these maps",
    _results,
)
