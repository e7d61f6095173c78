"""A slow and lossy line between two bridges: it delays or drops Ethernet frames.

    python line.py PORT OTHER SECONDS LOST BRIDGE OTHER

Creates two ports (tap devices), one on each bridge. Every frame is delayed by SECONDS, and a
fraction LOST of the frames is dropped, so that TCP has to retransmit their content. The script
prints a line when it is ready, and then the number of dropped frames after each drop.
"""

import fcntl
import os
import select
import struct
import subprocess
import sys
import time
from collections import deque
from random import Random

TAP_WITHOUT_HEADER = 0x0002 | 0x1000
SET_INTERFACE = 0x400454CA
LONGEST = 65536


def port(name):
    """A tap device with this name, open until the process ends."""
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, SET_INTERFACE, struct.pack("16sH22x", name.encode(), TAP_WITHOUT_HEADER))
    return device


def carry(near, other, seconds, lost):
    """Forward frames in both directions forever."""
    random, dropped = Random(1), 0
    on_the_way = deque()
    to = {near: other, other: near}
    while True:
        wait = on_the_way[0][0] - time.monotonic() if on_the_way else 1.0
        ready, _, _ = select.select([near, other], [], [], max(0.0, wait))
        for device in ready:
            frame = os.read(device, LONGEST)
            if random.random() < lost:
                dropped += 1
                print(dropped, flush=True)
            else:
                on_the_way.append((time.monotonic() + seconds, to[device], frame))
        while on_the_way and on_the_way[0][0] <= time.monotonic():
            _, device, frame = on_the_way.popleft()
            os.write(device, frame)


def main():
    names, (seconds, lost) = sys.argv[1:3], map(float, sys.argv[3:5])
    ports = [port(name) for name in names]
    for name, bridge in zip(names, sys.argv[5:7], strict=True):
        subprocess.run(["ip", "link", "set", name, "master", bridge, "up"], check=True)
    print("begun", flush=True)
    carry(*ports, seconds, lost)


if __name__ == "__main__":
    main()
