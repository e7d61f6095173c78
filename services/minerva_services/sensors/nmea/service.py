"""A GPS receiver on a serial line, which sends sentences of NMEA 0183; pynmea2 reads them."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Final

from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.log.recordings import STEP_SECONDS
from minerva_bus.world.readings import Position
from minerva_services.bridging import Bridge, OpenSource, Source, SourceError
from minerva_services.options import names_in, require
from minerva_services.sensors.clocks import STEPS_BACK
from minerva_services.sensors.serial_line import LineSplitter, SerialLine, open_line

DAY_SECONDS: Final = 86_400.0
LATE_SECONDS: Final = 3_600.0
"""Maximum seconds by which a sentence is late, or a receiver corrects its clock; an older time of
day is that of the next day."""

SENTENCES: Final = ("GGA", "GNS", "RMC", "GLL")
"""Types of sentences with a position, the best first."""

LAPSE_SECONDS: Final = 10.0
"""Seconds by the receiver's clock without a better sentence after which a lesser type is used."""

MAX_LINE_BYTES: Final = 256
"""Maximum length of a line in bytes; the standard allows 82."""


class Nmea(Bridge):
    """Publishes each fix of a receiver that speaks NMEA 0183 as a Position.

    Fixes come from GGA sentences, or from the best of GNS, RMC and GLL that the receiver sends; the
    latter two lack altitude and accuracy, which are then None. Times are seconds since the midnight
    (UTC) before the first fix, by the receiver's clock.

    Args:
        port: the device, such as /dev/ttyACM0, or socket://HOST:PORT.
        baud: rate of the line; older receivers use 4800.
        error: the receiver's error in metres under ideal conditions; multiplied by the dilution of
          precision it gives the accuracy.
        robot: the id of the agent that carries it.
        topic: the sensor topic of the positions.

    """

    source_option: ClassVar[str] = "port"

    def __init__(
        self,
        port: str = "/dev/ttyACM0",
        baud: int = 9600,
        error: float = 5.0,
        robot: str = "r1",
        topic: str = "position",
    ) -> None:
        super().__init__()
        require("nmea", "serial", "pyserial", "serial")
        if not 0 < error < float("inf"):
            raise MisuseError(f"nmea: error is {error}; expected metres above 0")
        self.source = f"the receiver at {port}"
        self.publishes = (topic,)
        self._port, self._baud, self._topic = port, baud, topic
        self._error, self._robot = error, robot
        self.concerns = names_in(robot)
        self._time: float | None = None

    def open(self) -> Source:
        """Raises SourceError if the line cannot be opened."""
        line = open_line(self._port, self._baud)
        return OpenSource(partial(self._positions, line), line.close)

    def _positions(
        self, line: SerialLine, stop: threading.Event
    ) -> Iterator[tuple[str, Position] | None]:
        """Positions as sentences arrive."""
        lines, latest = LineSplitter(self.count, MAX_LINE_BYTES), dict[str, float]()
        while not stop.is_set():
            try:
                texts, lost = lines.feed(line.read()), None
            except SourceError as error:
                texts, lost = lines.rest(), error
            for text in texts:
                fix = self._read(text)
                if fix is None:
                    continue
                latest[fix.sentence] = fix.second
                better = SENTENCES[: SENTENCES.index(fix.sentence)]
                ages = [abs(fix.second - latest[kind]) for kind in better if kind in latest]
                if min(ages, default=DAY_SECONDS) <= LAPSE_SECONDS:
                    self.count("other sentences")
                else:
                    yield self._position(fix)
            if lost is not None:
                raise lost
            yield None

    def _read(self, text: str) -> Fix | None:
        """The fix in a line; others are counted."""
        try:
            return read_fix(text)
        except SkippedSentence as reason:
            if reason.detail:
                self.pass_over(str(reason), f"{self.source}: {reason.detail}")
            else:
                self.count(str(reason))
            return None

    def _position(self, fix: Fix) -> tuple[str, Position]:
        """A fix as a reading, with its topic."""
        return self._topic, Position(
            self._robot,
            fix.latitude,
            fix.longitude,
            fix.altitude,
            None if fix.dilution is None else self._error * fix.dilution,
            self._timed(fix.second),
        )

    def _timed(self, second: float) -> float:
        """The time of a fix, given its second of the day."""
        before = second if self._time is None else self._time
        # Sentences lack the date, and midnight may pass between two of them: it is the first such
        # time of day that is not too far back.
        days = math.ceil((before - LATE_SECONDS - second) / DAY_SECONDS)
        self._time = days * DAY_SECONDS + second
        if before - self._time > STEP_SECONDS:
            step = f"the clock steps back by {before - self._time:.1f} s, to {self._time:.1f} s"
            self.pass_over(STEPS_BACK, f"{self.source}: {step}")
        return self._time


