"""Processes of benchmarks: forked members, their coordinator, and external commands."""

from __future__ import annotations

import gc
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.runtime.coordinator import Coordinator, Watchers
from minerva_bus.runtime.participants import MemberProcess
from minerva_bus.runtime.runner import Sink

END_SECONDS = 10.0


def forked(body: Callable[[], int | None]) -> int:
    """Run a function in a forked process; returns its id. The result is the exit code."""
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
    """Processes of members that wait for the endpoint of their world.

    Create them before this process opens a session, since Zenoh's threads do not survive a fork.
    """

    def __init__(self, world: str, factories: Mapping[str, Callable[[], Member]]) -> None:
        self.pids: dict[str, int] = {}
        self._pipes: list[int] = []
        for name, make in factories.items():
            read, write = os.pipe()
            body = partial(_run_member, world, make, read, [write, *self._pipes])
            self.pids[name] = forked(body)
            os.close(read)
            self._pipes.append(write)

    def connect(self, endpoint: str) -> None:
        """Let the members join the world at an endpoint."""
        for pipe in self._pipes:
            os.write(pipe, f"{endpoint}\n".encode())
            os.close(pipe)

    def failed(self) -> list[str]:
        """Members that have failed since the last call."""
        ended = {name: os.waitpid(pid, os.WNOHANG) for name, pid in self.pids.items()}
        for name, (pid, _) in ended.items():
            if pid:
                del self.pids[name]
        return [name for name, (pid, status) in ended.items() if pid and status]

    def wait(self) -> None:
        """Wait until all have ended; report and kill those that exceed the time-out."""
        until = time.monotonic() + END_SECONDS
        self.failed()
        while self.pids and time.monotonic() < until:
            time.sleep(0.01)
            self.failed()
        for name, pid in self.pids.items():
            print(f"{name}: did not end within {END_SECONDS:g} s; killed", file=sys.stderr)
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)


def _run_member(world: str, make: Callable[[], Member], endpoint: int, others: list[int]) -> int:
    for pipe in others:
        os.close(pipe)
    with os.fdopen(endpoint) as pipe:
        address = pipe.readline().strip()
    return MemberProcess([make()], world, address, print).run() if address else 1


def coordinator(
    world: WorldSpec,
    listening: Callable[[str], None],
    frame_done: Callable[[s.FrameDone], None],
    status: Callable[[Any], None] = lambda _: None,
    said: Callable[[str, str, str], None] | None = None,
    rate: float = 0.0,
    sinks: Sequence[Sink] = (),
    idle: Callable[[], None] = lambda: None,
) -> Coordinator:
    """A coordinator that prints its log lines; a member that stalls ends the world.

    `idle` is called before it waits for members, as for a record.
    """

    def log(name: str, line: str, _: str) -> None:
        print(f"{name}: {line}", file=sys.stderr)

    def stalled(name: str, _: float) -> None:
        made.handle(s.End(f"{name} does not answer"))

    watchers = Watchers(
        said=said or log,
        status=status,
        listening=listening,
        stalled=stalled,
        frame_done=frame_done,
        idle=idle,
    )
    made = Coordinator(world, watchers, rate=rate, sinks=sinks)
    return made


def answered(
    words: Sequence[str | Path], folder: Path | None = None, timeout: float = 600.0
) -> Any | str:
    """The last line of JSON in a command's output, or a text with the reason for its absence."""
    try:
        done = subprocess.run(
            words, cwd=folder, capture_output=True, text=True, timeout=timeout, check=False
        )
    except subprocess.TimeoutExpired:
        return f"no end after {timeout:g} s"
    for line in reversed(done.stdout.splitlines()):
        if line.startswith(("{", "[")):
            return json.loads(line)
    return f"exit code {done.returncode}: {(done.stderr or done.stdout)[-400:].strip()}"


def task(module: str, *words: object) -> Any:
    """The result of a benchmark's `--task` in a new process; exits on failure."""
    result = answered([sys.executable, "-m", module, "--task", *map(str, words)])
    if isinstance(result, str):
        sys.exit(f"{' '.join(map(str, words))}: {result}")
    return result
