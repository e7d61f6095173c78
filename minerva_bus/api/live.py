"""Worlds that run frame by frame: in this process, in other processes, or elsewhere."""

from __future__ import annotations

import asyncio
import tempfile
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Protocol, Self, TypeVar
from weakref import ref

from minerva_bus.api.processes import END_SECONDS, Launched
from minerva_bus.api.running import pick_table, request_of
from minerva_bus.api.world import World
from minerva_bus.collect.table import DataTable
from minerva_bus.errors import BusError, MisuseError, WorldStopped, nearest
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.symbols import EventType
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.console import Console
from minerva_bus.launch.in_process import InProcessRun
from minerva_bus.launch.registry import find, running
from minerva_bus.runtime.asking import AskingOperator
from minerva_bus.runtime.client import Client
from minerva_bus.world.agent import Agent
from minerva_bus.world.operator import WorldStatus
from minerva_bus.world.views import visualize

POLL_SECONDS: Final = 0.002
START_SECONDS: Final = 60.0
EXIT_SECONDS: Final = 0.2
"""Interval at which an open connection checks whether it is still in use."""
BETWEEN_FRAMES: Final = "between frames"

_T = TypeVar("_T")


class _Backend(Protocol):
    """Where a live world runs."""

    vocabulary: Vocabulary
    operator: AskingOperator

    @property
    def frame(self) -> int: ...
    @property
    def scene(self) -> Scene: ...
    @property
    def ended(self) -> bool: ...
    @property
    def tables(self) -> dict[str, DataTable]: ...
    def step(self, frames: int) -> None: ...
    def close(self) -> None: ...


class Live:
    """A running world, with one interface for worlds in this process, in others or elsewhere.

    `World.start` and `connect` return one; leaving its context, or `close`, ends it, and so does
    the last reference to a world in other processes. A world of `connect` continues to run.
    """

    def __init__(self, backend: _Backend, agents: Iterable[type[Agent]]) -> None:
        self._backend = backend
        self._agents = tuple(agents)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self.close()

    def step(self, frames: int = 1) -> int:
        """Run this number of frames and pause; fewer if the world ends before.

        Returns:
            The number of the next frame.

        Raises:
            WorldStopped: code of the world failed.
            KeyboardInterrupt: after Ctrl-C; the world in this process has ended then.

        """
        if frames < 1:
            raise MisuseError(f"step({frames}): expected at least 1 frame")
        self._backend.step(frames)
        return self.frame

    @property
    def frame(self) -> int:
        """The number of the next frame, which equals the number of completed frames."""
        return self._backend.frame

    @property
    def scene(self) -> Scene:
        """The string with which the next frame begins."""
        return self._backend.scene

    @property
    def digest(self) -> str:
        """The digest of the string, in hexadecimal."""
        return self.scene.digest.hex()

    @property
    def ended(self) -> bool:
        """Whether the world is over."""
        return self._backend.ended

    @property
    def status(self) -> WorldStatus:
        """The state of the world: members, events per second, pace."""
        return self._backend.operator.status()

    @property
    def operator(self) -> AskingOperator:
        """Further operations: `pause`, `resume`, `set_rate`, `restart`, `logs`."""
        return self._backend.operator

    def publish(self, event: AnyEvent) -> None:
        """Send an event as a person; it belongs to the next frame.

        Raises BusError if people may not send events of its type; see docs/worlds.md, `people`.
        """
        self._backend.operator.order(event)

    def view(self, event: Event | EventType | str) -> Scene:
        """The view π of the string for a visual event.

        Args:
            event: an event, or the type of one without data: `live.view("ePicture")`.

        Raises MisuseError if the type is not visual, or if the agents' classes are unknown here.

        """
        if not isinstance(event, Event):
            name = event if isinstance(event, str) else event.name
            events = self._backend.vocabulary.events
            if name not in events:
                raise MisuseError(f"the world has no event type {name}{nearest(name, [*events])}")
            event = events[name]()
        assert isinstance(event, Event)
        if not self._backend.vocabulary.events[event.type].visual:
            raise MisuseError(f"{event.type} is not visual: no agent has a view for it")
        # Views are code, and a remote world sends its vocabulary only.
        known = {cls.kind.name for cls in self._agents}
        for kind in self._backend.vocabulary.kinds.values():
            if event.type in kind.views and kind.name not in known:
                raise MisuseError(
                    f"the class of {kind.name} is not known here: connect(..., agents=[...])"
                )
        return visualize(self.scene, [event], self._agents, self.frame)

    def table(self, name: str = "") -> DataTable:
        """The data collected so far, as for `Run.table`; of a world in this process only."""
        return pick_table(self._backend.tables, name)

    def close(self) -> None:
        """End the world, or disconnect from one that runs elsewhere."""
        self._backend.close()


