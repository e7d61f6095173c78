"""A lidar on a serial line: identification, start, reading, stop."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Final

from minerva_services.bridging import SourceError
from minerva_services.sensors.rplidar import protocol as p
from minerva_services.sensors.rplidar.packets import Count, ExpressPackets, Packets, StandardPackets
from minerva_services.sensors.serial_line import SerialLine

ANSWER_SECONDS: Final = 1.0
STOP_SECONDS: Final = 0.02
"""Pause in seconds after STOP; chapter 4 requires at least 10 ms."""

BOOT_SECONDS: Final = 5.0
FIRST_PACKET_SECONDS: Final = 4.0
"""Time in seconds within which a scan must start and continue: motors need one or two."""

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
                    f" 0x{descriptor.type:02x}, not 0x{wanted.type:02x}; try the other mode"
                )
            if len(window) == p.DESCRIPTOR_SIZE:
                window, skipped = window[1:], skipped + 1
        what = "unintelligible answer" if skipped else "no answer"
        raise SourceError(
            f"{self._line.port}: {what} (is it an RPLIDAR, and are port and baud right?)"
        )
