"""Draw a map from a recording, into the robot's own kind of grid, with checks of its quality.

Each scan is a frame, each beam that hit something an `eLaser` of the robot: the cells change as in
`ARobot.sense_obstacle`. The first pass determines the size of the grid, the second draws.

The error of a trajectory at a scan is the distance to the published position and the difference of
headings; both trajectories start at the same pose. Because a small initial heading error rotates a
whole trajectory, the error after optimal alignment by rotation and translation is reported too: the
absolute trajectory error of Sturm et al., "A Benchmark for the Evaluation of RGB-D SLAM Systems"
(IROS 2012), as a mean distance.

When a robot revisits a place, both scans should see the same walls. A scan that looks through the
other's walls was placed at a wrong pose, and walls are drawn twice.
"""

from __future__ import annotations

import cmath
import io
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.grid import free, obstacles
from minerva_agents.robot.maps import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from minerva_agents.robot.pose import Reals
from minerva_agents.robot.time_offset import OffsetEstimator
from minerva_agents.robot.trajectories import (
    MIN_LOOP,
    NEAR,
    NO_MOTION,
    Located,
    MapExtent,
    Posed,
    ScanMotion,
    Unposed,
    between,
    canvas_of,
    keyframes_of,
    located_scans,
    place_of,
    posed_scans,
    poses_of,
    seen_through,
    shortened,
    transformed,
)
from minerva_bus import Cells
from minerva_bus.entry_points import entries
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.files import check_output, write_output
from minerva_bus.log.recordings import (
    Compensator,
    Progress,
    Recorded,
    Recording,
    RecordingClock,
    needs_path,
)
from minerva_bus.semantics.poses import Pose
from minerva_bus.values import fast_dataclass
from minerva_bus.wording import counted, install
from minerva_bus.world.readings import Displacement, Odometry, Scan

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw as Pen

POSES: Final = ("published", "odometry", "matched")


@fast_dataclass
class MapChoice:
    """Options of a map of a recording. Raises MisuseError.

    `cell` is the side of a cell and `farthest` the longest range to use (0: as recorded), in
    metres; `begin` and `end` are seconds after the first reading. `poses` selects the poses of the
    robot: those `published` in the recording, those of the `odometry`, or those corrected by scans
    `matched` to the map. `time_offset`, in seconds, is added to the times of scans, because the
    clocks of lidar and odometry may differ.
    """

    cell: float = 0.05
    farthest: float = 0.0
    begin: float = 0.0
    end: float = math.inf
    poses: str = "published"
    time_offset: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.cell < math.inf:
            raise MisuseError(f"the cell is {self.cell:g} m; expected metres above 0")
        if not 0 <= self.farthest < math.inf:
            raise MisuseError(f"the range is {self.farthest:g} m; expected metres, or 0 for all")
        if not 0 <= self.begin < self.end:
            raise MisuseError(
                f"from {self.begin:g} to {self.end:g} s there is nothing; expected from < to,"
                " seconds after the beginning"
            )
        if not math.isfinite(self.time_offset):
            raise MisuseError(f"the time offset is {self.time_offset:g} s; expected seconds")
        if self.poses not in POSES:
            known = f"expected {', '.join(POSES)}"
            raise MisuseError(
                f"there are no poses {self.poses!r}{nearest(self.poses, [*POSES], known)}"
            )


def draw(
    open: Callable[[], Recording], into: Path, choice: MapChoice, progress: Progress
) -> list[str]:
    """Draw the map of a recording into files. Raises MinervaError."""
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