class _Here:
    """A world in this process."""

    def __init__(self, run: InProcessRun, vocabulary: Vocabulary) -> None:
        self.vocabulary = vocabulary
        self.operator = AskingOperator(run.ask)
        self._run = run

    @property
    def frame(self) -> int:
        return self._run.algorithm.frame

    @property
    def scene(self) -> Scene:
        return self._run.algorithm.scene

    @property
    def ended(self) -> bool:
        return self._run.ended

    @property
    def tables(self) -> dict[str, DataTable]:
        return {} if self._run.collected is None else self._run.collected.tables

    def step(self, frames: int) -> None:
        if self.ended:
            return
        try:
            self._run.advance(frames)
        except BaseException as error:
            # The interrupt may have come in the middle of a frame, so the world cannot continue.
            if isinstance(error, KeyboardInterrupt):
                self._run.end("interrupted")
            self._run.close()
            raise

    def close(self) -> None:
        if not self.ended:
            self._run.end("closed")
        self._run.close()


class _OnBus:
    """A world in other processes, queried over the bus; `launched` if they were started here.

    It takes over what `stack` closes.
    """

    def __init__(self, client: Client, stack: ExitStack, launched: Launched | None = None) -> None:
        self.vocabulary = client.vocabulary()
        self.operator = client.operator
        self._client = client
        self._launched = launched
        self._last: tuple[int, Scene] | None = None
        self.tables: dict[str, DataTable] = {}
        # Last: after any earlier error the caller closes what is open.
        self._opened = _Opened(self, stack.pop_all())

    def _ask_scene(self) -> tuple[int, Scene]:
        try:
            answer = self._client.ask("scene")
        except BusError:
            # The world may end between two calls; its last string remains available.
            if self._last is not None and self.ended:
                return self._last
            raise
        self._last = int(answer["frame"]), self.vocabulary.read(str(answer["scene"]), "the world")
        return self._last

    @property
    def frame(self) -> int:
        try:
            return self.operator.status().frame
        except BusError:
            return self._ask_scene()[0]

    @property
    def scene(self) -> Scene:
        return self._ask_scene()[1]

    @property
    def ended(self) -> bool:
        if self._launched is not None:
            return self._launched.ended
        try:
            self.operator.status()
        except BusError:
            return True
        return False

    def step(self, frames: int) -> None:
        if self.ended:
            return
        # Paused first, so that the frame counted from is the one with which the step begins.
        self._asked(self.operator.pause)
        status = self._status()
        while status is not None and status.phase != BETWEEN_FRAMES:
            time.sleep(POLL_SECONDS)
            status = self._status()
        if status is not None:
            target = status.frame + frames
            self.operator.step(frames)
            while (status := self._status()) is not None and status.frame < target:
                # Another coordinator followed.
                if status.paused and status.phase == BETWEEN_FRAMES:
                    self.operator.step(target - status.frame)
                time.sleep(POLL_SECONDS)
        if status is None and self._launched is not None:
            failure = self._launched.result()["failure"]
            if failure:
                raise WorldStopped(failure)

    def _status(self) -> WorldStatus | None:
        """The state of the world; None if it has ended."""
        return self._asked(self._ask_status)

    def _ask_status(self) -> WorldStatus:
        status = self.operator.status()
        # A launched world may end with the next frame; no process could then be queried for its
        # string.
        self._last = self._last if self._launched is None else self._ask_scene()
        return status

    def _asked(self, question: Callable[[], _T]) -> _T | None:
        """The answer to a question; None if the world has ended. Raises BusError."""
        until = time.monotonic() + END_SECONDS
        while True:
            try:
                return question()
            except BusError:
                if self.ended:
                    return None
                # A launcher ends later than its coordinator, or starts another one.
                if self._launched is None or time.monotonic() >= until:
                    raise
            time.sleep(POLL_SECONDS)

    def close(self) -> None:
        self._opened.close()


class _Opened:
    """Connection and processes of a world on the bus, which end with their owner.

    They also end before Python exits, and when the owner is garbage.
    """

    def __init__(self, owner: _OnBus, stack: ExitStack) -> None:
        self._stack = stack
        self._owner = ref(owner)
        self._lock = threading.Lock()
        self._closed = threading.Event()
        # Python waits for the threads of an open session before it exits, so this one closes it.
        # It is no daemon: Python would abort if it ended such a thread within Zenoh's code.
        threading.Thread(target=self._watch, name="minerva-close").start()

    def _watch(self) -> None:
        # Not in a finalizer: the end takes seconds, and any thread may collect garbage.
        while not self._closed.wait(EXIT_SECONDS):
            if self._owner() is None or not threading.main_thread().is_alive():
                self.close()

    def close(self) -> None:
        # The lock makes each caller wait until all is closed.
        with self._lock:
            self._closed.set()
            self._stack.close()


