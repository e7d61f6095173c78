"""`gpx` and `csv`: play the tracks and tables that apps and loggers write into a world."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from io import BufferedReader
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.log.recordings import PassOver, Recorded, RecordingError
from minerva_bus.world.readings import Battery, Odometry, Position, Reading
from minerva_services.options import names_in, takes_options
from minerva_services.sensors.clocks import FirstSkip, watched
from minerva_services.sensors.playback import PlaybackPace, Playing

_KINDS: Final[Mapping[str, type[Reading]]] = {
    "odometry": Odometry,
    "position": Position,
    "battery": Battery,
}
_OPTIONAL: Final[Mapping[str, float | None]] = {
    "angle": 0.0, "speed": 0.0, "turn": 0.0, "altitude": None, "accuracy": None, "volts": 0.0,
}  # fmt: skip
"""Values of fields that a table may lack."""

_MAX_LINE: Final = 1 << 20
_SKIPPED: Final = "rows skipped"
_BROKEN: Final = "broken off"


@dataclass(slots=True)
class _TrackFile:
    """An open file whose readings are read once. Raises RecordingError."""

    path: Path
    pass_over: PassOver
    robot: str
    topic: str
    part: float = 0.0
    _file: BufferedReader = field(init=False)
    _skipped: FirstSkip = field(init=False)

    def __post_init__(self) -> None:
        self._skipped = FirstSkip(self.pass_over)
        try:
            self._file = self.path.open("rb")
        except OSError as error:
            raise RecordingError(f"{self.path}: {error.strerror or error}") from None

    def readings(self) -> Iterator[Recorded]:
        """The readings in recorded order. Raises RecordingError."""
        return watched(self._recorded(), self.path, self.pass_over)

    def close(self) -> None:
        self._file.close()

    def _recorded(self) -> Iterator[Recorded]:
        size, is_empty = max(1, os.fstat(self._file.fileno()).st_size), True
        for reading in self._read():
            self.part = min(1.0, self._file.tell() / size)
            yield Recorded(reading.time, self.topic, reading)
            is_empty = False
        if is_empty:
            raise RecordingError(f"{self.path}: no reading{self._skipped.reason(self.path)}")

    def _read(self) -> Iterator[Reading]:
        raise NotImplementedError


class GpxTrack(_TrackFile):
    """The points with times of a GPX file [GPX 1.1, 1.0]."""

    def _read(self) -> Iterator[Reading]:
        try:
            # Expat limits the expansion of entities, and reads no other files.
            for _, element in ElementTree.iterparse(self._file):  # noqa: S314
                if _local(element.tag) in ("trkpt", "rtept", "wpt"):
                    yield from self._position(element)
                    element.clear()
        except ElementTree.ParseError as error:
            self._skipped(_BROKEN, f"{self.path}: not well-formed XML: {error}")

    def _position(self, point: ElementTree.Element) -> Iterator[Reading]:
        texts = {_local(part.tag): (part.text or "").strip() for part in point}
        try:
            if "time" not in texts:
                raise ValueError("it has no time")
            latitude, longitude = (_number(point.get(name), name) for name in ("lat", "lon"))
            altitude = _number(texts["ele"], "ele") if texts.get("ele") else None
            place = Position(
                self.robot, latitude, longitude, altitude, None, _seconds(texts["time"])
            )
            yield _checked(place)
        except ValueError as error:
            self._skipped(_SKIPPED, f"{self.path}: a point skipped: {error}")


@dataclass(slots=True)
class CsvTable(_TrackFile):
    """The rows of a table as readings of one kind; `columns` and `factors` are by their fields."""

    kind: str = "odometry"
    columns: Mapping[str, str] = field(default_factory=dict[str, str])
    factors: Mapping[str, float] = field(default_factory=dict[str, float])

    def _read(self) -> Iterator[Reading]:
        lines = self._lines()
        header = next(lines, "")
        delimiter = max(",;\t", key=header.count)
        names = [name.strip() for name in next(csv.reader([header], delimiter=delimiter), [])]
        places = self._places(names)
        rows = csv.reader(lines, delimiter=delimiter)
        while True:
            try:
                row = next(rows, None)
                if row is None:
                    return
                if any(cell.strip() for cell in row):
                    yield self._reading(row, places)
            except (ValueError, csv.Error) as error:
                # The header is line 1.
                where = f"{self.path}:{rows.line_num + 1}"
                self._skipped(_SKIPPED, f"{where}: a row skipped: {error}")

    def _lines(self) -> Iterator[str]:
        while line := self._file.readline(_MAX_LINE):
            if len(line) == _MAX_LINE:
                raise RecordingError(f"{self.path}: a line of more than 1 MB; expected a table")
            yield line.decode("utf-8-sig", "replace")

    def _places(self, names: list[str]) -> dict[str, int]:
        """The number of each field's column. Raises RecordingError."""
        places: dict[str, int] = {}
        for name in _field_names(self.kind):
            column = self.columns.get(name, name)
            if column in names:
                places[name] = names.index(column)
            elif name in self.columns or name not in _OPTIONAL:
                there = ", ".join(names) or "none"
                raise RecordingError(
                    f"{self.path}: no column {column!r} for {name}; the columns are {there};"
                    f' set columns = {{ {name} = "..." }}'
                )
        return places

    def _reading(self, row: list[str], places: Mapping[str, int]) -> Reading:
        """The reading of a row. Raises ValueError."""
        values: dict[str, Any] = {}
        for name in _field_names(self.kind):
            place = places.get(name)
            text = row[place].strip() if place is not None and place < len(row) else ""
            if not text and name in _OPTIONAL:
                values[name] = _OPTIONAL[name]
                continue
            is_date = name == "time" and not _is_number(text)
            number = _seconds(text) if is_date else _number(text, name)
            values[name] = number * self.factors.get(name, 1.0)
        return _checked(_KINDS[self.kind](robot=self.robot, **values))


