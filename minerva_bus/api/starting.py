"""Start a world that runs frame by frame."""

from __future__ import annotations

import time
from typing import Any

from minerva_bus.api.here import Here
from minerva_bus.api.live import Live
from minerva_bus.api.on_bus import start_on_bus
from minerva_bus.api.requests import request_of
from minerva_bus.api.world import World
from minerva_bus.launch.console import Console
from minerva_bus.launch.in_process import InProcessRun


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
