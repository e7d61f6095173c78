"""Lines between network namespaces: they delay, lose and cut packets."""

import subprocess
import sys
from contextlib import ExitStack, contextmanager

import pytest

from benchmarks.ip_lines import Lines
from minerva_bus.errors import BusError

ECHO = """
import socket
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here:
    here.bind(("", 7000))
    print("ready", flush=True)
    while True:
        data, sender = here.recvfrom(99)
        here.sendto(data, sender)
"""
SEND = """
import socket, sys, time
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here:
    here.settimeout(float(sys.argv[2]))
    began = time.monotonic()
    here.sendto(b"x", (sys.argv[1], 7000))
    here.recv(99)
    print(time.monotonic() - began)
"""


@contextmanager
def echoing(lines, host):
    words = [*lines.inside(host), sys.executable, "-c", ECHO]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "ready\n"
            yield
        finally:
            process.kill()


def seconds(lines, patience):
    """Until a packet of host 0 is back from host 1; None if it does not come back."""
    words = [*lines.inside(0), sys.executable, "-c", SEND, lines.address(1), str(patience)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return float(done.stdout) if done.stdout else None


def test_lines_delay_lose_and_cut():
    with ExitStack() as opened:
        try:
            lines = opened.enter_context(Lines(2))
        except (BusError, OSError) as error:
            pytest.skip(f"no network namespaces: {error}")
        opened.enter_context(echoing(lines, 1))
        lines.delay = 0.1
        assert seconds(lines, 30) >= 0.2
        lines.delay, lines.lost = 0.0, 1.0
        assert seconds(lines, 0.2) is None
        lines.lost, lines.cuts = 0.0, {frozenset((0, 1))}
        assert seconds(lines, 0.2) is None
        lines.cuts = {frozenset((0, 2))}
        assert seconds(lines, 30) is not None