# --- drawing --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """A finished map: grid, path in metres (n, 2), and what was skipped.

    The outer corner of cell (0, 0) of `grid` lies at (`x`, `y`) metres. `drift` compares the path
    with the published one if both exist and differ. `uncorrected` counts scans drawn as if all
    beams had been measured at once, for lack of odometry. `notes` are lines on loops and double
    walls.
    """

    grid: Cells
    cell: float
    x: float
    y: float
    way: NDArray[np.float64]
    angle: float
    left_out: int
    uncorrected: int
    drift: Drift | None = None
    notes: tuple[str, ...] = ()

    @property
    def map(self) -> OccupancyMap:
        """The map in the map_server's form, with the robot's first pose as `start`."""
        grid = self.grid
        known = np.where(obstacles(grid), OCCUPIED, np.where(free(grid), FREE, UNKNOWN))
        start = float(self.way[0, 0]), float(self.way[0, 1]), self.angle
        return OccupancyMap(known.astype(np.int16), self.cell, self.x, self.y, start=start)


def draw_map(open: Callable[[], Recording], choice: MapChoice, progress: Progress) -> Drawn:
    """Draw the map of a recording, which is opened twice. Raises MinervaError."""
    extent, located, uncorrected = MapExtent(), _Trajectory(), 0
    posed_all: list[Posed] = []
    # First pass: estimate the poses, and find the extent of the map.
    with closing(open()) as recording:
        for posed in located.first(recording, choice, lambda part: progress(part / 2)):
            extent.take(posed)
            if isinstance(posed, Posed):
                posed_all.append(posed)
            uncorrected += needs_path(posed.scan)
    canvas = canvas_of(extent, choice.cell)
    # Second pass: draw, now that the size of the grid is known.
    with closing(open()) as recording:
        for posed in located.again(recording, choice, lambda part: progress(0.5 + part / 2)):
            if isinstance(posed, Posed):
                canvas.draw(posed)
    progress(1.0)
    way, angle = np.array(canvas.way), canvas.first_angle
    left_out, drift = extent.unposed, located.drift
    scans, places = [item.scan for item in posed_all], [place_of(item) for item in posed_all]
    # Poses that the recording gives for its scans do not depend on times.
    by_times = not all(item.is_published for item in posed_all) or choice.poses != "published"
    notes = (
        *_window_notes(choice, located.outside),
        *located.notes,
        *(_offset_notes(choice, located.offsets) if by_times else ()),
        *doubling_notes(scans, places, choice.poses),
    )
    return Drawn(
        canvas.grid,
        choice.cell,
        canvas.x,
        canvas.y,
        way,
        angle,
        left_out,
        uncorrected,
        drift,
        notes,
    )


class _Trajectory:
    """Scans with estimated poses; the second pass reuses the first one's."""

    def __init__(self) -> None:
        self._taken: list[tuple[Pose | None, tuple[Displacement, ...]]] = []
        self._points: list[TrajectoryPoint] = []
        self.notes: list[str] = []
        self.outside = Counter[str]()
        self.offsets = OffsetEstimator()

    @property
    def drift(self) -> Drift | None:
        """Errors of the estimated poses."""
        return Drift.of(self._points) if self._points else None

    def first(
        self, recording: Recording, choice: MapChoice, progress: Progress
    ) -> Iterator[Posed | Unposed]:
        is_published = choice.poses == "published"
        part_of_reading = 1.0 if is_published else 0.1
        readings = self.offsets.watched(
            _between(recording, choice, lambda part: progress(part_of_reading * part), Counter())
        )
        if is_published:
            yield from _published(readings, choice)
            return
        # Only then the number of scans is known, by which progress is measured: without odometry,
        # all scans are matched when the last one has been read.
        used = [item for item in readings if isinstance(item.reading, Scan | Odometry)]
        scans = [item.reading for item in used if isinstance(item.reading, Scan)]
        matched, motion, located = choice.poses == "matched", NO_MOTION, list[Located]()
        # The matched poses give the motion by which a second round corrects its scans.
        rounds = 2 if matched and any(map(needs_path, scans)) else 1
        for number in range(rounds):
            located = list[Located]()
            for scan in _located(used, choice, motion):
                located.append(scan)
                progress(0.1 + 0.6 * (number + len(located) / len(scans)) / rounds)
            motion = ScanMotion.of(located)
        if matched:
            located = self._closed(located, lambda part: progress(0.7 + 0.3 * part))
        for scan in located:
            self._remember(scan)
            yield scan.posed

    def _closed(self, located: list[Located], progress: Progress) -> list[Located]:
        """The scans at their poses after loop closure."""
        try:
            from minerva_agents.robot.loop_closure import closed_loops  # late: needs scipy
        except ImportError:
            self.notes.append(
                f"loops are not closed because scipy is missing; install it with: {install('maps')}"
            )
            return located
        known = [scan for scan in located if scan.taken is not None]
        places = [scan.taken for scan in known if scan.taken is not None]
        closed = closed_loops([item.scan for item in known], places, progress)
        if closed.closures or closed.rejected:
            self.notes.append(str(closed))
        at = iter(closed.places)
        return [item if item.taken is None else replace(item, taken=next(at)) for item in located]

    def again(
        self, recording: Recording, choice: MapChoice, progress: Progress
    ) -> Iterator[Posed | Unposed]:
        published = _published(_between(recording, choice, progress, self.outside), choice)
        if choice.poses == "published":
            yield from published
            return
        for posed, (at, path) in zip(published, self._taken, strict=True):
            yield Located(replace(posed.scan, path=path), at, None, None).posed

    def _remember(self, located: Located) -> None:
        self._taken.append((located.taken, located.scan.path))
        if located.taken is not None and located.published is not None:
            self._points.append(
                TrajectoryPoint(
                    located.scan.time, located.published, located.taken, located.chained
                )
            )


