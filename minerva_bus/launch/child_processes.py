"""Child processes: forks and commands, their pipes, stacks and exit codes; and signals.

A fork takes milliseconds; a new Python interpreter would spend most of its start on imports.
Forking is safe because the launcher has a single thread and never opens a Zenoh session.
"""

from __future__ import annotations

import faulthandler
import gc
import json
import os
import re
import select
import selectors
import signal
import sys
import threading
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path
from types import FrameType
from typing import Any, Final, TypeAlias, cast

from minerva_bus.errors import MinervaError, UserCodeError
from minerva_bus.uncaught import report_threads
from minerva_bus.user_code import WORLD_CODE, SourceLine, innermost, is_foreign, report

FAILED: Final = os.EX_SOFTWARE
"""The exit code of a child that ended by an exception that is not a MinervaError."""

UNREADY: Final = os.EX_CONFIG
"""The exit code of a child whose service cannot run in its world, as the child has reported."""

READ_BYTES: Final = 65536
CLOSED: Final = -1
"""Replaces a closed descriptor, because the system reuses descriptor numbers."""

STACK_SIGNAL: Final = signal.SIGUSR1
"""The signal at which a process writes the stacks of its threads."""

END_OF_STACKS: Final = "end of the stacks"
STOPPED: Final = "no stack: the process is stopped"
NOT_STARTED: Final = "no stack: the process does not run"
ENDS: Final = (END_OF_STACKS, STOPPED, NOT_STARTED)
"""The last line of an answer to a request for stacks."""

_THREAD: Final = re.compile(r"(?:Current thread|Thread) 0x[0-9a-f]+ .*\(most recent call first\):$")
_FRAME: Final = re.compile(r'  File "(?P<file>.*)", line (?P<line>\d+) in (?P<function>.*)$')
_CUT: Final = "  ..."
"""Follows the 100 most recent calls of a thread, and stands for the others."""

_REMARKS: Final = (_CUT, "  Garbage-collecting", "  <no Python frame>")

Handler: TypeAlias = Callable[[int, FrameType | None], None]

FRAME_SECONDS: Final = 1.0
"""Longest time, in seconds, that an interrupt waits for the end of a frame."""


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
        write_stacks_on_signal()
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
    if pid <= 1:  # Group 0 is our own, and `killpg(1)` signals every process of the machine.
        raise ValueError(f"{pid} is not the process id of a child")
    try:
        os.killpg(pid, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):
        return  # The group is empty, or all of its processes are zombies.


class Pipes:
    """Read ends of non-blocking pipes, and the handler of each."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()

    def listen(self, descriptor: int, on_ready: Callable[[], object]) -> None:
        """Call `on_ready` when the pipe has data to `read` or has reached its end."""
        self._selector.register(descriptor, selectors.EVENT_READ, on_ready)

    def wait(self, seconds: float | None) -> None:
        """Wait for pipes that are ready, and call their handlers; None: no time limit."""
        for key, _ in self._selector.select(seconds):
            # The handler of an earlier pipe may have closed this one.
            if self._selector.get_map().get(key.fd) is key:
                key.data()

    def wait_for(self, descriptor: int, seconds: float) -> bool:
        """Wait for one pipe without calling a handler; returns whether it is ready."""
        poll = select.poll()
        poll.register(descriptor, select.POLLIN)
        return bool(poll.poll(1000 * seconds))

    def read(self, descriptor: int) -> bytes | None:
        """The available data, possibly b""; None at the end of the pipe, which is then closed."""
        try:
            data = os.read(descriptor, READ_BYTES)
        except BlockingIOError:
            return b""
        if data:
            return data
        self.forget(descriptor)
        return None

    def forget(self, descriptor: int) -> None:
        """Close a pipe unless it is CLOSED."""
        if descriptor != CLOSED:
            self._selector.unregister(descriptor)
            os.close(descriptor)

    def close(self) -> None:
        """Close all pipes."""
        for key in list(self._selector.get_map().values()):
            self.forget(key.fd)
        self._selector.close()


@dataclass(slots=True)
class LineBuffer:
    """Splits data into lines; a line of more than `limit` bytes is cut."""

    limit: int = 1_000_000
    _rest: bytes = b""

    def feed(self, data: bytes) -> Iterator[str]:
        """The lines that `data` completes."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > self.limit:  # Otherwise a child could fill the launcher's memory.
            lines.append(self._rest)
            self._rest = b""
        for line in lines:
            yield line.decode("utf-8", "replace")

    def end(self) -> str:
        """The unterminated last line, or an empty string."""
        rest, self._rest = self._rest, b""
        return rest.decode("utf-8", "replace")


