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
from minerva_services.options import names_in, require
from minerva_services.sensors.rplidar import packets as p
from minerva_services.sensors.rplidar.packets import (
    EXPRESS_SINCE,
    Count,
    ExpressPackets,
    Packets,
    RevolutionBuffer,
    Samples,
    StandardPackets,
    ranges,
)
from minerva_services.sensors.serial_line import SerialLine, open_line

MODES: Final = ("auto", "express", "standard")
MAX_BEAMS: Final = 7200


class Rplidar(Bridge):
    """Publishes each revolution of an A-series RPLIDAR as a Scan.

    Beam 0 points to the lidar's front, the others follow counter-clockwise in equal steps.

    Args:
        port: the device, such as /dev/ttyUSB0, or socket://HOST:PORT.
        baud: 115200 for A1 and A2M8; 256000 for A2M7, A2M12 and A3.
        mode: "express" (firmware 1.17 or later), "standard", or "auto": express, and standard if
          that gives no revolution.
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
        self.publishes, self.concerns = (topic,), names_in(robot)
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
        self._express_fails = False

    def open(self) -> Source:
        """Raises SourceError if no lidar answers, or it is in protection mode."""
        line = open_line(self._port, self._baud)
        try:
            lidar = Lidar(line)
            self._log_identity(lidar)
            express = self._mode == "express" or (
                self._mode == "auto"
                and lidar.info.firmware >= EXPRESS_SINCE
                and not self._express_fails
            )
            # Until its first revolution, so that the next attempt is in the other mode.
            self._express_fails = express
            packets = lidar.scan(express, self.count)
        # The line is open exclusively: left open, it would reject the next attempt.
        except SourceError:
            line.close()
            raise
        return OpenSource(partial(self._scans, lidar, packets), partial(_rest, lidar, line))

    def _scans(
        self, lidar: Lidar, packets: Packets, stop: threading.Event
    ) -> Iterator[tuple[str, Scan] | None]:
        """Scans, one per completed revolution. Raises SourceError if there are none for long."""
        turns, latest = RevolutionBuffer(self.count), time.monotonic()
        for data in lidar.read(stop):
            for samples in packets.feed(data):
                for turn in turns.add(samples):
                    latest = time.monotonic()
                    self._express_fails = isinstance(packets, StandardPackets)
                    yield self._read(turn)
            if time.monotonic() - latest > REVOLUTION_SECONDS:
                raise SourceError(f"{self.source} sends no revolution; check that it rotates")
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


ANSWER_SECONDS: Final = 1.0
STOP_SECONDS: Final = 0.02
"""Pause in seconds after STOP; chapter 4 requires at least 10 ms."""

BOOT_SECONDS: Final = 5.0
FIRST_PACKET_SECONDS: Final = 4.0
"""Time in seconds within which a scan must start and continue: motors need one or two."""

REVOLUTION_SECONDS: Final = 8.0
"""Time in seconds for a revolution, also of a motor that starts."""

# Maximum length of the samples of a previous scan that may precede a response.
MAX_PREAMBLE_BYTES: Final = 4096


class Lidar:
    """An idle RPLIDAR. Raises SourceError if none answers."""

    def __init__(self, line: SerialLine) -> None:
        self._line = line
        # A previous process may have left the lidar scanning; its samples would bury the answers.
        self.quiet()
        self.info = p.read_info(self._ask(p.GET_INFO, p.INFO))
        self.health = self._health()
        # A reset leaves protection mode unless its cause persists.
        if self.health.status == "error":
            self._reset()
            self.health = self._health()
        if self.health.status == "error":
            raise SourceError(
                f"the lidar at {line.port} is in protection mode ({self.health});"
                " disconnect its power,"
                " check that it can rotate freely, and reconnect it"
            )

    def quiet(self) -> None:
        """Stop scanning and discard pending input."""
        self._line.write(p.request(p.STOP))
        time.sleep(STOP_SECONDS)
        self._line.forget()

    def scan(self, express: bool, count: Count) -> Packets:
        """Start motor and scan; the result decodes the bytes that follow."""
        # Early models switch the motor by DTR, later ones by PWM; each ignores the other.
        self._line.set_dtr(False)
        self._line.write(p.motor(p.PWM))
        if express:
            self._expect(p.EXPRESS, p.CAPSULES)
            return ExpressPackets(count)
        self._expect(p.request(p.SCAN), p.SAMPLES)
        return StandardPackets(count)

    def read(self, stop: threading.Event) -> Iterator[bytes]:
        """Incoming data, possibly empty. Raises SourceError if nothing arrives for long."""
        latest = time.monotonic()
        while not stop.is_set():
            data = self._line.read()
            if data:
                latest = time.monotonic()
            elif time.monotonic() - latest > FIRST_PACKET_SECONDS:
                raise SourceError(f"the lidar at {self._line.port} stopped sending")
            yield data

    def rest(self) -> None:
        """Stop scan and motor. Raises SourceError if the line is lost."""
        # As in `scan`, either PWM or DTR stops the motor, depending on the model.
        self._line.write(p.request(p.STOP) + p.motor(0))
        self._line.set_dtr(True)

    def _health(self) -> p.LidarHealth:
        return p.read_health(self._ask(p.GET_HEALTH, p.HEALTH))

    def _reset(self) -> None:
        """Reset the device and wait until it answers; its output during boot is undefined."""
        self._line.write(p.request(p.RESET))
        until = time.monotonic() + BOOT_SECONDS
        while True:
            try:
                self.quiet()
                self._ask(p.GET_INFO, p.INFO)
                return
            except SourceError:
                if time.monotonic() > until:
                    raise

    def _ask(self, command: int, wanted: p.Descriptor) -> bytes:
        self._expect(p.request(command), wanted)
        answer = self._line.read_exactly(wanted.size, ANSWER_SECONDS)
        if len(answer) < wanted.size:
            raise SourceError(f"the lidar at {self._line.port} sent an incomplete answer")
        return answer

    def _expect(self, request: bytes, wanted: p.Descriptor) -> None:
        """Send a request, and read until the descriptor of its response."""
        self._line.write(request)
        # Samples of a previous scan may precede the response, so slide a window over the bytes.
        until, window, skipped = time.monotonic() + ANSWER_SECONDS, b"", 0
        while time.monotonic() < until and skipped < MAX_PREAMBLE_BYTES:
            more = p.DESCRIPTOR_SIZE - len(window)
            window += self._line.read_exactly(more, until - time.monotonic())
            descriptor = p.read_descriptor(window)
            if descriptor == wanted:
                return
            if descriptor is not None:
                raise SourceError(
                    f"the lidar at {self._line.port} answers with data of type"
                    f' 0x{descriptor.type:02x}, not 0x{wanted.type:02x}; mode = "auto" tries both'
                )
            if len(window) == p.DESCRIPTOR_SIZE:
                window, skipped = window[1:], skipped + 1
        what = "unintelligible answer" if skipped else "no answer"
        raise SourceError(
            f"{self._line.port}: {what} (is it an RPLIDAR, and are port and baud right?)"
        )