def _local(tag: str) -> str:
    return tag.rpartition("}")[2]


def _field_names(kind: str) -> list[str]:
    return [each.name for each in fields(_KINDS[kind]) if each.name != "robot"]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _number(text: str | None, name: str) -> float:
    """A finite number. Raises ValueError."""
    number = float(text) if text is not None and _is_number(text) else math.nan
    if not math.isfinite(number):
        raise ValueError(f"{name} is {text!r}; expected a number")
    return number


def _seconds(text: str) -> float:
    """Seconds since 1970 of a date with a time, in UTC unless it says otherwise."""
    try:
        at = datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(f"time is {text!r}; expected seconds, or a date and a time") from None
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()


def _checked(reading: Reading) -> Reading:
    """The reading, if it can be one. Raises ValueError."""
    if isinstance(reading, Position) and (
        abs(reading.latitude) > 90 or abs(reading.longitude) > 180
    ):
        raise ValueError(f"latitude {reading.latitude:g}, longitude {reading.longitude:g}")
    if isinstance(reading, Battery) and not 0 <= reading.charge <= 1:
        raise ValueError(f"charge is {reading.charge:g}; expected 0 to 1")
    return reading


class Gpx(Playing, when="freely"):
    """Plays a GPX track as positions. Raises MisuseError.

    Its other options are those of `PlaybackPace`.

    Args:
        file: the track.
        robot: the id of the agent that was there.
        topic: the topic of the positions.

    """

    @takes_options(PlaybackPace)
    def __init__(
        self,
        file: str,
        robot: str = "r1",
        topic: str = "position",
        **pace: Any,
    ) -> None:
        super().__init__(file, PlaybackPace(**pace))
        self._robot, self.concerns = robot, names_in(robot)
        self.publishes = (topic,)

    def recording(self) -> GpxTrack:
        path, (topic,) = Path(self.source), self.publishes
        return GpxTrack(path, self.pass_over, self._robot, topic)


class Csv(Playing, when="freely"):
    """Plays a table with a header, separated by commas, semicolons or tabs. Raises MisuseError.

    Its other options are those of `PlaybackPace`.

    Args:
        file: the table.
        reading: what a row is: odometry, position or battery.
        columns: the columns of its fields, if they have other names: {"x" = "pos_x"}.
        factors: numbers by which fields are multiplied: {"time" = 0.001} for milliseconds.
        robot: the id of the agent that carries the sensor.
        topic: the topic; by default the name of the reading.

    """

    @takes_options(PlaybackPace)
    def __init__(
        self,
        file: str,
        reading: str = "odometry",
        columns: Mapping[str, Any] | None = None,
        factors: Mapping[str, Any] | None = None,
        robot: str = "r1",
        topic: str = "",
        **pace: Any,
    ) -> None:
        super().__init__(file, PlaybackPace(**pace))
        if reading not in _KINDS:
            hint = nearest(reading, [*_KINDS], f"expected {', '.join(_KINDS)}")
            raise MisuseError(f"csv: reading is {reading!r}{hint}")
        for option, given, kinds in (("columns", columns, str), ("factors", factors, (int, float))):
            for name, value in (given or {}).items():
                if name not in _field_names(reading):
                    hint = nearest(name, known := _field_names(reading), ", ".join(known))
                    raise MisuseError(
                        f"csv: {option} has {name!r}; {reading} has no such field{hint}"
                    )
                if not isinstance(value, kinds) or isinstance(value, bool):
                    raise MisuseError(f"csv: {option}.{name} is {value!r}; see the options of csv")
        self._robot, self._reading = robot, reading
        self.concerns = names_in(robot)
        self._columns, self._factors = dict(columns or {}), dict(factors or {})
        self.publishes = (topic or reading,)

    def recording(self) -> CsvTable:
        path, (topic,) = Path(self.source), self.publishes
        return CsvTable(
            path, self.pass_over, self._robot, topic,
            kind=self._reading, columns=self._columns, factors=self._factors,
        )  # fmt: skip
