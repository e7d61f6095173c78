"""What is said on the line: requests, the descriptors of their responses, info and health.

Source: SLAMTEC, "RPLIDAR: Interface Protocol and Application Notes" (A series, rev. 1.x and 2.x),
chapters 2 and 4; "chapter" and "figure" in this package are those of this document. All numbers
are little-endian.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import Final

from minerva_services.bridging import SourceError

START: Final = 0xA5
ANSWER: Final = b"\xa5\x5a"
DESCRIPTOR_SIZE: Final = 7

STOP, RESET = 0x25, 0x40
SCAN, EXPRESS_SCAN = 0x20, 0x82
GET_INFO, GET_HEALTH = 0x50, 0x52
SET_MOTOR_PWM: Final = 0xF0

PWM: Final = 660
"""Duty of the motor where the adapter sets it; an A1's is switched by DTR and ignores this."""

EXPRESS_SINCE: Final = (1, 17)
"""The first firmware with EXPRESS_SCAN."""


@dataclass(frozen=True, slots=True)
class Descriptor:
    """A response descriptor (figure 2-7): bytes in a data packet, whether many come, their type."""

    size: int
    many: bool
    type: int


INFO: Final = Descriptor(20, False, 0x04)
HEALTH: Final = Descriptor(3, False, 0x06)
SAMPLES: Final = Descriptor(5, True, 0x81)
CAPSULES: Final = Descriptor(84, True, 0x82)


@dataclass(frozen=True, slots=True)
class Info:
    """What a device says of itself (GET_INFO)."""

    model: int
    firmware: tuple[int, int]
    hardware: int
    serial: str

    def __str__(self) -> str:
        major, minor = self.firmware
        return f"model {self.model}, firmware {major}.{minor:02}, serial number {self.serial}"


HEALTHS: Final = ("good", "warning", "error")


@dataclass(frozen=True, slots=True)
class Health:
    """How a device is (GET_HEALTH): `status` is one of `HEALTHS`."""

    status: str
    code: int

    def __str__(self) -> str:
        return self.status if self.status == "good" else f"{self.status} 0x{self.code:04x}"


def request(command: int, payload: bytes = b"") -> bytes:
    """A request packet (figure 2-4); with a payload there are its size and a checksum too."""
    if not payload:
        return bytes((START, command))
    packet = bytes((START, command, len(payload))) + payload
    return packet + bytes((checksum(packet),))


def checksum(data: bytes) -> int:
    """All bytes, combined by exclusive or."""
    return reduce(xor, data, 0)


def motor(pwm: int) -> bytes:
    """The request that sets the motor's duty, 0 to 1023."""
    return request(SET_MOTOR_PWM, struct.pack("<H", pwm))


EXPRESS: Final = request(EXPRESS_SCAN, bytes(5))
"""Express scan in its first working mode, which all of the series have."""


def read_descriptor(data: bytes) -> Descriptor | None:
    """The descriptor at the beginning of 7 bytes; None where they are none."""
    if len(data) < DESCRIPTOR_SIZE or not data.startswith(ANSWER):
        return None
    size, kind = struct.unpack_from("<IB", data, 2)
    return Descriptor(size & 0x3FFFFFFF, size >> 30 == 1, kind)


def read_info(data: bytes) -> Info:
    """The 20 bytes of GET_INFO."""
    model, minor, major, hardware = data[:4]
    return Info(model, (major, minor), hardware, data[4:].hex().upper())


def read_health(data: bytes) -> Health:
    """The 3 bytes of GET_HEALTH. Raises SourceError where the status is none."""
    status, code = struct.unpack("<BH", data)
    if status >= len(HEALTHS):
        raise SourceError(f"the lidar says that its health is {status}, which means nothing")
    return Health(HEALTHS[status], code)
