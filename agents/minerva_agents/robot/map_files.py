"""Map files: PGM and YAML for the map_server, and a PNG picture."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.drift import save_plot
from minerva_agents.robot.mapping import Drawn, draw_map
from minerva_agents.robot.occupancy import FREE, OCCUPIED, OccupancyMap
from minerva_agents.robot.posing import NEAR
from minerva_bus.errors import MisuseError
from minerva_bus.outputs import check_output, write_output
from minerva_bus.wording import install
from minerva_bus.world.recordings import MapChoice, Progress, Recording

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw as Pen

# The shades that the map_server's own map_saver writes.
_BLACK, _GREY, _WHITE = 0, 205, 254
_WIDTH: Final = 1400
_MAX_PIXELS: Final = 6000
_SHADES: Final = {"free": (252, 252, 250), "unknown": (222, 224, 227), "wall": (28, 32, 38)}
_WAY: Final = (226, 111, 32)
_START: Final = (32, 140, 90)


def save_map(occupancy: OccupancyMap, image: Path) -> Path:
    """Write a map as PGM with a YAML file next to it; returns the path of the YAML file.

    `load_map` and the map_server read the same cells from it. Raises MisuseError.
    """
    check_name(image)
    shades = _shades(occupancy.cells)
    header = f"P5\n{shades.shape[1]} {shades.shape[0]}\n255\n".encode()
    yaml = image.with_suffix(".yaml")
    write_output(image, header + shades.tobytes(), "map")
    write_output(yaml, _yaml(occupancy, image.name).encode(), "map")
    return yaml


def save_picture(drawn: Drawn, path: Path) -> None:
    """Draw a map with the robot's path as PNG. Raises MisuseError."""
    try:
        from PIL import Image, ImageDraw  # late: optional dependency (extra "maps")
    except ImportError:
        raise MisuseError(
            f"{path}: pictures need Pillow; install it with: {install('maps')}"
        ) from None
    image = Image.fromarray(_colours(drawn.map.cells))
    zoom = min(max(1, round(_WIDTH / max(image.size))), max(1, _MAX_PIXELS // max(image.size)))
    image = image.resize((image.width * zoom, image.height * zoom), Image.Resampling.NEAREST)
    pen, scale = ImageDraw.Draw(image), zoom / drawn.cell
    way = (drawn.way - (drawn.x, drawn.y)) * scale
    points = [(x, image.height - y) for x, y in way.tolist()]
    pen.line(points, fill=_WAY, width=max(1, image.width // 700))
    for (x, y), colour in ((points[0], _START), (points[-1], _WAY)):
        radius = max(3, image.width // 200)
        pen.ellipse((x - radius, y - radius, x + radius, y + radius), fill=colour, outline="white")
    _draw_scale(pen, image.size, scale)
    content = io.BytesIO()
    image.save(content, "png")
    write_output(path, content.getvalue(), "picture")


def check_name(image: Path) -> None:
    """Raise MisuseError if the map cannot be written under this name."""
    if image.suffix.lower() != ".pgm":
        raise MisuseError(f"{image}: maps are written as PGM; choose a name that ends in .pgm")
    if not image.parent.is_dir():
        raise MisuseError(f"{image}: folder {image.parent} does not exist; create it first")


def _shades(cells: NDArray[np.int16]) -> NDArray[np.uint8]:
    """Cells [x, y] as an image, top row first."""
    shades = np.where(cells == OCCUPIED, _BLACK, np.where(cells == FREE, _WHITE, _GREY))
    return np.ascontiguousarray(shades.T[::-1].astype(np.uint8))


def _yaml(occupancy: OccupancyMap, image: str) -> str:
    lines = [
        f"image: {json.dumps(image)}",
        "mode: trinary",
        f"resolution: {occupancy.resolution:.9g}",
        f"origin: [{occupancy.x:.9g}, {occupancy.y:.9g}, 0.0]",
        "negate: 0",
        "occupied_thresh: 0.65",
        # The shade for unknown, 205, is an occupancy of 0.19608, just above this threshold.
        "free_thresh: 0.196",
    ]
    if occupancy.start is not None:
        x, y, angle = occupancy.start
        lines.append(f"start: [{x:.6g}, {y:.6g}, {angle:.6g}]")
    return "\n".join(lines) + "\n"


def _colours(cells: NDArray[np.int16]) -> NDArray[np.uint8]:
    colours = np.array([_SHADES["unknown"], _SHADES["free"], _SHADES["wall"]], np.uint8)
    kinds = np.where(cells == OCCUPIED, 2, np.where(cells == FREE, 1, 0))
    return np.ascontiguousarray(colours[kinds.T[::-1]])


def _draw_scale(pen: Pen, size: tuple[int, int], scale: float) -> None:
    """Draw a scale bar of round length in the lower left corner."""
    width, height = size
    wanted = width / scale / 6
    length = max(length for length in _LENGTHS if length <= max(wanted, _LENGTHS[0]))
    text = f"{length:g} m"
    left, bottom, right = width // 50, height - height // 50 - 1, width // 50 + length * scale
    pen.line([(left, bottom), (right, bottom)], fill=_SHADES["wall"], width=max(1, width // 400))
    pen.text((left, bottom - width // 45), text, fill=_SHADES["wall"], font_size=width // 60)


_LENGTHS: Final = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def draw(
    open: Callable[[], Recording], into: Path, choice: MapChoice, progress: Progress
) -> list[str]:
    """Draw the map of a recording into files (a `Mapper`). Raises MinervaError."""
    check_name(into)
    # Checked first, because drawing takes long.
    for suffix in (".pgm", ".yaml", ".png"):
        check_output(into.with_suffix(suffix), "map")
    picture = into.with_suffix(".png")
    drawn = draw_map(open, choice, progress)
    yaml = save_map(drawn.map, into)
    notes = [_summary(drawn, yaml)]
    if drawn.left_out:
        notes.append(f"{drawn.left_out} scans skipped: no odometry within {NEAR:g} s")
    if drawn.uncorrected:
        notes.append(
            f"{drawn.uncorrected} scans not corrected for the robot's motion: no odometry covers"
            " their times. If the lidar has its own clock, set --time-offset"
        )
    notes += drawn.notes
    try:
        # The map is complete without its picture, for which Pillow may be missing.
        save_picture(drawn, picture)
        notes.append(f"{picture}: the map as a picture")
    except MisuseError as error:
        notes.append(f"no picture: {error}")
    return notes + _errors(drawn, into, choice.poses)


def _errors(drawn: Drawn, into: Path, poses: str) -> list[str]:
    """Trajectory errors and their plot, where published poses are known."""
    drift = drawn.drift
    if drift is None:
        return []
    notes = [f"{poses}, relative to the published poses: {drift.taken}"]
    if poses != "odometry" and drift.chained is not None:
        notes.append(f"odometry alone: {drift.chained}")
    path = into.with_name(f"{into.stem}-errors.png")
    try:
        save_plot(drift, path)
    except MisuseError as error:
        return [*notes, f"no plot: {error}"]
    return [*notes, f"{path}: errors over time"]


def _summary(drawn: Drawn, yaml: Path) -> str:
    rows, columns = drawn.grid.shape
    high, wide = rows * drawn.cell, columns * drawn.cell
    return (
        f"{yaml}: {high:.1f} x {wide:.1f} m in cells of {drawn.cell:g} m,"
        f" from {len(drawn.way)} scans"
    )
