"""A lidar on a line: asked who and how it is, turned on, read, turned off."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Final

from minerva_services.bridging import SourceError
from minerva_services.sensors.rplidar import protocol as p
from minerva_services.sensors.rplidar.packets import Count, ExpressPackets, Packets, StandardPackets
from minerva_services.sensors.serial_line import SerialLine

ANSWERS_WITHIN: Final = 1.0
RESTS: Final = 0.02
"""Seconds that it needs after STOP; chapter 4 asks for 10 ms at most."""

BOOTS_WITHIN: Final = 5.0
SPEAKS_WITHIN: Final = 4.0
"""Seconds in which a scan that was asked for must begin and go on: a motor needs one or two."""

LONGEST_PREAMBLE: Final = 4096


class Lidar:
    """An RPLIDAR that is not scanning yet. Raises SourceError where no such thing answers."""

    def __init__(self, line: SerialLine) -> None:
        self._line = line
        self.quiet()
        self.info = p.read_info(self._ask(p.GET_INFO, p.INFO))
        self.health = self._health()
        if self.health.status == "error":
            self._reset()
            self.health = self._health()
        if self.health.status == "error":
            raise SourceError(
                f"the lidar at {line.port} protects itself ({self.health}); take off its power,"
                " see that it can turn, and plug it in again"
            )

    def quiet(self) -> None:
        """Stop whatever it does, and forget what it said."""
        self._line.write(p.request(p.STOP))
        time.sleep(RESTS)
        self._line.forget()

    def scan(self, express: bool, count: Count) -> Packets:
        """Let it turn and scan; what understands the bytes that come from now on."""
        self._line.set_dtr(False)
        self._line.write(p.motor(p.PWM))
        if express:
            self._expect(p.EXPRESS, p.CAPSULES)
            return ExpressPackets(count)
        self._expect(p.request(p.SCAN), p.SAMPLES)
        return StandardPackets(count)

    def read(self, stop: threading.Event) -> Iterator[bytes]:
        """What comes, now and then nothing. Raises SourceError where nothing comes for long."""
        heard = time.monotonic()
        while not stop.is_set():
            data = self._line.read()
            if data:
                heard = time.monotonic()
            elif time.monotonic() - heard > SPEAKS_WITHIN:
                raise SourceError(f"the lidar at {self._line.port} has fallen silent")
            yield data

    def rest(self) -> None:
        """Stop scanning and turning. Raises SourceError where the line is lost."""
        self._line.write(p.request(p.STOP) + p.motor(0))
        self._line.set_dtr(True)

    def _health(self) -> p.Health:
        return p.read_health(self._ask(p.GET_HEALTH, p.HEALTH))

    def _reset(self) -> None:
        """Start it anew, and wait until it answers; while it boots it may say anything."""
        self._line.write(p.request(p.RESET))
        until = time.monotonic() + BOOTS_WITHIN
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
        answer = self._line.read_exactly(wanted.size, ANSWERS_WITHIN)
        if len(answer) < wanted.size:
            raise SourceError(f"the lidar at {self._line.port} broke off in an answer")
        return answer

    def _expect(self, request: bytes, wanted: p.Descriptor) -> None:
        """Send a request, and read on until the descriptor of its response has been read."""
        self._line.write(request)
        until, found, passed = time.monotonic() + ANSWERS_WITHIN, b"", 0
        while time.monotonic() < until and passed < LONGEST_PREAMBLE:
            more = p.DESCRIPTOR_SIZE - len(found)
            found += self._line.read_exactly(more, until - time.monotonic())
            descriptor = p.read_descriptor(found)
            if descriptor == wanted:
                return
            if descriptor is not None:
                raise SourceError(
                    f"the lidar at {self._line.port} answers with data of type"
                    f" 0x{descriptor.type:02x}, not 0x{wanted.type:02x}; try the other mode"
                )
            if len(found) == p.DESCRIPTOR_SIZE:
                found, passed = found[1:], passed + 1
        what = "what it says makes no sense" if passed else "nothing answers"
        raise SourceError(
            f"{self._line.port}: {what} (is it an RPLIDAR, and are port and baud right?)"
        )
