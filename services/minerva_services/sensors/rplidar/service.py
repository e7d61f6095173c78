"""The bridge to an RPLIDAR: options, and scans of its revolutions."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import ClassVar, Final

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.world.readings import Scan
from minerva_services.bridging import Bridge, OpenSource, Source, SourceError
from minerva_services.options import require
from minerva_services.sensors.rplidar.lidar import Lidar
from minerva_services.sensors.rplidar.packets import Packets, RevolutionBuffer, Samples, ranges
from minerva_services.sensors.rplidar.protocol import EXPRESS_SINCE
from minerva_services.sensors.serial_line import SerialLine, open_line

MODES: Final = ("auto", "express", "standard")
MAX_BEAMS: Final = 7200


class Rplidar(Bridge):
    """Publishes each revolution of an A-series RPLIDAR as a Scan.

    Beam 0 points to the lidar's front, the others follow counter-clockwise in equal steps.

    Args:
        port: the device, such as /dev/ttyUSB0, or socket://HOST:PORT.
        baud: 115200 for A1 and A2M8; 256000 for A2M7, A2M12 and A3.
        mode: "express" (firmware 1.17 or later), "standard", or "auto": express if supported.
        beams: number of beams of a scan.
        range_max: in metres; longer measurements count as no hit.
        robot: the id of the agent that carries it.
        mount_x: metres ahead of the robot's centre.
        mount_y: metres to the left of it.
        mount_angle: rotation of its front in degrees, counter-clockwise.
        topic: the sensor topic of the scans.

    """

    source_option: ClassVar[str] = "port"

    def __init__(
        self,
        port: str = "/dev/ttyUSB0",
        baud: int = 115200,
        mode: str = "auto",
        beams: int = 360,
        range_max: float = 12.0,
        robot: str = "r1",
        mount_x: float = 0.0,
        mount_y: float = 0.0,
        mount_angle: float = 0.0,
        topic: str = "scan",
    ) -> None:
        super().__init__()
        require("rplidar", "serial", "pyserial", "serial")
        if mode not in MODES:
            raise MisuseError(f"rplidar: mode is {mode!r}; expected one of {', '.join(MODES)}")
        if not 1 <= beams <= MAX_BEAMS:
            raise MisuseError(f"rplidar: beams is {beams}; expected 1 to {MAX_BEAMS}")
        if not 0 < range_max < float("inf"):
            raise MisuseError(f"rplidar: range_max is {range_max}; expected metres above 0")
        self.source = f"the lidar at {port}"
        self.publishes = (topic,)
        self._port, self._baud, self._mode, self._topic = port, baud, mode, topic
        self._scan = Scan(
            robot,
            np.zeros(beams, np.float32),
            0.0,
            360.0 / beams,
            range_max,
            0.0,
            mount_x,
            mount_y,
            mount_angle,
        )
        self._born = time.monotonic()
        self._logged = ""
        self._health = ""

    def open(self) -> Source:
        """Raises SourceError if no lidar answers, or it is in protection mode."""
        line = open_line(self._port, self._baud)
        try:
            lidar = Lidar(line)
            self._log_identity(lidar)
            express = self._mode == "express" or (
                self._mode == "auto" and lidar.info.firmware >= EXPRESS_SINCE
            )
            packets = lidar.scan(express, self.count)
        # The line is open exclusively: left open, it would reject the next attempt.
        except SourceError:
            line.close()
            raise
        return OpenSource(partial(self._scans, lidar, packets), partial(_rest, lidar, line))

    def _scans(
        self, lidar: Lidar, packets: Packets, stop: threading.Event
    ) -> Iterator[tuple[str, Scan] | None]:
        """Scans, one per completed revolution."""
        turns = RevolutionBuffer(self.count)
        for data in lidar.read(stop):
            for samples in packets.feed(data):
                for turn in turns.add(samples):
                    yield self._read(turn)
            yield None

    def _read(self, turn: Samples) -> tuple[str, Scan]:
        """A revolution as a scan, with its topic; the lidar has no clock, so ours is used."""
        distances = ranges(turn, len(self._scan.ranges))
        return self._topic, replace(
            self._scan, ranges=distances, time=time.monotonic() - self._born
        )

    def report(self) -> Mapping[str, bool | int | float | str]:
        return {**super().report(), **({"health": self._health} if self._health else {})}

    def _log_identity(self, lidar: Lidar) -> None:
        """Log the lidar's identification once, and again when its health changes."""
        self._health = str(lidar.health)
        line = f"{self.source}: {lidar.info}; health {self._health}"
        if line != self._logged:
            self._log(line)
        self._logged = line


def _rest(lidar: Lidar, line: SerialLine) -> None:
    """Stop the lidar if it is still reachable, and close its line."""
    with suppress(SourceError):
        lidar.rest()
    line.close()