class LineReader:
    """Passes the lines of a pipe to `on_line`."""

    def __init__(self, pipes: Pipes, descriptor: int, on_line: Callable[[str], object]) -> None:
        self.descriptor = descriptor
        self._pipes = pipes
        self._on_line = on_line
        self._buffer = LineBuffer()
        pipes.listen(descriptor, self.read)

    @property
    def open(self) -> bool:
        """Whether the pipe has not reached its end."""
        return self.descriptor != CLOSED

    def read(self) -> bool:
        """Read once; returns whether there was data."""
        # Once: a child that prints without end must not block the reading of other pipes. `wait`
        # reports the pipe again if it has more.
        data = self._pipes.read(self.descriptor)
        if data is None:
            self.descriptor = CLOSED
        for line in self._buffer.feed(data or b""):
            self._on_line(line)
        return bool(data)

    def finish(self) -> None:
        """Read the remaining data, with an unterminated last line, and close the pipe."""
        while self.open and self.read():
            pass
        # A grandchild may hold the write end open, so the pipe may never reach its end.
        self._pipes.forget(self.descriptor)
        self.descriptor = CLOSED
        rest = self._buffer.end()
        if rest:
            self._on_line(rest)


def reap(pid: int, readers: Iterable[LineReader]) -> int:
    """Wait until a worker has ended; returns its status."""
    status = os.waitpid(pid, 0)[1]
    for reader in readers:
        reader.finish()
    return status


@dataclass(slots=True)
class ReportPipe:
    """Writes reports to a pipe, JSON objects in lines; `broken` once its reader is gone."""

    descriptor: int
    broken: bool = field(default=False)

    def send(self, kind: str, **fields: Any) -> None:
        """Send a report; without a reader, do nothing."""
        data = json.dumps({"kind": kind, **fields}).encode() + b"\n"
        try:
            # The system may accept only a part of a long report.
            while data and not self.broken:
                data = data[os.write(self.descriptor, data) :]
        except OSError:
            self.broken = True


def parse_report(line: str) -> dict[str, Any] | None:
    """The report in a line, or None if the line is not a report."""
    try:
        report = json.loads(line)
    except ValueError:
        return None
    return cast("dict[str, Any]", report) if isinstance(report, dict) else None


def on_reports(receive: Callable[[dict[str, Any]], None]) -> Callable[[str], None]:
    """What a `LineReader` calls for each line: it passes reports on, and drops other lines."""

    def on_line(line: str) -> None:
        report = parse_report(line)
        if report is not None:
            receive(report)

    return on_line


def write_stacks_on_signal() -> None:
    """Write the stacks of this process to standard error at each STACK_SIGNAL.

    Python's faulthandler writes at once, also during a blocking call; a stopped process writes
    nothing. The stacks appear among the lines that the process prints.
    """
    faulthandler.register(STACK_SIGNAL, file=sys.stderr, all_threads=True, chain=False)


def is_stack(line: str) -> bool:
    """Whether a printed line is part of a stack."""
    return bool(_THREAD.match(line) or _FRAME.match(line)) or line in _REMARKS


def blocked_at(stacks: Sequence[str], began_in: str) -> SourceLine | None:
    """The line of user code that the main thread was executing at the signal, if it is known.

    `began_in` is the source file that forked the process: older frames belong to the launcher.
    """
    place = innermost(own_frames(stacks, began_in))
    # A package is user code if the framework calls it, which a truncated stack does not show.
    if place is not None and is_foreign(place.file) and _CUT in _main_thread(stacks):
        return None
    return place