def _located(
    readings: Iterable[Recorded], choice: MapChoice, motion: ScanMotion
) -> Iterator[Located]:
    """The scans at estimated poses."""
    return located_scans(
        readings,
        cell=choice.cell,
        farthest=choice.farthest,
        matched=choice.poses == "matched",
        motion=motion,
    )


def _published(readings: Iterable[Recorded], choice: MapChoice) -> Iterator[Posed | Unposed]:
    """The scans to draw, at the recording's own poses."""
    for posed in posed_scans(readings):
        yield replace(posed, scan=shortened(posed.scan, choice.farthest))


def _between(
    recording: Recording, choice: MapChoice, progress: Progress, outside: Counter[str]
) -> Iterator[Recorded]:
    """The readings between the chosen start and end times; others are counted, up to the end."""
    clock = RecordingClock()
    for recorded in Compensator(choice.time_offset).all(recording.readings()):
        progress(recording.part)
        clock.advance(recorded.stamp)
        if clock.seconds > choice.end:
            # Nothing further is read, because a recording may be long.
            outside["after"] += 1
            return
        if clock.seconds < choice.begin:
            outside["before"] += 1
        else:
            yield recorded


def _window_notes(choice: MapChoice, outside: Counter[str]) -> list[str]:
    """Lines on the readings outside the chosen times."""
    notes: list[str] = []
    if outside["before"]:
        readings = counted(outside["before"], "reading")
        notes.append(f"{readings} skipped: before {choice.begin:g} s (--from)")
    if outside["after"]:
        notes.append(f"readings after {choice.end:g} s are not read (--to)")
    return notes


def _offset_notes(choice: MapChoice, offsets: OffsetEstimator) -> list[str]:
    """A line with another time offset, if walls are sharper with it."""
    better = offsets.sharper(choice.cell)
    if better is None:
        return []
    return [
        f"walls are sharper with --time-offset {choice.time_offset + better.offset:.2f}: where the"
        f" robot turns, {1 - better.cells:.0%} fewer cells are hit"
    ]


# --- files ----------------------------------------------------------------------------------------


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


# --- errors of the trajectory ---------------------------------------------------------------------


