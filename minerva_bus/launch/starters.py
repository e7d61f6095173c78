"""How a process comes to life: forked from this one, or a command of its own.

Forking costs milliseconds, where a new Python would spend most of its start on imports. It is
safe because the launcher is a single thread that never opens a Zenoh session.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from minerva_bus.errors import MinervaError
from minerva_bus.launch import traces

FAILED: Final = os.EX_SOFTWARE
"""The exit code of a child that ended by an exception that is not meant for users."""


@dataclass(slots=True)
class Child:
    """A process of ours: its id and the end of the pipe that its output comes from."""

    name: str
    pid: int
    output: int


def fork(name: str, body: Callable[[], int], keep: Collection[int], lifeline: int) -> Child:
    """Run `body` in a new process that dies with this one; its result is the exit code.

    `keep` are the file descriptors that it needs; every other one is closed in it, so that this
    process's death can be seen at `lifeline`.
    """
    read, write = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid:
        os.close(write)
        os.set_blocking(read, False)
        return Child(name, pid, read)
    code = 1
    try:
        _become_child(write, {*keep, lifeline})
        _die_with(lifeline)
        traces.register()
        gc.freeze()  # What was there before the fork need not be looked at, nor copied, again.
        code = body()
    except MinervaError as error:
        print(error, file=sys.stderr)  # noqa: T201
    except BaseException:
        import traceback

        traceback.print_exc()
        code = FAILED
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def command(
    name: str, words: Sequence[str], environment: dict[str, str], folder: Path, lifeline: int
) -> Child:
    """Start a command in a folder; its input is closed and its output is ours.

    A child of ours stands between: it leads the group of processes that the command and whatever
    that starts are in, and with it the group dies.
    """
    return fork(name, lambda: _run(words, environment, folder), (), lifeline)


def _run(words: Sequence[str], environment: dict[str, str], folder: Path) -> int:
    """Run a command to its end, and end as it did."""
    import subprocess

    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        done = subprocess.run(  # noqa: S603
            words, env={**os.environ, **environment}, cwd=folder, check=False
        )
    except OSError as error:
        raise MinervaError(f"cannot run {words[0]}: {error.strerror}") from None
    if done.returncode < 0:
        os.kill(os.getpid(), -done.returncode)
    return abs(done.returncode)


def _become_child(output: int, keep: Collection[int]) -> None:
    os.setsid()
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(output, 1)
    os.dup2(output, 2)
    for descriptor in [int(entry.name) for entry in Path("/dev/fd").iterdir()]:
        if descriptor > 2 and descriptor not in keep:
            _close(descriptor)
    sys.stdout = os.fdopen(1, "w", buffering=1, encoding="utf-8", errors="replace", closefd=False)
    sys.stderr = os.fdopen(2, "w", buffering=1, encoding="utf-8", errors="replace", closefd=False)


def _close(descriptor: int) -> None:
    try:
        os.close(descriptor)
    except OSError:
        return  # The listing itself had it open.


def _die_with(lifeline: int) -> None:
    def watch() -> None:
        os.read(lifeline, 1)
        os.killpg(0, signal.SIGKILL)

    threading.Thread(target=watch, daemon=True).start()
