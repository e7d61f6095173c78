"""Processes of a benchmark: forked from it, as the launcher forks those of a world."""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial

from minerva_bus.frame.member import Member
from minerva_bus.runtime.member import MemberProcess

ENDED_WITHIN = 10.0


def forked(body: Callable[[], int | None]) -> int:
    """Run a body in a process of its own, whose id it is; what it returns is the exit code."""
    child = os.fork()
    if child:
        return child
    gc.freeze()
    code = 1
    try:
        code = body() or 0
    finally:
        os._exit(code)


class Members:
    """Processes that wait to be told where their world is.

    To be made before this process opens a session, and before it has much that they would share.
    """

    def __init__(self, world: str, making: Mapping[str, Callable[[], Member]]) -> None:
        self.pids: dict[str, int] = {}
        self._pipes: list[int] = []
        for name, make in making.items():
            read, write = os.pipe()
            self.pids[name] = forked(partial(_take_part, world, make, read, [write, *self._pipes]))
            os.close(read)
            self._pipes.append(write)

    def tell(self, endpoint: str) -> None:
        """They join."""
        for pipe in self._pipes:
            os.write(pipe, f"{endpoint}\n".encode())
            os.close(pipe)

    def failed(self) -> list[str]:
        """Who has ended with a failure since this was asked last."""
        ended = {name: os.waitpid(pid, os.WNOHANG) for name, pid in self.pids.items()}
        for name, (pid, _) in ended.items():
            if pid:
                del self.pids[name]
        return [name for name, (pid, status) in ended.items() if pid and status]

    def wait(self) -> None:
        """Wait until they have ended; who takes too long is named, and killed."""
        until = time.monotonic() + ENDED_WITHIN
        self.failed()
        while self.pids and time.monotonic() < until:
            time.sleep(0.01)
            self.failed()
        for name, pid in self.pids.items():
            print(f"{name}: did not end within {ENDED_WITHIN:g} s; killed", file=sys.stderr)
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)


def _take_part(world: str, make: Callable[[], Member], endpoint: int, others: list[int]) -> int:
    """What a member does, to its end."""
    for pipe in others:
        os.close(pipe)
    with os.fdopen(endpoint) as pipe:
        address = pipe.readline().strip()
    return MemberProcess(make(), world, address, print).run() if address else 1