@fast_dataclass
class TrajectoryPoint:
    """Poses of a scan at `time` seconds: published, estimated, and by odometry alone."""

    time: float
    published: Pose
    taken: Pose
    chained: Pose | None


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Errors along a trajectory, (n,) each: metres, degrees, and metres after alignment."""

    metres: Reals
    degrees: Reals
    aligned: Reals

    def __str__(self) -> str:
        return (
            f"mean {self.metres.mean():.2f} m, maximum {self.metres.max():.2f} m;"
            f" heading {self.degrees.mean():.1f} degrees, maximum {self.degrees.max():.1f};"
            f" aligned {self.aligned.mean():.2f} m, maximum {self.aligned.max():.2f} m"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """Errors over time in seconds, (n,), and those of pure odometry where it is complete."""

    seconds: Reals
    taken: Errors
    chained: Errors | None

    @staticmethod
    def of(points: Sequence[TrajectoryPoint]) -> Drift:
        """Errors of a trajectory of at least one point."""
        published = [point.published for point in points]
        chained = [point.chained for point in points if point.chained is not None]
        return Drift(
            np.array(seconds_of([point.time for point in points])),
            errors_of([point.taken for point in points], published),
            errors_of(chained, published) if len(chained) == len(points) else None,
        )


def errors_of(taken: Sequence[Pose], published: Sequence[Pose]) -> Errors:
    """Errors of estimated poses against as many published ones."""
    turns = [estimate.angle - pose.angle for estimate, pose in zip(taken, published, strict=True)]
    degrees = np.abs([math.remainder(turn, 360.0) for turn in turns])
    ours, theirs = (
        np.array([complex(pose.x, pose.y) for pose in way]) for way in (taken, published)
    )
    here, there = ours - ours.mean(), theirs - theirs.mean()
    # As complex numbers, the phase of the correlation is the rotation of least squared error.
    turned = here * cmath.rect(1.0, cmath.phase(complex((here.conj() * there).sum())))
    return Errors(np.abs(ours - theirs), degrees, np.abs(turned - there))


def save_plot(drift: Drift, path: Path) -> None:
    """Plot the errors over time as PNG. Raises MisuseError."""
    plots = entries("minerva.plots").get("figure")
    if plots is None:
        raise MisuseError("plots need the extension analysis, which is not installed")
    plots.load()(path, (9, 5), lambda figure: _paint(figure, drift))


def _paint(figure: Any, drift: Drift) -> None:
    upper, lower = figure.subplots(2, 1, sharex=True)
    same = drift.chained is None or drift.chained.metres.tolist() == drift.taken.metres.tolist()
    ways = [("odometry", drift.chained), ("odometry" if same else "matched", drift.taken)]
    for name, errors in ways[same:]:
        if errors is not None:
            upper.plot(drift.seconds, errors.metres, label=name)
            lower.plot(drift.seconds, errors.degrees)
    upper.set(title="error of the position", ylabel="m")
    lower.set(title="error of the heading", ylabel="degrees", xlabel="time, s")
    for axis in (upper, lower):
        axis.set_yscale("symlog", linthresh=1.0)
        axis.set_ylim(bottom=0)
        axis.grid(visible=True)
        axis.yaxis.set_major_formatter("{x:g}")
    upper.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)


# --- walls that are drawn twice -------------------------------------------------------------------


_SAME_PLACE_METRES: Final = 1.5
"""Maximum distance between two keyframes of one place, in metres."""

_MAX_SEEN_THROUGH: Final = 0.3
"""Tolerated fraction of a scan's hits in space that the other scan saw as free."""

_TOLERATED: Final = 0.02
"""Fraction of places that may differ because of people and doors."""


@fast_dataclass
class Doubled:
    """A revisited place (m) whose walls disagree, with the times of both visits (s)."""

    x: float
    y: float
    first: float
    second: float


def doubled_walls(scans: Sequence[Scan], places: Sequence[Pose]) -> tuple[list[Doubled], int]:
    """Places whose walls a later visit contradicts, and the number of revisited places."""
    keys = keyframes_of(scans, places)
    poses = poses_of([places[key.number] for key in keys])
    seconds = seconds_of([scan.time for scan in scans])
    doubled, visits = [], 0
    way = np.array([key.way for key in keys])
    for later in range(0, len(keys), 2):
        before = np.flatnonzero(way <= way[later] - MIN_LOOP)
        if not len(before):
            continue
        apart = np.hypot(*(poses[before, :2] - poses[later, :2]).T)
        first = int(before[apart.argmin()])
        if apart.min() > _SAME_PLACE_METRES:
            continue
        visits += 1
        step = between(poses[first], poses[later])
        # Either scan may look through the walls of the other.
        through = max(
            seen_through(transformed(keys[later].points, step), keys[first].reach),
            seen_through(
                transformed(keys[first].points, between(step, np.zeros(3))), keys[later].reach
            ),
        )
        if through > _MAX_SEEN_THROUGH:
            x, y, _ = poses[later].tolist()
            times = [seconds[keys[k].number] for k in (first, later)]
            doubled.append(Doubled(x, y, *times))
    return doubled, visits


def doubling_notes(scans: Sequence[Scan], places: Sequence[Pose], poses: str) -> list[str]:
    """A warning with advice if walls are drawn twice, as a list of lines; else empty."""
    doubled, visits = doubled_walls(scans, places)
    if len(doubled) < 2 or len(doubled) <= _TOLERATED * visits:
        return []
    worst = doubled[0]
    advice = (
        "record at lower speed, or exclude a part (--from, --to)"
        if poses == "matched"
        else "use --poses matched to estimate the poses and close loops"
    )
    return [
        f"walls are drawn twice at {len(doubled)} of {visits} revisited places,"
        f" first near ({worst.x:.1f}, {worst.y:.1f}) m, seen at {worst.first:.0f} s and"
        f" {worst.second:.0f} s: {advice}"
    ]


def seconds_of(times: Iterable[float]) -> list[float]:
    """Seconds since the first of a series of times, without steps."""
    clock, seconds = RecordingClock(), list[float]()
    for time in times:
        clock.advance(time)
        seconds.append(clock.seconds)
    return seconds
