"""Records as .rrd files for the Rerun viewer, without the code of their worlds.

| entity              | archetype                                                              |
|---------------------|------------------------------------------------------------------------|
| world/KIND          | Points3D: the agents of a kind, with their ids                         |
| world/ROBOT/TOPIC   | Transform3D, Points3D: a scan, and where its robot measured it         |
| ROBOT/TOPIC         | Image or EncodedImage; GeoPoints; Scalars of odometry and of a battery |
| agents/KIND         | Scalars: the number of agents                                          |
| events/TYPE         | Scalars: the number of events in a frame                               |
| log                 | TextLog: the lines of members                                          |
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from minerva_analysis.frame_texts import kinds_in
from minerva_analysis.places import SHOWN, Positions, Surveyor
from minerva_bus.files import check_ending, check_file
from minerva_bus.frame.messages import Readings
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.record import Record
from minerva_bus.world.readings import Battery, Image, Odometry, Position, Reading, Scan
from minerva_exporters.datasets import ExportChoice, ExportProgress
from minerva_exporters.sources import RecordFrames, only_record
from minerva_services.options import require
from minerva_services.views.svg.files import prepare_folder

if TYPE_CHECKING:
    import rerun as rr

FORM: Final = "rerun"
_RADIUS: Final = 0.05
"""Metres."""


def write_rrd(
    records: Sequence[Path], into: Path, choice: ExportChoice, progress: ExportProgress
) -> Mapping[str, int]:
    """Write a record as an .rrd file; see `Exporter`."""
    require(FORM, "rerun", "rerun-sdk", "rerun")
    path = only_record(records, FORM)
    check_ending(into, (".rrd",), FORM)
    check_file(into, FORM)
    with Record(path) as record:
        frames = RecordFrames(record, choice.begin, choice.end)
        prepare_folder(into)
        with closing(_RrdExport(record, into)) as made:
            for frame in frames:
                made.begin(frame.number)
                if not (frame.number - choice.begin) % choice.every:
                    made.agents(frame.scene)
                made.readings(frame.readings, frame.scene)
                if frame.events:
                    made.events(frame.events)
                progress(frame.number - choice.begin, frames.last - choice.begin)
            made.log(frames)
            return {"entities": len(made.entities)}


class _RrdExport:
    """An .rrd file that is written; `entities` are the paths in it."""

    def __init__(self, record: Record, path: Path) -> None:
        # Imported here because Rerun takes a second to load.
        from minerva_services.views.rerun.rrd_file import open_stream

        world = record.description.world
        self.entities: set[str] = set()
        self._record, self._dt = record, world.dt
        self._surveyor = Surveyor(world.vocabulary, SHOWN)
        self._path = path
        self._stream = open_stream(world.name, path, "choose another file")

    def close(self) -> None:
        """Finish the file."""
        from minerva_services.views.rerun.rrd_file import close_stream

        close_stream(self._stream, self._path)

    def begin(self, frame: int) -> None:
        """Write what follows at the time of a frame."""
        self._stream.set_time("frame", sequence=frame)
        self._stream.set_time("time", duration=frame * self._dt)

    def agents(self, scene: Scene) -> None:
        """Write the agents of a string."""
        import rerun as rr

        for kind, count in kinds_in(scene).items():
            self._log(f"agents/{kind}", rr.Scalars(count))
        for kind, places in self._surveyor.places(scene).items():
            at = np.stack([places.x, places.y, np.zeros(len(places.x))], axis=1)
            shown = rr.Points3D(at, radii=_RADIUS, labels=list(places.ids), show_labels=False)
            self._log(f"world/{kind}", shown)

    def readings(self, published: Sequence[Readings], scene: Scene) -> None:
        """Write the readings of a frame that began with a string."""
        readings = [(message.topic, each) for message in published for each in message.readings]
        robots = {each.robot for _, each in readings if isinstance(each, Scan)}
        poses = _poses(self._surveyor.places(scene), robots) if robots else {}
        for topic, reading in readings:
            placed = isinstance(reading, Scan) and reading.robot in poses
            extra = [poses[reading.robot]] if placed else []
            for path, archetype in _shown(reading, f"{reading.robot}/{topic}"):
                self._log(path, archetype, *extra)

    def events(self, events: Iterable[AnyEvent]) -> None:
        """Write the numbers of events of a frame."""
        import rerun as rr

        counts = Counter[str]()
        for event in events:
            counts[event.type] += len(event)
        for name, count in sorted(counts.items()):
            self._log(f"events/{name}", rr.Scalars(count))

    def log(self, frames: RecordFrames) -> None:
        """Write the lines of members between these frames."""
        import rerun as rr

        for line in self._record.log():
            number = round(line.time / self._dt)
            if frames.begin <= number <= frames.last:
                self.begin(number)
                self._log("log", rr.TextLog(f"{line.member}: {line.text}"))

    def _log(self, path: str, *archetypes: rr.AsComponents) -> None:
        self.entities.add(path)
        self._stream.log(path.strip("/"), *archetypes)


def _poses(places: Mapping[str, Positions], robots: Container[str]) -> dict[str, rr.Transform3D]:
    """The poses of robots."""
    import rerun as rr

    return {
        robot: rr.Transform3D(
            translation=[x, y, 0.0], rotation=rr.RotationAxisAngle([0, 0, 1], degrees=angle)
        )
        for of_kind in places.values()
        for robot, x, y, angle in of_kind.of(robots)
    }


def _shown(reading: Reading, path: str) -> Iterator[tuple[str, rr.AsComponents]]:
    """Paths and archetypes of a reading; none of sightings, which have no place."""
    import rerun as rr

    if isinstance(reading, Scan):
        yield f"world/{path}", rr.Points3D(_hits(reading), radii=_RADIUS / 2)
    elif isinstance(reading, Image):
        yield path, _image(reading)
    elif isinstance(reading, Position):
        yield path, rr.GeoPoints(lat_lon=[[reading.latitude, reading.longitude]])
    elif isinstance(reading, Odometry):
        yield f"{path}/speed", rr.Scalars(reading.speed)
        yield f"{path}/turn", rr.Scalars(reading.turn)
    elif isinstance(reading, Battery):
        yield f"{path}/charge", rr.Scalars(reading.charge)


def _hits(scan: Scan) -> NDArray[np.float64]:
    """Where beams end at obstacles, in the frame of the robot, shape (n, 3)."""
    ranges = np.asarray(scan.ranges, np.float64)
    turn = np.radians(scan.mount_angle + scan.first + scan.step * np.arange(len(ranges)))
    x, y = scan.mount_x + ranges * np.cos(turn), scan.mount_y + ranges * np.sin(turn)
    hit = (ranges > 0) & (ranges < scan.range_max)
    return np.stack([x, y, np.zeros(len(x))], axis=1)[hit]


def _image(image: Image) -> rr.AsComponents:
    import rerun as rr

    if image.encoding in ("jpeg", "png"):
        return rr.EncodedImage(contents=image.data, media_type=f"image/{image.encoding}")
    if image.encoding == "32FC1":
        depths = np.frombuffer(image.data, "<f4").reshape(image.height, image.width)
        return rr.DepthImage(depths, meter=1.0)
    depth = 3 if image.encoding == "rgb8" else 1
    pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, depth)
    return rr.Image(pixels)
