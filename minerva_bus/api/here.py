"""A live world in this process."""

from __future__ import annotations

from collections.abc import Callable

from minerva_bus.collect.tables import DataTable
from minerva_bus.errors import WorldStopped
from minerva_bus.frame.description import WorldSpec
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.in_process import InProcessRun
from minerva_bus.runtime.operator_client import AskingOperator


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
    def ended(self) -> bool:
        return self._run.ended

    @property
    def tables(self) -> dict[str, DataTable]:
        return {} if self._run.collected is None else self._run.collected.tables

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
