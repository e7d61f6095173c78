"""Processes that step the worlds of a vector environment; results are in shared memory.

A command is a line of JSON in a pipe of each worker: the seeds of a reset, "step" or "digests". The
answer is a report in another pipe. The end of that pipe is the end of the worker, so that a crash
is an error and never a wait without end.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final

from minerva_bus.errors import MinervaError, WorldStopped
from minerva_bus.launch.child_processes import (
    ChildProcess,
    LineReader,
    Pipes,
    ReportPipe,
    fork,
    how_ended,
    kill,
    parse_report,
    reap,
)
from minerva_bus.user_code import report
from minerva_learning.block import MakeEnv, WorldBlock
from minerva_learning.shared import SharedArrays

CLOSE_SECONDS: Final = 1.0
"""Time for workers to close their worlds, before they are killed."""

MAX_OUTPUT: Final = 500
"""Length of the last line of a worker's output that an error quotes."""


@dataclass(slots=True)
class _EnvironmentWorker:
    """A process with its worlds; `commands` is the pipe in which it receives commands."""

    number: int
    worlds: range
    child: ChildProcess
    commands: int
    readers: list[LineReader] = field(default_factory=list[LineReader])
    report: dict[str, Any] | None = None
    last_line: str = ""

    def on_report(self, line: str) -> None:
        self.report = parse_report(line)

    def on_output(self, line: str) -> None:
        # What code of a world prints, as if the world were in this process.
        sys.stderr.write(f"{line}\n")
        if line.strip():
            self.last_line = line.strip()[-MAX_OUTPUT:]

    @property
    def open(self) -> bool:
        """Whether the process may still report."""
        return self.readers[0].open

    @property
    def label(self) -> str:
        """Names the worker in messages."""
        first, last = self.worlds[0], self.worlds[-1]
        worlds = f"world {first}" if first == last else f"worlds {first} to {last}"
        return f"worker {self.number} with {worlds}"


class WorldWorkers:
    """Worlds in processes forked from this one.

    Args:
        make: makes the environment of a world.
        blocks: the numbers of the worlds of each process.
        arrays: in memory that the processes share.

    """

    def __init__(self, make: MakeEnv, blocks: Sequence[range], arrays: SharedArrays) -> None:
        self._lifeline = os.pipe()
        self._pipes = Pipes()
        self._workers: list[_EnvironmentWorker] = []
        self._closed = False
        self._arrays = arrays
        try:
            for number, worlds in enumerate(blocks):
                self._start(number, worlds, make)
        except BaseException:
            self.kill()
            raise

    def reset(self, seeds: Sequence[int | None]) -> None:
        """Begin an episode in each world. Raises WorldStopped."""
        self._command(list(seeds))

    def step(self) -> None:
        """Step all worlds. Raises WorldStopped."""
        self._command("step")

    def put_digests(self) -> None:
        """Write the digest of each world into the arrays. Raises WorldStopped."""
        self._command("digests")

    def _start(self, number: int, worlds: range, make: MakeEnv) -> None:
        (read, write), (commands, give) = os.pipe(), os.pipe()
        child = fork(
            lambda: _serve(make, worlds, self._arrays, commands, ReportPipe(write)),
            (write, commands),
            self._lifeline[0],
        )
        os.close(write)
        os.close(commands)
        os.set_blocking(read, False)
        worker = _EnvironmentWorker(number, worlds, child, give)
        worker.readers = [
            LineReader(self._pipes, read, worker.on_report),
            LineReader(self._pipes, child.output, worker.on_output),
        ]
        self._workers.append(worker)

    def _command(self, command: list[int | None] | str) -> None:
        line = json.dumps(command).encode() + b"\n"
        for worker in self._workers:
            worker.report = None
            with suppress(BrokenPipeError):  # It has died; the end of its report pipe reports that.
                os.write(worker.commands, line)
        while any(worker.report is None and worker.open for worker in self._workers):
            self._pipes.wait(None)
        for worker in self._workers:
            problem = self._problem(worker)
            if problem:
                raise WorldStopped(f"{worker.label}: {problem}")

    def _problem(self, worker: _EnvironmentWorker) -> str:
        """Why a worker has not done a command; "" if it has."""
        if worker.report is not None:
            return str(worker.report.get("error", ""))
        code = os.waitstatus_to_exitcode(self._reap(worker))
        output = f": {worker.last_line}" if worker.last_line else ""
        return f"its process {how_ended(code)}{output}"

    def _reap(self, worker: _EnvironmentWorker) -> int:
        """Remove a worker whose pipe has ended; returns its wait status."""
        self._workers.remove(worker)
        os.close(worker.commands)
        return reap(worker.child.pid, worker.readers)

    def close(self) -> None:
        """End the worlds and the processes."""
        for worker in self._workers:
            # A worker closes its worlds at the end of its commands.
            os.close(worker.commands)
            worker.commands = os.open(os.devnull, os.O_WRONLY)
        until = time.monotonic() + CLOSE_SECONDS
        while any(worker.open for worker in self._workers) and time.monotonic() < until:
            self._pipes.wait(max(0.0, until - time.monotonic()))
        self.kill()

    def kill(self) -> None:
        """End the processes at once."""
        if self._closed:
            return
        # A second Ctrl-C would leave the processes that are not waited for yet.
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._closed = True
            for worker in self._workers:
                kill(worker.child.pid)
            while self._workers:
                self._reap(self._workers[0])
            self._pipes.close()
            for descriptor in self._lifeline:
                os.close(descriptor)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _serve(
    make: MakeEnv, worlds: range, arrays: SharedArrays, commands: int, reports: ReportPipe
) -> int:
    """Carry out the commands of a vector environment in a worker."""
    block = WorldBlock(make, worlds, arrays)
    with os.fdopen(commands, encoding="ascii") as lines:
        for line in lines:
            command = json.loads(line)
            try:
                if command == "step":
                    block.step()
                elif command == "digests":
                    block.put_digests()
                else:
                    block.reset(command)
            except MinervaError as error:
                reports.send("failed", error=str(error))
            except Exception as error:  # of code that the user has written, such as a reward
                reports.send("failed", error=report(error))
            else:
                reports.send("done")
    block.close()
    return 0
