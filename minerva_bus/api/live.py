"""Worlds that run frame by frame: in this process, in other processes, or elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from types import TracebackType
from typing import Any, Protocol, Self

from minerva_bus.api.on_bus import connect_on_bus, start_on_bus
from minerva_bus.api.running import pick_table, request_of
from minerva_bus.api.world import World
from minerva_bus.collect.table import DataTable
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.symbols import EventType
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.console import Console
from minerva_bus.launch.in_process import InProcessRun, never
from minerva_bus.runtime.asking import AskingOperator
from minerva_bus.world.agent import Agent
from minerva_bus.world.operator import WorldStatus
from minerva_bus.world.views import visualize


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
    def step(self, frames: int, stop: Callable[[], bool]) -> None: ...
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

    def step(self, frames: int = 1, stop: Callable[[], bool] = never) -> int:
        """Run this number of frames and pause; fewer if the world ends before.

        Args:
            frames: the number of frames.
            stop: called between frames, from the thread that steps; if true, the step ends early.

        Returns:
            The number of the next frame.

        Raises:
            WorldStopped: code of the world failed.
            KeyboardInterrupt: after Ctrl-C; the world in this process has ended then.

        """
        if frames < 1:
            raise MisuseError(f"step({frames}): expected at least 1 frame")
        self._backend.step(frames, stop)
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

    def step(self, frames: int, stop: Callable[[], bool]) -> None:
        if self.ended:
            return
        try:
            self._run.advance(frames, stop)
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
    return Live(start_on_bus(request), world.agents)


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
    return Live(connect_on_bus(world, endpoint), agents)
