"""Live worlds for asyncio."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from minerva_bus.api.live import Live
from minerva_bus.api.pictures import PICTURE, WIDTH, Still, Visual
from minerva_bus.api.world import World, world_of
from minerva_bus.collect.data_tables import DataTable
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene

_T = TypeVar("_T")


class AsyncLive:
    """A live world for asyncio: all calls run in one thread of their own.

    Example:
        >>> async with start_async(world, seed=7) as live:
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
            raise MisuseError("the world has not started: async with start_async(world) as live")
        return self._live

    async def step(self, frames: int = 1) -> int:
        """Run this number of frames; see `Live.step`. If cancelled, it ends after its frame."""
        cancelled = threading.Event()
        try:
            return await self._call(partial(self._world.step, frames, cancelled.is_set))
        except asyncio.CancelledError:
            # The thread continues; the next call waits for it.
            cancelled.set()
            raise

    async def publish(self, event: AnyEvent) -> None:
        """Send an event; see `Live.publish`."""
        await self._call(partial(self._world.publish, event))

    async def view(self, event: Visual) -> Scene:
        """The view π of the string; see `Live.view`."""
        return await self._call(partial(self._world.view, event))

    async def picture(self, event: Visual = PICTURE, width: int = WIDTH) -> Still:
        """A picture of the string; see `Live.picture`."""
        return await self._call(partial(self._world.picture, event, width))

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


def start_async(world: World | str | Path, *, bus: bool = False, **settings: Any) -> AsyncLive:
    """As `World.start`, for `async with`: `step`, `publish` and the others are awaited.

    Args:
        world: a `World`, a world file, or the name of an installed world.
        bus: start processes; otherwise everything runs in this one.
        **settings: as for `World.start`.

    Raises MinervaError if it cannot start.

    Example:
        `async with start_async(world, seed=7) as live`

    """
    return AsyncLive(lambda: world_of(world, {}).start(bus=bus, **settings))
