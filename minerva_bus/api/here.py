"""Worlds that run frame by frame: started, and in this process."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from minerva_bus.api.live import Live
from minerva_bus.api.on_bus import start_on_bus
from minerva_bus.api.requests import request_of
from minerva_bus.api.world import World
from minerva_bus.collect.data_tables import DataTable
from minerva_bus.errors import WorldStopped
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.console import Console
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
