"""The world and the settings of one run from Python, checked before it begins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from minerva_bus.api.world import World, own_options
from minerva_bus.collect.plans import plans_of, read_entries
from minerva_bus.collect.writers import check_ending
from minerva_bus.errors import MisuseError
from minerva_bus.launch.collecting import Collecting
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.settings.overrides import Overrides


@dataclass(frozen=True, slots=True)
class Request:
    """A world with the settings of one run."""

    world: World
    overrides: Overrides
    file: WorldFile


def request_of(
    world: World,
    options: Mapping[str, Any],
    *,
    collect: Any = None,
    into: str | Path = "",
    processes: int | None = None,
    record: str | Path = "",
    **values: Any,
) -> Request:
    """The settings of one run, checked. Raises MinervaError."""
    # Settings name a table of the world file, which may stand for several processes.
    hosts = [process.table for process in world.read().processes if process.agents]
    if processes is not None and processes < 1:
        raise MisuseError(f"processes is {processes}; expected at least 1")
    settings = () if processes is None else tuple(f"{name}.processes={processes}" for name in hosts)
    overrides = Overrides(
        own_options(world, options),
        tuple(dict.fromkeys(settings)),
        record=str(record) if record else None,
        collect=str(into) if into and collect is None else None,
        **values,
    )
    file = world.read(overrides)
    if collect is not None:
        entries = read_entries(collect)
        if into:
            check_ending(Path(into))
        file = replace(file, collect=Collecting(entries, str(into)))
        # The plans are made for their checks: errors appear here, before any process starts.
        plans_of(entries, file.world.vocabulary)
    return Request(world, overrides, file)