def start(world: World, *, bus: bool = False, **settings: Any) -> Live:
    """Start a world, paused; see `World.start`."""
    own = ("seed", "frames", "until", "collect", "into", "processes", "record", "rate")
    # By default the caller ends the world, not the settings of the world.
    given: dict[str, Any] = {"frames": 0, "until": ""}
    given |= {name: settings.pop(name) for name in own if name in settings}
    request = request_of(world, settings, **given)
    if not bus and given.get("processes") is None:
        here = InProcessRun(request.file, Console(quiet=True), time.monotonic())
        try:
            here.open()
        except BaseException:
            here.close()
            raise
        return Live(_Here(here, request.file.world.vocabulary), world.agents)
    if request.file.collect.entries and not request.file.collect.into:
        raise MisuseError("a world on the bus collects into a file: start(into='run.parquet')")
    with ExitStack() as stack:
        # Processes that were killed may still write into it while it is removed.
        folder = Path(
            stack.enter_context(
                tempfile.TemporaryDirectory(prefix="minerva-live-", ignore_cleanup_errors=True)
            )
        )
        into = request.file.collect.into
        launched = stack.enter_context(Launched(request, folder, into=into, paused=True))
        client = stack.enter_context(_awaited(launched, request.file.world.name))
        # Until all members have joined.
        while client.operator.status().phase != BETWEEN_FRAMES:
            launched.check_running()
            time.sleep(POLL_SECONDS)
        return Live(_OnBus(client, stack, launched), world.agents)


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


def connect(world: str = "", endpoint: str = "", *, agents: Iterable[type[Agent]] = ()) -> Live:
    """A world that runs elsewhere: in `minerva run`, in another program, on another machine.

    Args:
        world: its name; "": the only one on this machine, or at the endpoint.
        endpoint: where it listens, such as tcp/HOST:PORT; "": it is on this machine.
        agents: the classes of its agents, for `view`.

    `step` pauses the world after its frames; `operator.resume()` resumes it. Raises BusError if
    there is no such world.

    Example:
        >>> with connect("garden") as live:
        ...     live.publish(eRain())

    """
    if not endpoint:
        # The registry of this machine has the endpoints of its worlds.
        entry = find(world)
        world, endpoint = entry.world, entry.endpoint
    with ExitStack() as stack:
        client = stack.enter_context(Client(endpoint, world))
        return Live(_OnBus(client, stack), agents)


class AsyncLive:
    """A live world for asyncio: all calls run in one thread of their own.

    Example:
        >>> async with world.start_async(seed=7) as live:
        ...     await live.step(10)
        ...     print(await live.scene())

    """

    def __init__(self, open_live: Callable[[], Live]) -> None:
        self._open = open_live
        # One thread, so calls run in the order in which they were awaited.
        self._executor = ThreadPoolExecutor(1, "minerva-live")
        self._live: Live | None = None

    async def _call(self, function: Callable[[], _T]) -> _T:
        return await asyncio.get_running_loop().run_in_executor(self._executor, function)

    async def __aenter__(self) -> Self:
        self._live = await self._call(self._open)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        await self._call(self._world.close)
        self._executor.shutdown()

    @property
    def _world(self) -> Live:
        if self._live is None:
            raise MisuseError("the world has not started: async with world.start_async() as live")
        return self._live

    async def step(self, frames: int = 1) -> int:
        """Run this number of frames; see `Live.step`."""
        return await self._call(partial(self._world.step, frames))

    async def publish(self, event: AnyEvent) -> None:
        """Send an event; see `Live.publish`."""
        await self._call(partial(self._world.publish, event))

    async def view(self, event: Event | EventType | str) -> Scene:
        """The view π of the string; see `Live.view`."""
        return await self._call(partial(self._world.view, event))

    async def table(self, name: str = "") -> DataTable:
        """The data collected so far; see `Live.table`."""
        return await self._call(partial(self._world.table, name))

    async def scene(self) -> Scene:
        """The string with which the next frame begins."""
        return await self._call(lambda: self._world.scene)

    async def frame(self) -> int:
        """The number of the next frame."""
        return await self._call(lambda: self._world.frame)

    async def digest(self) -> str:
        """The digest of the string, in hexadecimal."""
        return await self._call(lambda: self._world.digest)

    async def ended(self) -> bool:
        """Whether the world is over."""
        return await self._call(lambda: self._world.ended)
