"""Child processes: forks and commands, their end and their exit codes.

A fork takes milliseconds; a new Python interpreter would spend most of its start on imports.
Forking is safe because the launcher has a single thread and never opens a Zenoh session.
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

from minerva_bus.blame import report
from minerva_bus.errors import MinervaError, UserCodeError
from minerva_bus.launch import traces
from minerva_bus.uncaught import report_threads

FAILED: Final = os.EX_SOFTWARE
"""The exit code of a child that ended by an exception that is not a MinervaError."""

UNREADY: Final = os.EX_CONFIG
"""The exit code of a child whose service cannot run in its world, as the child has reported."""


@dataclass(frozen=True, slots=True)
class ChildProcess:
    """A child process: its id, and the read ends of the pipes with its output and its reports.

    Without reports, the descriptor of these is -1.
    """

    pid: int
    output: int
    reports: int = -1


def fork(body: Callable[[], int], keep: Collection[int], lifeline: int) -> ChildProcess:
    """Run `body` in a child that dies with this process; its result is the exit code.

    The child keeps the file descriptors in `keep` and closes all others. If it held the write end
    of a lifeline, that would stay open after the death of this process.
    """
    read, write = os.pipe()
    # Otherwise both processes would write the contents of the buffers.
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid:
        os.close(write)
        # The launcher waits for many pipes in one thread, so a read must never block it.
        os.set_blocking(read, False)
        return ChildProcess(pid, read)
    # This is the child. No exception may leave the block below: the stack above belongs to the
    # parent, whose handlers would kill its other children.
    code = 1
    try:
        _become_child(write, {*keep, lifeline})
        _die_with(lifeline)
        report_threads()
        # After standard error has become the pipe, since the handler keeps the file that it is
        # given.
        traces.register()
        gc.freeze()  # Collecting objects of the parent would copy their pages.
        code = body()
    except MinervaError as error:
        # Of the world's own code, the reader needs the line.
        print(report(error) if isinstance(error, UserCodeError) else error, file=sys.stderr)  # noqa: T201
    except BaseException:
        import traceback

        traceback.print_exc()
        code = FAILED
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)  # Exit handlers belong to the parent.


def command(
    words: Sequence[str], environment: dict[str, str], folder: Path, lifeline: int
) -> ChildProcess:
    """Start a command in a folder, with a closed input; its output is that of the child.

    The child between this process and the command leads their process group, so that everything
    that the command starts can be killed with it.
    """
    # A command does not use the lifeline; the child that waits for it watches the lifeline.
    return fork(lambda: _run(words, environment, folder), (), lifeline)


def _run(words: Sequence[str], environment: dict[str, str], folder: Path) -> int:
    """Run a command to its end; end in the same way."""
    import subprocess

    # A program inherits ignored signals, and a command may use SIGINT itself.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        done = subprocess.run(  # noqa: S603
            words, env={**os.environ, **environment}, cwd=folder, check=False
        )
    except OSError as error:
        raise MinervaError(f"cannot run {words[0]}: {error.strerror}") from None
    # It dies by the same signal, which the launcher then reports.
    if done.returncode < 0:
        os.kill(os.getpid(), -done.returncode)
    return abs(done.returncode)


def _become_child(output: int, keep: Collection[int]) -> None:
    # A session is a group, too: `kill` reaches all processes that the child starts, and the signals
    # of the terminal do not reach the child.
    os.setsid()
    # The handlers and the wake-up pipe belong to the launcher, which controls the end of a world.
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(output, 1)
    os.dup2(output, 2)
    # A copy of another child's pipe would hide its end, and a copy of the file that locks the
    # world's name (registry.py) would keep the lock after the launcher's death.
    for descriptor in [int(entry.name) for entry in Path("/dev/fd").iterdir()]:
        if descriptor > 2 and descriptor not in keep:
            _close(descriptor)
    # By lines, so that a log line appears when it is printed; `replace`, so that no character makes
    # `print` fail.
    sys.stdout = os.fdopen(1, "w", buffering=1, encoding="utf-8", errors="replace", closefd=False)
    sys.stderr = os.fdopen(2, "w", buffering=1, encoding="utf-8", errors="replace", closefd=False)


def _close(descriptor: int) -> None:
    try:
        os.close(descriptor)
    except OSError:
        return  # The descriptor of the folder's listing itself.


def _die_with(lifeline: int) -> None:
    def watch() -> None:
        os.read(lifeline, 1)  # Nothing is ever written: this returns when the launcher dies.
        os.killpg(0, signal.SIGKILL)

    # A thread, because user code may keep the main thread busy or blocked.
    threading.Thread(target=watch, daemon=True).start()


def next_ended(*, wait: bool = False) -> tuple[int, int] | None:
    """Process id and exit code of a child that has ended; with `wait`, of the next one to end.

    None if there is none.
    """
    try:
        pid, status = os.waitpid(-1, 0 if wait else os.WNOHANG)
    except ChildProcessError:
        return None
    return (pid, os.waitstatus_to_exitcode(status)) if pid else None


def how_ended(code: int) -> str:
    """An exit code in words; a negative code is the signal that killed the process."""
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return f"ended with exit code {code}"


def kill(pid: int) -> None:
    """Kill a child and its process group."""
    kill_group(pid)
    try:
        os.kill(pid, signal.SIGKILL)  # Right after its fork, a child has no group of its own yet.
    except ProcessLookupError:
        return


def kill_group(pid: int) -> None:
    """Kill the processes that a child has started."""
    try:
        os.killpg(pid, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):
        return  # The group is empty, or all of its processes are zombies.
