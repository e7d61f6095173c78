"""The serial protocol: requests, response descriptors, device info and health.

Source: SLAMTEC, "RPLIDAR: Interface Protocol and Application Notes" (A series, rev. 1.x and 2.x),
chapters 2 and 4; "chapter" and "figure" in this package refer to this document. All numbers are
little-endian.
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
"""PWM duty of the motor where the adapter controls it; an A1 is switched by DTR instead."""

EXPRESS_SINCE: Final = (1, 17)
"""First firmware with EXPRESS_SCAN."""


@dataclass(frozen=True, slots=True)
class Descriptor:
    """A response descriptor (figure 2-7): packet size, whether several follow, data type."""

    size: int
    is_multiple: bool
    type: int


INFO: Final = Descriptor(20, False, 0x04)
HEALTH: Final = Descriptor(3, False, 0x06)
SAMPLES: Final = Descriptor(5, True, 0x81)
CAPSULES: Final = Descriptor(84, True, 0x82)


@dataclass(frozen=True, slots=True)
class LidarInfo:
    """Identification of a device (GET_INFO)."""

    model: int
    firmware: tuple[int, int]
    hardware: int
    serial: str

    def __str__(self) -> str:
        major, minor = self.firmware
        return f"model {self.model}, firmware {major}.{minor:02}, serial number {self.serial}"


HEALTHS: Final = ("good", "warning", "error")


@dataclass(frozen=True, slots=True)
class LidarHealth:
    """Health of a device (GET_HEALTH): `status` is one of `HEALTHS`."""

    status: str
    code: int

    def __str__(self) -> str:
        return self.status if self.status == "good" else f"{self.status} 0x{self.code:04x}"


def request(command: int, payload: bytes = b"") -> bytes:
    """A request packet (figure 2-4); with a payload, also its size and a checksum."""
    if not payload:
        return bytes((START, command))
    packet = bytes((START, command, len(payload))) + payload
    return packet + bytes((checksum(packet),))


def checksum(data: bytes) -> int:
    """XOR of all bytes."""
    return reduce(xor, data, 0)


def motor(pwm: int) -> bytes:
    """The request that sets the motor's PWM duty, 0 to 1023."""
    return request(SET_MOTOR_PWM, struct.pack("<H", pwm))


EXPRESS: Final = request(EXPRESS_SCAN, bytes(5))
"""Express scan in its first working mode, which all models of the series support."""


def read_descriptor(data: bytes) -> Descriptor | None:
    """Parse a descriptor from 7 bytes; None if invalid."""
    if len(data) < DESCRIPTOR_SIZE or not data.startswith(ANSWER):
        return None
    size, kind = struct.unpack_from("<IB", data, 2)
    # The two upper bits are the send mode; 1 announces several packets.
    return Descriptor(size & 0x3FFFFFFF, size >> 30 == 1, kind)


def read_info(data: bytes) -> LidarInfo:
    """Parse the 20 bytes of GET_INFO."""
    # The minor version precedes the major one.
    model, minor, major, hardware = data[:4]
    return LidarInfo(model, (major, minor), hardware, data[4:].hex().upper())


def read_health(data: bytes) -> LidarHealth:
    """Parse the 3 bytes of GET_HEALTH. Raises SourceError for an unknown status."""
    status, code = struct.unpack("<BH", data)
    if status >= len(HEALTHS):
        raise SourceError(f"the lidar reports an unknown health status {status}")
    return LidarHealth(HEALTHS[status], code)
