"""Clients of a robot: views of a world become requests, answers become events."""

from __future__ import annotations

import queue
import threading
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, ClassVar, Final

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import FigureNode, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import PlaneGeometry
from minerva_bus.world.services import Device, Emit, Generator, WorldInfo
from minerva_services.bridges.ros2.graph import Announced
from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.network import NetworkLink, Ros2Session
from minerva_services.bridges.ros2.uses import NetworkUser, missing_server
from minerva_services.bridging.bridge import Counting, SourceError

_POLL_SECONDS: Final = 0.05
PLACE: Final = ("x", "y", "angle")


class RobotClient(Generator, Device, Counting, NetworkUser, when="freely, each frame"):
    """A free-running generator on a robot's network, whose requests come from views.

    All its work is done in its own thread: others hand it over with `do`. A lost network does not
    stop it, so that each request ends in time.
    """

    source_option: ClassVar[str] = "router"

    def __init__(self, network: Ros2Network, node: str, draws: str) -> None:
        Counting.__init__(self)
        self.network, self.draws = network, (draws,)
        self._work = queue.SimpleQueue[Callable[[], None]]()
        self._link = NetworkLink(network, node, self._declare, lambda: None, _POLL_SECONDS)
        self._session: Ros2Session | None = None

    def do(self, work: Callable[..., None], *arguments: Any) -> None:
        """Do something soon in this client's own thread; thread-safe."""
        self._work.put(lambda: work(*arguments))

    @property
    def state(self) -> str:
        """State of the link to the network."""
        return self._link.state

    def report(self) -> Mapping[str, bool | int | float | str]:
        """Counts, and the state of the link."""
        return {**self.counts, "source": self.state}

    def joined(self, world: WorldInfo) -> None:
        """Start connecting; raises what `check` raises."""
        super().joined(world)
        self._link.start()

    def run(self, emit: Emit, stop: threading.Event) -> None:
        """Do what is asked, until the world ends."""
        while not stop.is_set():
            # A link that is lost closes its session in its own thread.
            with suppress(queue.Empty, SourceError):
                work = self._work.get(timeout=_POLL_SECONDS)
                while True:
                    work()
                    work = self._work.get_nowait()
            with suppress(SourceError):
                for event in self.advance(self.session):
                    emit(event)

    @property
    def session(self) -> Ros2Session | None:
        """The session, while the network is there."""
        return self._session if self.state == "open" else None

    def close(self) -> None:
        """Leave the network."""
        self._link.close()

    def _declare(self, session: Ros2Session) -> None:
        self._session = session
        self.opened(session)

    @abstractmethod
    def servers(self) -> Sequence[tuple[str, str]]:
        """The names and types of the services that it calls. Raises MisuseError."""

    def problems(self, graph: Iterable[Announced]) -> Iterator[tuple[str, str]]:
        for called, kind in self.servers():
            problem = missing_server(graph, self.network, called, kind)
            if problem:
                yield called, problem

    def opened(self, session: Ros2Session) -> None:
        """Subscribe to what is needed in a new session, in a thread of the link."""

    @abstractmethod
    def advance(self, session: Ros2Session | None) -> Iterator[AnyEvent]:
        """Called often: send what waits, and yield events; None without a network."""


def check_primitive(service: str, world: WorldInfo, symbol: str) -> None:
    """Raise MisuseError if a world does not have a primitive."""
    known = world.vocabulary.primitives
    if symbol not in known:
        near = nearest(symbol, list(known))
        raise MisuseError(f"{service}: the world {world.world!r} has no primitive {symbol}{near}")


class _Figures(PlaneGeometry):
    """Collects the figures of symbols: their parameters, and their place."""

    def __init__(self, vocabulary: Vocabulary, symbols: Mapping[str, Any]) -> None:
        super().__init__(vocabulary)
        self.figures: list[tuple[str, dict[str, Any]]] = []
        self._symbols = symbols

    def other_figure(self, figure: FigureNode) -> None:
        """α: a request."""
        if figure.symbol in self._symbols:
            place = {name: getattr(self.pose, name) for name in PLACE}
            self.figures.append((figure.symbol, {**place, **figure.parameters}))


def figures_of(
    scene: Scene, vocabulary: Vocabulary, symbols: Mapping[str, Any]
) -> Sequence[tuple[str, Mapping[str, Any]]]:
    """The figures of symbols in a view, each with its place and parameters.

    The place is `x`, `y` (m) and `angle` (deg), unless its parameters have these names.
    """
    geometry = _Figures(vocabulary, symbols)
    interpret(scene, geometry)
    return geometry.figures