def own_frames(stacks: Iterable[str], began_in: str) -> list[SourceLine]:
    """The frames of the main thread, most recent call first, after the fork."""
    frames = filter(None, map(_FRAME.match, _main_thread(stacks)))
    places = (SourceLine(each["file"], int(each["line"]), each["function"]) for each in frames)
    return list(takewhile(lambda place: place.file != began_in, places))


def _main_thread(stacks: Iterable[str]) -> list[str]:
    """The lines of the thread that was written last.

    The newest thread is first. The current one, which is marked, is that which got the signal: any
    thread of the process may.
    """
    lines: list[str] = []
    for line in stacks:
        if _THREAD.match(line):
            lines = []
        else:
            lines.append(line)
    return lines


_END_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def end_signals() -> tuple[signal.Signals, ...]:
    """The signals that end this process: Ctrl-C, SIGTERM and the terminal's hang-up.

    A hang-up that is ignored, as under `nohup`, stays ignored.
    """
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return _END_SIGNALS[:-1] if ignored else _END_SIGNALS


@contextmanager
def handled(handlers: Mapping[signal.Signals, Handler]) -> Generator[None]:
    """Handle these signals, and restore the former handlers at the end of the block."""
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def interrupts_deferred() -> Generator[Callable[[], bool]]:
    """Defer KeyboardInterrupt; yields a function that says whether one is pending.

    The block ends at the next frame boundary if one is, and then raises KeyboardInterrupt: within a
    frame it would separate a record or a table from the string. It is raised at once by a second
    signal, and after FRAME_SECONDS, because user code may never return. In a thread other than the
    main one, where signals have no effect, nothing is deferred.

    Raises UserCodeError if code of the world has raised a KeyboardInterrupt, without a signal.
    """
    pending, timers = list[int](), list[threading.Timer]()
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return

    def defer(number: int, frame: FrameType | None) -> None:
        if pending:
            raise KeyboardInterrupt
        pending.append(number)
        # A signal to the thread, unlike `interrupt_main`, also ends a blocking call like sleep.
        again = signal.pthread_kill, (threading.main_thread().ident, signal.SIGINT)
        timers.append(threading.Timer(FRAME_SECONDS, *again))
        timers[0].daemon = True
        timers[0].start()

    # A signal that is ignored has another handler.
    raising = [n for n in _END_SIGNALS if signal.getsignal(n) is signal.default_int_handler]
    try:
        with handled(dict.fromkeys(raising, defer)):
            try:
                yield lambda: bool(pending)
            except KeyboardInterrupt as error:
                # A handler that this function has not replaced may raise it for a signal.
                if pending or signal.SIGINT not in raising:
                    raise
                raise UserCodeError(WORLD_CODE) from error
    finally:
        for timer in timers:
            timer.cancel()
    if pending:
        raise KeyboardInterrupt


@contextmanager
def caught(pipes: Pipes, interrupted: Callable[[signal.Signals], None]) -> Generator[None]:
    """Wake a wait for `pipes` at each signal; call `interrupted` for `end_signals`."""

    def interrupt(number: int, _: FrameType | None) -> None:
        interrupted(signal.Signals(number))

    read, write = os.pipe()
    # Python requires a non-blocking descriptor for wake-ups, as a full pipe must not block.
    os.set_blocking(read, False)
    os.set_blocking(write, False)
    # Without the pipe, a signal just before the wait begins would not end it.
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    pipes.listen(read, lambda: pipes.read(read))
    # Python writes to the pipe only for signals that have a handler, hence one for SIGCHLD.
    wanted: dict[signal.Signals, Handler] = {signal.SIGCHLD: lambda number, frame: None}
    try:
        with handled(wanted | dict.fromkeys(end_signals(), interrupt)):
            yield
    finally:
        signal.set_wakeup_fd(-1)
        pipes.forget(read)
        os.close(write)
