"""The serial protocol: requests, response descriptors, device info and health.

Source: SLAMTEC, "RPLIDAR: Interface Protocol and Application Notes" (A series, rev. 1.x and 2.x),
chapters 2 and 4; "chapter" and "figure" in this package refer to this document. All numbers are
little-endian.

Scan data become measurements and revolutions (chapter 4, figures 4-5, 4-12 and 4-13; angles of an
express scan: "Data processing of the express scan data"); damaged packets are counted.
"""

from __future__ import annotations

import struct
from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from operator import xor
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

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


Count: TypeAlias = Callable[[str], None]

SYNC_SAMPLES: Final = 8
"""Consecutive valid samples of a standard scan required to resynchronise."""

MAX_CAPSULE_DEGREES: Final = 90.0
"""Maximum span of a capsule in degrees; a larger one means that capsules were lost."""


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Measurements in the order of time, each of shape (n,).

    `angles` are degrees clockwise from the lidar's front, in its direction of rotation; `distances`
    metres, 0 for no measurement; `starts` marks the first sample of a revolution.
    """

    angles: NDArray[np.float64]
    distances: NDArray[np.float64]
    starts: NDArray[np.bool_]


NO_SAMPLES: Final = Samples(np.empty(0), np.empty(0), np.empty(0, np.bool_))


class Packets:
    """Decodes a byte stream, in chunks of any size, to samples.

    Errors are counted by `count`. After damage, the next packet is searched byte by byte.
    """

    def __init__(self, count: Count) -> None:
        self._count = count
        self._bytes = b""

    def feed(self, data: bytes) -> Iterator[Samples]:
        """The samples that are complete now."""
        self._bytes += data
        while (samples := self._next()) is not None:
            if len(samples.angles):
                yield samples

    @abstractmethod
    def _next(self) -> Samples | None:
        """The next samples, possibly empty; None if more bytes are needed."""


class StandardPackets(Packets):
    """The five-byte samples of a standard scan.

    Each has only two check bits, S against its inverse and a constant 1. After a failure, several
    consecutive samples must therefore be valid.
    """

    def __init__(self, count: Count) -> None:
        super().__init__(count)
        self._in_step = True

    def _next(self) -> Samples | None:
        needed = 1 if self._in_step else SYNC_SAMPLES
        whole = len(self._bytes) // SAMPLES.size
        if whole < needed:
            return None
        rows = np.frombuffer(self._bytes, np.uint8, whole * SAMPLES.size).reshape(whole, -1)
        # S and its inverse are bits 0 and 1 of the first byte, the constant is bit 0 of the second.
        wrong = np.flatnonzero(((rows[:, 0] ^ (rows[:, 0] >> 1)) & rows[:, 1] & 1) == 0)
        right = int(wrong[0]) if len(wrong) else whole
        if right >= needed:
            self._in_step = True
            self._bytes = self._bytes[right * SAMPLES.size :]
            return _standard(rows[:right])
        if self._in_step:
            self._count("damaged packets")
        self._in_step = False
        # Resynchronise byte by byte.
        self._bytes = self._bytes[1:]
        return NO_SAMPLES


def _standard(rows: NDArray[np.uint8]) -> Samples:
    words = rows.astype(np.uint16)
    # The lowest bit of an angle is the constant check bit.
    angles = ((words[:, 1] >> 1) | (words[:, 2] << 7)) / 64.0
    # Quarters of a millimetre; angles are 64ths of a degree.
    distances = (words[:, 3] | (words[:, 4] << 8)) / 4000.0
    return Samples(angles, distances, (rows[:, 0] & 1).astype(np.bool_))


class ExpressPackets(Packets):
    """The capsules of an express scan: 32 samples each, with a checksum.

    A capsule's angles depend on the start of the next one, so it is emitted when that has arrived.
    Angular compensations are read as unsigned numbers, like the vendor's own driver does, although
    the document describes their top bit as a sign.
    """

    def __init__(self, count: Count) -> None:
        super().__init__(count)
        self._before = b""
        self._last = 0.0

    def _next(self) -> Samples | None:
        if not self._find():
            return None
        capsule = self._bytes[: CAPSULES.size]
        # The two sync bytes carry half of the checksum each.
        if checksum(capsule[2:]) != (capsule[0] & 0xF) | (capsule[1] & 0xF) << 4:
            self._count("damaged packets")
            # Without its successor, the capsule before has no end angle, so it is lost as well.
            self._bytes, self._before = self._bytes[1:], b""
            return NO_SAMPLES
        self._bytes = self._bytes[CAPSULES.size :]
        before, self._before = self._before, capsule
        return self._between(before, capsule) if before else NO_SAMPLES

    def _find(self) -> bool:
        """Advance to the next possible start of a capsule; True if a complete one follows."""
        data, at = self._bytes, 0
        # The upper halves of the sync bytes are A and 5.
        while at + 1 < len(data) and (data[at] >> 4, data[at + 1] >> 4) != (0xA, 0x5):
            at += 1
        # Skipped bytes mean a lost capsule, so the last one has no successor.
        if at:
            self._before = b""
        self._bytes = data[at:]
        return len(self._bytes) >= CAPSULES.size

    def _between(self, capsule: bytes, after: bytes) -> Samples:
        first = _start(capsule)
        width = (_start(after) - first) % 360.0
        if width > MAX_CAPSULE_DEGREES:
            self._count("lost packets")
            return NO_SAMPLES
        raw, angles, distances = _express(capsule, first, width)
        # Of the raw angles, because compensation may reverse neighbouring samples.
        starts = np.diff(raw, prepend=self._last) < 0
        self._last = float(raw[-1])
        return Samples(angles, distances, starts)


def _start(capsule: bytes) -> float:
    """Start angle of a capsule in degrees; the top bit S only marks the start of a scan."""
    return ((capsule[2] | capsule[3] << 8) & 0x7FFF) / 64.0


def _express(capsule: bytes, first: float, width: float) -> tuple[NDArray[np.float64], ...]:
    """Raw angles, angles and distances of a capsule with this start angle and width.

    θ_k = ω_i + AngleDiff(ω_i, ω_{i+1})/32 · k − dθ_k, degrees; the raw angle is θ_k + dθ_k. A
    revolution begins with a sample whose raw angle is smaller than its predecessor's.
    """
    cabins = np.frombuffer(capsule, np.uint8, offset=4).reshape(16, 5).astype(np.uint16)
    words = np.stack([cabins[:, 0] | cabins[:, 1] << 8, cabins[:, 2] | cabins[:, 3] << 8], axis=1)
    low = np.stack([cabins[:, 4] & 0xF, cabins[:, 4] >> 4], axis=1)
    # The two lowest bits of a distance are the upper bits of its angular compensation (figure
    # 4-13).
    compensation = (low | (words & 3) << 4) / 8.0
    raw = (first + width / 32.0 * np.arange(32, dtype=np.float64)) % 360.0
    return raw, (raw - compensation.ravel()) % 360.0, (words >> 2).ravel() / 1000.0


MAX_SAMPLES: Final = 32_768
"""Samples without the start of a revolution after which the data are discarded."""


class RevolutionBuffer:
    """Collects samples until a revolution is complete; the first partial one is discarded."""

    def __init__(self, count: Count) -> None:
        self._count = count
        self._parts: list[Samples] = []
        self._length = 0
        self._begun = False

    def add(self, samples: Samples) -> Iterator[Samples]:
        """The revolutions that end within these samples."""
        cuts = [0, *np.flatnonzero(samples.starts).tolist(), len(samples.angles)]
        for number, (begin, end) in enumerate(pairwise(cuts)):
            if number:
                yield from self._end()
                self._begun = True
            if self._begun and end > begin:
                self._gather(_part(samples, begin, end))

    def _end(self) -> Iterator[Samples]:
        if self._parts:
            yield Samples(
                np.concatenate([part.angles for part in self._parts]),
                np.concatenate([part.distances for part in self._parts]),
                np.concatenate([part.starts for part in self._parts]),
            )
        self._parts, self._length = [], 0

    def _gather(self, part: Samples) -> None:
        self._parts.append(part)
        self._length += len(part.angles)
        if self._length > MAX_SAMPLES:
            self._count("endless turns")
            self._parts, self._length, self._begun = [], 0, False


def _part(samples: Samples, begin: int, end: int) -> Samples:
    rows = slice(begin, end)
    return Samples(samples.angles[rows], samples.distances[rows], samples.starts[rows])


def ranges(turn: Samples, beams: int) -> NDArray[np.float32]:
    """A revolution in equal steps, shape (beams,), metres: beam i at i·360/beams degrees.

    Counter-clockwise, unlike the lidar's own angles. Each sample belongs to the nearest beam, whose
    shortest hit counts; a beam without samples is 0.
    """
    hit = turn.distances > 0
    beam = np.rint(-turn.angles[hit] * (beams / 360.0)).astype(np.intp) % beams
    nearest = np.full(beams, np.inf)
    # Unlike nearest[beam] = ..., this handles several samples per beam.
    np.minimum.at(nearest, beam, turn.distances[hit])
    nearest[np.isinf(nearest)] = 0.0
    return nearest.astype(np.float32)
