"""Hosts on slow lines that lose IP packets: network namespaces that this process connects.

Many kernels of containers and small virtual machines have no `netem`. Here each host has a TUN
device, and a thread carries the packets between them: each after `delay` seconds, or, with the
probability `lost`, never. So TCP itself repeats what is lost. It needs /dev/net/tun, `ip`, and
root, or `unshare --map-root-user --net --mount` before the command.
"""

from __future__ import annotations

import fcntl
import heapq
import os
import select
import struct
import subprocess
import threading
import time
from contextlib import ExitStack
from itertools import count
from random import Random
from typing import Final, Self

from minerva_bus.errors import BusError

SET_DEVICE: Final = 0x400454CA
"""TUNSETIFF of the kernel."""

PLAIN_TUN: Final = 0x1001
"""IFF_TUN and IFF_NO_PI: IP packets without a header of the device."""

MAX_PACKET: Final = 65536
FROM: Final = slice(12, 16)
TO: Final = slice(16, 20)
"""The addresses in an IPv4 packet."""

NET: Final = bytes((10, 77, 0))
"""How the addresses of all hosts begin."""


def run(*words: str) -> None:
    """Run a command. Raises BusError with what it says if it fails."""
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        said = done.stderr.strip() or f"it ended with {done.returncode}"
        raise BusError(f"{' '.join(words)}: {said} (root is needed; see benchmarks/ip_lines.py)")


class Lines:
    """Lines between all pairs of hosts; a context manager that removes them at the end.

    `delay`, in seconds for one direction, and `lost`, from 0 to 1, may change at any time, and so
    may the `cuts`: pairs of hosts whose lines lose everything.
    """

    def __init__(self, hosts: int, seed: int = 1) -> None:
        self.delay: float = 0.0
        self.lost: float = 0.0
        self.cuts: set[frozenset[int]] = set()
        self._random = Random(seed)
        self._names = [f"lines-{os.getpid()}-{n}" for n in range(hosts)]
        self._devices: dict[int, int] = {}
        self._wake, self._waker = os.pipe()
        self._thread = threading.Thread(target=self._carry, daemon=True)

    def __enter__(self) -> Self:
        with ExitStack() as failed:
            failed.callback(self._remove)
            for number in range(len(self._names)):
                self._add(number)
            failed.pop_all()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        os.write(self._waker, b" ")
        self._thread.join()
        self._remove()

    def _remove(self) -> None:
        for name in self._names:
            subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)
        for device in (*self._devices.values(), self._wake, self._waker):
            os.close(device)

    def address(self, host: int) -> str:
        """The IP address of a host."""
        return ".".join(map(str, (*NET, host + 1)))

    def inside(self, host: int) -> list[str]:
        """The words before a command that runs on a host."""
        return ["ip", "netns", "exec", self._names[host]]

    def _add(self, host: int) -> None:
        space, device, address = self._names[host], f"line{host}", self.address(host)
        run("ip", "netns", "add", space)
        tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        self._devices[host] = tun
        fcntl.ioctl(tun, SET_DEVICE, struct.pack("16sH22x", device.encode(), PLAIN_TUN))
        # An open device keeps its packets when it moves to a namespace.
        run("ip", "link", "set", device, "netns", space)
        run("ip", "-n", space, "addr", "add", f"{address}/24", "dev", device)
        for each in ("lo", device):
            run("ip", "-n", space, "link", "set", each, "up")

    def _carry(self) -> None:
        waiting: list[tuple[float, int, int, bytes]] = []
        number = count()
        watched = [self._wake, *self._devices.values()]
        while True:
            now = time.monotonic()
            while waiting and waiting[0][0] <= now:
                _, _, device, packet = heapq.heappop(waiting)
                os.write(device, packet)
            left = waiting[0][0] - now if waiting else None
            readable, _, _ = select.select(watched, [], [], left)
            if self._wake in readable:
                return
            for source in readable:
                packet = os.read(source, MAX_PACKET)
                if (device := self._target(packet)) is not None:
                    due = time.monotonic() + self.delay
                    heapq.heappush(waiting, (due, next(number), device, packet))

    def _target(self, packet: bytes) -> int | None:
        """The device for a packet; None if it is lost."""
        ends = packet[FROM], packet[TO]
        if not all(end[:3] == NET for end in ends):
            return None  # Multicast, and IPv6.
        source, to = (end[3] - 1 for end in ends)
        lost = self._random.random() < self.lost or frozenset((source, to)) in self.cuts
        return None if lost else self._devices.get(to)