MAX_SHOWN: Final = 90
"""Characters of a sentence that are shown."""


class SkippedSentence(MinervaError):
    """A line without a usable position; the message is the name of the counter for such lines.

    `detail` describes a sentence that arrived intact, but has an invalid value.
    """

    def __init__(self, counter: str, detail: str = "") -> None:
        super().__init__(counter)
        self.detail = detail


@dataclass(frozen=True, slots=True)
class Fix:
    """A receiver's position in degrees north and east (WGS 84).

    `altitude` is in metres above the ellipsoid, or above sea level if the receiver omits the
    difference; `dilution` is the horizontal one (HDOP). They are None if absent; a dilution of 0,
    which some receivers send, is also unknown. `second` counts from midnight UTC.
    """

    sentence: str
    latitude: float
    longitude: float
    altitude: float | None
    dilution: float | None
    second: float


def read_fix(line: str) -> Fix:
    """The fix in a sentence of one of the types SENTENCES of any talker. Raises SkippedSentence."""
    sentence = _parsed(line)
    kind = str(getattr(sentence, "sentence_type", ""))
    if kind not in SENTENCES:
        raise SkippedSentence("other sentences")
    try:
        return _fix(kind, sentence)
    except (ValueError, TypeError, AttributeError) as error:
        raise SkippedSentence("garbage", f"{line[:MAX_SHOWN]!r} skipped: {error}") from None


def _parsed(line: str) -> Any:
    import pynmea2

    try:
        # If a line end was lost, the remains of another sentence precede the last $. Without
        # `check`, pynmea2 accepts sentences that lack a checksum.
        return pynmea2.parse(line[max(line.rfind("$"), 0) :], check=True)
    # Both of these are subclasses of ParseError, so they come first.
    except pynmea2.ChecksumError:
        raise SkippedSentence("checksum errors") from None
    except pynmea2.SentenceTypeError:
        raise SkippedSentence("other sentences") from None
    except (pynmea2.ParseError, ValueError):
        raise SkippedSentence("garbage") from None


def _fix(kind: str, sentence: Any) -> Fix:
    if not _is_known(kind, sentence) or not sentence.lat or not sentence.lon:
        raise SkippedSentence("without a fix")
    at = sentence.timestamp
    second = at.hour * 3600 + at.minute * 60 + at.second + at.microsecond / 1e6
    latitude = _degrees(sentence.latitude, sentence.lat, sentence.lat_dir, "NS", 90)
    longitude = _degrees(sentence.longitude, sentence.lon, sentence.lon_dir, "EW", 180)
    if kind in ("RMC", "GLL"):
        return Fix(kind, latitude, longitude, None, None, second)
    above_sea = _real(sentence.altitude)
    dilution = _real(sentence.horizontal_dil if kind == "GGA" else sentence.hdop) or None
    altitude = above_sea if above_sea is None else above_sea + (_real(sentence.geo_sep) or 0.0)
    return Fix(kind, latitude, longitude, altitude, dilution, second)


def _is_known(kind: str, sentence: Any) -> bool:
    """Whether the receiver knows its position. Raises ValueError."""
    if kind == "GGA":
        return int(sentence.gps_qual or 0) > 0
    if kind == "GNS":
        # A letter for each system of satellites; N: not used.
        return bool((sentence.mode_indicator or "").strip("N"))
    return bool(sentence.status == "A")


def _degrees(degrees: float, text: str, hemisphere: str, known: str, most: float) -> float:
    """Degrees, given the fields that they were read from. Raises ValueError."""
    # pynmea2 reads 0 degrees without a known hemisphere, and more minutes than a degree has.
    if hemisphere not in tuple(known):
        raise ValueError(f"hemisphere {hemisphere!r}; expected {' or '.join(known)}")
    minutes = float(text[max(0, text.find(".") - 2) :])
    if abs(degrees) > most or minutes > 60:
        raise ValueError(f"{text} is not degrees and minutes up to {most}°")
    return degrees


def _real(value: Any) -> float | None:
    if value in (None, ""):
        return None
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{value} is not finite")
    return number
