"""Worlds that run frame by frame: in this process, in other processes, or elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from threading import RLock
from types import TracebackType
from typing import Any, Protocol, Self

from minerva_bus.api.on_bus import connect_on_bus, start_on_bus
from minerva_bus.api.pictures import PICTURE, WIDTH, Displayed, Still, Visual, WorldViews
from minerva_bus.api.running import SHOWN_DIGITS, pick_table
from minerva_bus.api.world import World, request_of
from minerva_bus.collect.collector import agents_now
from minerva_bus.collect.data_tables import DataTable
from minerva_bus.errors import MinervaError, MisuseError, WorldStopped, whole
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.events import AnyEvent, Event, single
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.console import Console
from minerva_bus.launch.in_process import InProcessRun, never
from minerva_bus.runtime.operator_client import AskingOperator
from minerva_bus.world.agent import Agent
from minerva_bus.world.operator import WorldStatus


class _Backend(Protocol):
    """Where a live world runs."""

    name: str
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
    def step(self, frames: int, stop: Callable[[], bool], by: str) -> None: ...
    def close(self) -> None: ...


class Follower(Protocol):
    """What shows a live world while it runs."""

    def between_frames(self) -> None:
        """Called often during a step, from the thread that steps."""
        ...

    def refresh(self) -> None:
        """Called after a step, and at the end of the world."""
        ...


class Live(Displayed):
    """A running world, with one interface for worlds in this process, in others or elsewhere.

    `World.start` and `connect` return one; leaving its context, or `close`, ends it, and so does
    the last reference to a world in other processes. A world of `connect` continues to run.

    `world` is what runs, with its code; None for a world of `connect`. `follower` shows it while
    it runs.
    """

    def __init__(
        self, backend: _Backend, agents: Iterable[type[Agent]], world: World | None = None
    ) -> None:
        self._backend = backend
        self.world = world
        self.views = WorldViews(backend.name, backend.vocabulary, agents)
        self.follower: Follower | None = None
        # A notebook may handle a click in another thread than that of its cells.
        self._stepping = RLock()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self.close()

    def step(self, frames: int = 1, stop: Callable[[], bool] = never, by: str = "") -> int:
        """Run this number of frames and pause; fewer if the world ends before.

        Args:
            frames: the number of frames.
            stop: called between frames, from the thread that steps; if true, the step ends early.
            by: name of the person who steps, for the log and the record of a world on a bus.

        Returns:
            The number of the next frame.

        Raises:
            WorldStopped: code of the world failed, in this step or before it.
            KeyboardInterrupt: after Ctrl-C; the world in this process has ended then.

        """
        if not whole(frames, 1):
            raise MisuseError(f"step({frames!r}): expected a whole number of frames, at least 1")
        with self._stepping:
            follower = self.follower
            if follower is None:
                self._backend.step(frames, stop, by)
                return self.frame

            def followed() -> bool:
                follower.between_frames()
                return stop()

            try:
                self._backend.step(frames, followed, by)
            finally:
                follower.refresh()
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
    def vocabulary(self) -> Vocabulary:
        """Its symbols and event types."""
        return self._backend.vocabulary

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

    def publish(self, event: AnyEvent, by: str = "") -> None:
        """Send an event, or a batch, as a person; it belongs to the next frame.

        `by` is the name of the person, if any.

        Raises BusError if people may not send events of its type; see docs/worlds.md, `people`.
        """
        self._backend.operator.named(by).order(event)

    @property
    def sent(self) -> tuple[Event, ...]:
        """The events of agents and norms in the last frame, in order; they belong to the next.

        Raises MisuseError for a world in other processes.
        """
        if not isinstance(self._backend, Here):
            raise MisuseError("what agents send is known of a world in this process only")
        return self._backend.sent

    def view(self, event: Visual) -> Scene:
        """The view π of the string for a visual event.

        Args:
            event: an event, or the type of one without data: `live.view("ePicture")`.

        Raises MisuseError if the type is not visual, or if the agents' classes are unknown here.

        """
        return self.views.view(self.scene, event, self.frame)

    def picture(self, event: Visual = PICTURE, width: int = WIDTH) -> Still:
        """A picture of the string, `width` pixels wide, drawn by the view `svg`.

        Raises MisuseError as `view` does, and if no primitive has a form.
        """
        return self.views.picture(self.scene, self.frame, event, width)

    def agents(self, kind: type[Agent] | str, where: str = "") -> DataTable:
        """A table with a row for each agent of a kind, as the next frame begins.

        Its columns are `frame`, `id`, and the attributes that are numbers, bools or texts.

        Args:
            kind: the class, or the symbol, such as "ATree".
            where: a condition, in the language of docs/norms.md; "": all.

        Raises VocabularyError for an unknown kind or attribute.

        Example:
            `live.agents(Tree, "age > 3")["size"].mean()`

        """
        return agents_now(self.scene, self.vocabulary, kind, where, self.frame)

    def table(self, name: str = "") -> DataTable:
        """The data collected so far, as for `Run.table`; of a world in this process only."""
        return pick_table(self._backend.tables, name)

    def close(self) -> None:
        """End the world, or disconnect from one that runs elsewhere."""
        self._backend.close()
        if self.follower is not None:
            self.follower.refresh()

    def __repr__(self) -> str:
        return f"<Live {'; '.join(self.facts)}>"

    @property
    def facts(self) -> list[str]:
        """What notebooks and terminals show of it."""
        try:
            state = [f"frame {self.frame:,}", f"digest {self.digest[:SHOWN_DIGITS]}…"]
        except MinervaError:
            state = []
        return [self.views.name, *state, *(["the world has ended"] if self.ended else [])]


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


class Here:
    """A world that `run` runs frame by frame."""

    def __init__(self, run: InProcessRun, world: WorldSpec) -> None:
        self.name, self.vocabulary = world.name, world.vocabulary
        self.operator = AskingOperator(run.ask)
        self._run = run
        self._failure: WorldStopped | None = None

    @property
    def frame(self) -> int:
        return self._run.algorithm.frame

    @property
    def scene(self) -> Scene:
        return self._run.algorithm.scene

    @property
    def sent(self) -> tuple[Event, ...]:
        return tuple(single(self._run.algorithm.closing_events))

    @property
    def ended(self) -> bool:
        return self._run.ended

    @property
    def tables(self) -> dict[str, DataTable]:
        return self._run.tables

    def step(self, frames: int, stop: Callable[[], bool], by: str) -> None:
        if self._failure is not None:
            raise self._failure
        if self.ended:
            return
        try:
            self._run.advance(frames, stop)
        except BaseException as error:
            # The interrupt may have come in the middle of a frame, so the world cannot continue.
            if isinstance(error, KeyboardInterrupt):
                self._run.end("interrupted")
            elif isinstance(error, WorldStopped):
                self._failure = error
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
    if not request.needs_bus(bus, given.get("processes")):
        here = InProcessRun(request.file, Console(quiet=True), time.monotonic())
        try:
            here.open()
        except BaseException:
            here.close()
            raise
        return Live(Here(here, request.file.world), world.agents, world)
    return Live(start_on_bus(request), world.agents, world)
