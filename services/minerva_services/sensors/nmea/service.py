"""The bridge to a satellite navigation receiver: options and positions."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import ClassVar, Final

from minerva_bus.errors import MisuseError
from minerva_bus.world.readings import Position
from minerva_services.bridging import Bridge
from minerva_services.sensors.nmea.sentences import Fix, SkippedSentence, read_fix
from minerva_services.sensors.serial_line import (
    LineSplitter,
    SerialLine,
    check_installed,
    open_line,
)

DAY: Final = 86_400.0
LONGEST: Final = 256
"""Maximum length of a line in bytes; the standard allows 82."""


class Nmea(Bridge):
    """Publishes each fix of a receiver that speaks NMEA 0183 as a Position.

    Fixes come from GGA sentences; from RMC sentences only until the first GGA arrives, because they
    lack altitude and accuracy, which are then None. Times are seconds since the midnight (UTC)
    before the first fix, by the receiver's clock.

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
        check_installed("nmea")
        if not 0 < error < float("inf"):
            raise MisuseError(f"nmea: error is {error}; expected metres above 0")
        self.source = f"the receiver at {port}"
        self.publishes = (topic,)
        self._port, self._baud, self._topic = port, baud, topic
        self._error, self._robot = error, robot
        self._days, self._second = 0.0, 0.0

    def open(self) -> NmeaSource:
        """Raises SourceError if the line cannot be opened."""
        return NmeaSource(self, open_line(self._port, self._baud))

    def position(self, fix: Fix) -> tuple[str, Position]:
        """A fix as a reading, with its topic."""
        if fix.second < self._second - DAY / 2:
            self._days += DAY
        self._second = fix.second
        return self._topic, Position(
            self._robot,
            fix.latitude,
            fix.longitude,
            fix.altitude,
            None if fix.dilution is None else self._error * fix.dilution,
            self._days + fix.second,
        )


class NmeaSource:
    """A receiver on an open line."""

    def __init__(self, bridge: Nmea, line: SerialLine) -> None:
        self._bridge = bridge
        self._line = line
        self._gga = False

    def read(self, stop: threading.Event) -> Iterator[tuple[str, Position] | None]:
        """Positions as sentences arrive."""
        lines = LineSplitter(self._bridge.count, LONGEST)
        while not stop.is_set():
            for line in lines.feed(self._line.read()):
                fix = self._fix(line)
                if fix is not None:
                    yield self._bridge.position(fix)
            yield None

    def close(self) -> None:
        """Close the line."""
        self._line.close()

    def _fix(self, line: str) -> Fix | None:
        try:
            fix = read_fix(line)
        except SkippedSentence as reason:
            self._bridge.count(str(reason))
            return None
        self._gga |= fix.sentence == "GGA"
        if self._gga and fix.sentence == "RMC":
            self._bridge.count("other sentences")
            return None
        return fix
