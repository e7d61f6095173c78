"""Worlds in processes of their own: started from Python, stepped and queried over the bus.

The launcher forks its children, which a notebook or a program with threads must not do. So it is a
new Python process, and the world reaches it as a world file.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, TypeVar
from weakref import ref

from minerva_bus.api.world import Request
from minerva_bus.collect.data_tables import DataTable
from minerva_bus.errors import BusError, MinervaError, MisuseError, WorldStopped
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.registry import find, running, temporary_folder
from minerva_bus.runtime.operator_client import AskingOperator, Client
from minerva_bus.world.operator import WorldStatus

POLL_SECONDS: Final = 0.002
START_SECONDS: Final = 60.0
END_SECONDS: Final = 15.0
"""Time-out for the regular end of a world."""
END_POLL_SECONDS: Final = 0.02
EXIT_SECONDS: Final = 0.2
"""Interval at which an open connection checks whether it is still in use."""
BETWEEN_FRAMES: Final = "between frames"

_T = TypeVar("_T")


class Launched:
    """A launcher in its own process; leaving the context ends it with its world.

    Args:
        request: the world with the settings of the run.
        folder: for files that are passed between the processes.
        into: the file for collected data; "": none.
        paused: begin no frame until an operator resumes or steps the world.
        quiet: show errors only.

    Raises MisuseError if code of the world is not in a module.

    """

    def __init__(
        self, request: Request, folder: Path, *, into: str, paused: bool = False, quiet: bool = True
    ) -> None:
        world, self._end = request.world, folder / "end.json"
        # A world made in Python reaches the new process as a world file.
        path = world.path
        if path is None:
            path = folder / f"{world.name}.toml"
            path.write_text(world.toml(), encoding="utf-8")
        overrides, past = request.overrides, request.past
        config = {
            "world": str(path),
            # An empty entry means the current folder, which is given by its name instead.
            "folders": [entry for entry in sys.path if entry] + [str(Path.cwd())],
            "given": dict(world.given.options),
            "options": dict(overrides.options),
            "settings": list(overrides.settings),
            "views": list(overrides.views),
            "values": dict(overrides.values),
            "collect": {name: str(entry) for name, entry in request.file.collect.entries.items()},
            "into": into,
            "past": past and [type(past).__module__, type(past).__name__, asdict(past)],
            "paused": paused,
            "quiet": quiet,
            "end": str(self._end),
        }
        self._config = folder / "run.json"
        self._config.write_text(json.dumps(config), encoding="utf-8")
        self._process: subprocess.Popen[bytes] | None = None
        self._result: dict[str, Any] | None = None
        self._errors = folder / "errors.txt"
        self._quiet = quiet

    def __enter__(self) -> Self:
        # Its own session: Ctrl-C in a terminal reaches only this process, which ends the other. Its
        # standard input closes when this process dies, in any way.
        with self._errors.open("wb") as errors:
            self._process = subprocess.Popen(  # noqa: S603
                [sys.executable, "-m", "minerva_bus.api.child", str(self._config)],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=errors if self._quiet else None,
                start_new_session=True,
            )
        return self

    @property
    def pid(self) -> int:
        """Its process id."""
        assert self._process is not None
        return self._process.pid

    @property
    def ended(self) -> bool:
        """Whether it has ended."""
        return self._process is None or self._process.poll() is not None

    def check_running(self) -> None:
        """Raise WorldStopped if it has ended."""
        if self.ended:
            raise WorldStopped(self._why())

    def result(self) -> dict[str, Any]:
        """The result, after the end of the world. Raises MinervaError if it could not run."""
        # Not in one wait: another thread may take the signal of Ctrl-C, which would not end it.
        while not self.ended:
            time.sleep(END_POLL_SECONDS)
        if self._result is None:
            self._result = self._read_result()
        if "error" in self._result:
            raise MinervaError(str(self._result["error"]))
        return self._result

    def _read_result(self) -> dict[str, Any]:
        # A launcher that was killed leaves no result.
        if not self._end.exists():
            return {"error": self._why()}
        return json.loads(self._end.read_text(encoding="utf-8"))

    def _why(self) -> str:
        errors = self._errors.read_text(encoding="utf-8", errors="replace").strip()
        return errors.removeprefix("minerva: ") or "the world's processes ended without a message"

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        process = self._process
        if process is None:
            return
        assert process.stdin is not None
        try:
            if process.poll() is None:
                with contextlib.suppress(ProcessLookupError):
                    process.send_signal(signal.SIGTERM)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(END_SECONDS)
        finally:
            # Also after a second Ctrl-C. The world's processes end with their launcher.
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            process.stdin.close()
            # The folder is removed next.
            self._result = self._result or self._read_result()


class OnBus:
    """A world in other processes, queried over the bus; `launched` if they were started here.

    It takes over what `stack` closes.
    """

    def __init__(self, client: Client, stack: ExitStack, launched: Launched | None = None) -> None:
        self.name, self.vocabulary = client.world, client.vocabulary()
        self.operator = client.operator
        self._client = client
        self._launched = launched
        self._last: tuple[int, Scene] | None = None
        self._complete = False
        self.tables: dict[str, DataTable] = {}
        # Last: after any earlier error the caller closes what is open.
        self._opened = _Opened(self, stack.pop_all())

    def _current(self) -> tuple[int, Scene]:
        """The next frame and its string; after the end of the world the last ones."""
        answer = self._asked(lambda: self._client.ask("scene"))
        if answer is not None:
            frame, text = answer["frame"], answer["scene"]
            self._last = int(frame), self.vocabulary.read(str(text), "the world")
        elif self._launched is not None and not self._complete:
            result = self._launched.result()
            scene = self.vocabulary.read(result["scene"], "the last string")
            self._last, self._complete = (int(result["summary"]["frames"]), scene), True
        if self._last is None:
            raise BusError(f"the world {self.name!r} has ended")
        return self._last

    @property
    def frame(self) -> int:
        status = self._status()
        return self._current()[0] if status is None else status.frame

    @property
    def scene(self) -> Scene:
        return self._current()[1]

    @property
    def ended(self) -> bool:
        if self._launched is not None:
            return self._launched.ended
        try:
            self.operator.status()
        except BusError:
            return True
        return False

    def step(self, frames: int, stop: Callable[[], bool], by: str) -> None:
        operator = self.operator.named(by)
        # Paused first, so that the frame counted from is the one with which the step begins.
        status = None if self.ended else self._pause(operator)
        if status is not None and not stop():
            target = status.frame + frames
            operator.step(frames)
            while (status := self._status()) is not None and status.frame < target:
                if stop():
                    self._pause(operator)
                    break
                # Another coordinator followed.
                if status.paused and status.phase == BETWEEN_FRAMES:
                    operator.step(target - status.frame)
                time.sleep(POLL_SECONDS)
        if status is None and self._launched is not None and not self._opened.closed:
            failure = self._launched.result()["failure"]
            if failure:
                raise WorldStopped(failure)

    def _pause(self, operator: AskingOperator) -> WorldStatus | None:
        """Pause after the frame in progress; returns the state then, None if it has ended."""
        self._asked(operator.pause)
        status = self._status()
        while status is not None and status.phase != BETWEEN_FRAMES:
            time.sleep(POLL_SECONDS)
            status = self._status()
        return status

    def _status(self) -> WorldStatus | None:
        """The state of the world; None if it has ended."""
        return self._asked(self.operator.status)

    def _asked(self, question: Callable[[], _T]) -> _T | None:
        """The answer to a question; None if the world has ended. Raises BusError."""
        until = time.monotonic() + END_SECONDS
        while self._launched is None or not self._launched.ended:
            try:
                return question()
            except BusError:
                if self.ended:
                    return None
                # A launcher ends later than its coordinator, or starts another one.
                if self._launched is None or time.monotonic() >= until:
                    raise
            time.sleep(POLL_SECONDS)
        return None

    def close(self) -> None:
        self._opened.close()


class _Opened:
    """Connection and processes of a world on the bus, which end with their owner.

    They also end before Python exits, and when the owner is garbage.
    """

    def __init__(self, owner: OnBus, stack: ExitStack) -> None:
        self._stack = stack
        self._owner = ref(owner)
        self._lock = threading.Lock()
        self._closed = threading.Event()
        # Python waits for the threads of an open session before it exits, so this one closes it.
        # It is not a daemon: Python would abort if it ended such a thread within Zenoh's code.
        threading.Thread(target=self._watch, name="minerva-close").start()

    def _watch(self) -> None:
        # Not in a finalizer: the end takes seconds, and any thread may collect garbage.
        while not self._closed.wait(EXIT_SECONDS):
            if self._owner() is None or not threading.main_thread().is_alive():
                self.close()

    @property
    def closed(self) -> bool:
        """Whether `close` was called, which ends the world without a failure."""
        return self._closed.is_set()

    def close(self) -> None:
        # The lock makes each caller wait until all is closed.
        with self._lock:
            self._closed.set()
            self._stack.close()


def start_on_bus(request: Request) -> OnBus:
    """Start processes for a world, paused before its first frame. Raises MinervaError."""
    into = request.file.collect.into
    if request.file.collect.entries and not into:
        raise MisuseError("a world on the bus collects into a file: start(into='run.parquet')")
    with ExitStack() as stack:
        folder = stack.enter_context(temporary_folder("live"))
        launched = stack.enter_context(Launched(request, folder, into=into, paused=True))
        client = stack.enter_context(_awaited(launched, request.file.world.name))
        # Until all members have joined.
        while client.operator.status().phase != BETWEEN_FRAMES:
            launched.check_running()
            time.sleep(POLL_SECONDS)
        return OnBus(client, stack, launched)


def connect_on_bus(world: str, endpoint: str) -> OnBus:
    """A connection to a running world. Raises BusError if there is none."""
    if not endpoint:
        # The registry of this machine has the endpoints of its worlds.
        entry = find(world)
        world, endpoint = entry.world, entry.endpoint
    with ExitStack() as stack:
        client = stack.enter_context(Client(endpoint, world))
        return OnBus(client, stack)


def _awaited(launched: Launched, name: str) -> Client:
    """A connection to the world of a launcher, as soon as it listens."""
    until = time.monotonic() + START_SECONDS
    while time.monotonic() < until:
        launched.check_running()
        for each in running():
            if each.world == name and each.pid == launched.pid and each.endpoint:
                return Client(each.endpoint, name)
        time.sleep(POLL_SECONDS)
    raise BusError(f"{name} has not started within {START_SECONDS:.0f} s")
