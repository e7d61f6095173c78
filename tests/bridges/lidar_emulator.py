"""An emulated RPLIDAR, written from the protocol documentation only."""

import struct
import threading
import time

from tests.patience import eventually


def room(angle):
    """Distance in metres to the wall at a clockwise angle in degrees; all four sides differ."""
    from math import cos, radians, sin

    a = radians(angle)
    return 2.0 + 0.6 * sin(a) + 0.3 * cos(a) + 0.2 * sin(2 * a)


def descriptor(size, mode, kind):
    return b"\xa5\x5a" + struct.pack("<IB", size | mode << 30, kind)


def standard_sample(angle, metres, start, quality=15):
    """One sample of a standard scan (figure 4-5)."""
    q6, q2 = round(angle * 64) % (360 * 64), round(metres * 4000)
    return bytes(
        (quality << 2 | (not start) << 1 | start, (q6 & 0x7F) << 1 | 1, q6 >> 7)
    ) + struct.pack("<H", q2)


def capsule(angle, samples, start=False):
    """A capsule of 32 samples (metres, compensation in 1/8 degree), figures 4-12 and 4-13."""
    body = struct.pack("<H", (round(angle * 64) % (360 * 64)) | start << 15)
    for (m1, d1), (m2, d2) in zip(samples[::2], samples[1::2], strict=True):
        mm1, mm2 = round(m1 * 1000), round(m2 * 1000)
        body += struct.pack(
            "<HHB", mm1 << 2 | d1 >> 4, mm2 << 2 | d2 >> 4, d1 & 15 | (d2 & 15) << 4
        )
    check = 0
    for byte in body:
        check ^= byte
    return bytes((0xA0 | check & 15, 0x50 | check >> 4)) + body


def capsules(step=0.9, compensation=lambda k: 12 + k % 3, angle=0.0, wall=room):
    """An endless stream of capsules whose samples are `step` degrees apart."""
    first = True
    while True:
        angles = [angle + step * k for k in range(32)]
        eighths = [compensation(k) for k in range(32)]
        pairs = [(wall(a - d / 8), d) for a, d in zip(angles, eighths, strict=True)]
        yield capsule(angle % 360, pairs, first)
        angle, first = (angle + 32 * step) % 360, False


def samples(step=1.0, angle=300.0, wall=room):
    """An endless stream of standard samples that starts in the middle of a revolution."""
    before = angle - step
    while True:
        yield standard_sample(angle % 360, wall(angle), angle % 360 < before % 360)
        before, angle = angle, angle + step


class Emulator:
    """A lidar at the device end of a cable.

    `healths` are the health codes that it reports, one for each reset; `breaks` maps the n-th packet
    to the bytes that are sent instead; `part` splits the output into parts of that many bytes.
    `express` is what it makes of an express scan: the type of its answer, and its packets.
    """

    def __init__(
        self, cable, firmware=(1, 29), healths=(0,), breaks=None, part=0, boot=b"",
        express=(0x82, capsules),
    ):  # fmt: skip
        self.cable = cable
        self.firmware = firmware
        self.healths = list(healths)
        self.breaks = breaks or (lambda n, packet: packet)
        self.part = part
        self.boot, self.express = boot, express
        self.mute = False
        self.heard = []
        self.packets = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._live, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *exc):
        self._over.set()
        self._thread.join()

    def hears(self, *requests):
        """Wait until the last received requests are these."""
        eventually(lambda: self.heard[-len(requests) :] == list(requests), lambda: self.heard)

    def _live(self):
        count = 0
        while not self._over.is_set():
            self._hear(self.cable.read())
            if self.packets is not None and not self.mute:
                self._say(self.breaks(count, next(self.packets)))
                count += 1
            time.sleep(0.0005)

    def _hear(self, said):
        while said:
            command, size = said[1], 0
            if command & 0x80:
                size = said[2] + 2
            self.heard.append(said[: 2 + size])
            said = said[2 + size :]
            if not self.mute:
                self._obey(command)

    def _obey(self, command):
        if command == 0x25:
            self.packets = None
        elif command == 0x40:
            self.packets = None
            if len(self.healths) > 1:
                self.healths.pop(0)
            self._say(self.boot)
        elif command == 0x50:
            major, minor = self.firmware
            info = bytes((24, minor, major, 7)) + bytes(range(16))
            self._say(descriptor(20, 0, 0x04) + info)
        elif command == 0x52:
            status = self.healths[0]
            self._say(descriptor(3, 0, 0x06) + struct.pack("<BH", status, 0x8001 * (status > 0)))
        elif command == 0x20:
            self._say(descriptor(5, 1, 0x81))
            self.packets = samples()
        elif command == 0x82:
            kind, packets = self.express
            self._say(descriptor(84, 1, kind))
            self.packets = packets()

    def _say(self, data):
        part = self.part or len(data) or 1
        for at in range(0, len(data), part):
            self.cable.write(data[at : at + part])
