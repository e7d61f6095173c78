"""Runs of worlds: in this process, or in processes of their own."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from minerva_bus.api.processes import Launched
from minerva_bus.api.world import World, own_options, world_of
from minerva_bus.collect.plans import plans_of, read_entries
from minerva_bus.collect.table import DataTable
from minerva_bus.collect.writers import check_ending, path_of, read_columns
from minerva_bus.errors import MisuseError, WorldStopped, nearest
from minerva_bus.frame import stimuli as s
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.collecting import Collecting
from minerva_bus.launch.console import Console
from minerva_bus.launch.in_process import InProcessRun
from minerva_bus.launch.temporary_folder import temporary_folder
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.runtime.runner import Notice
from minerva_bus.settings.overrides import Overrides
from minerva_bus.world.expressions import Expression

FRAMES = "frames"


@dataclass(frozen=True)
class Run:
    """A run that has ended.

    Attributes:
        scene: the last string.
        frames: the number of frames; `digest` is that of the string after them, in hexadecimal.
        events: the number of events, by type.
        ended: why it ended; `reached`: whether every agent has sent the event `until`.
        figures: metrics that its members reported, by name.
        seconds: from the end of the first frame to the end of the last one, wall time.
        tables: collected data, by the names of tables; see `table`.

    """

    scene: Scene
    frames: int
    digest: str
    events: Mapping[str, int]
    ended: str = ""
    reached: bool = False
    figures: Mapping[str, Any] = field(default_factory=dict[str, Any])
    seconds: float = 0.0
    tables: Mapping[str, DataTable] = field(default_factory=dict[str, DataTable], repr=False)
    into: str = ""

    def table(self, name: str = "") -> DataTable:
        """A table of collected data.

        Args:
            name: of the table (`frames`, an agent kind, an event type) or of an entry of `collect`;
                "": that with a row for each frame, or the only one.

        Raises MisuseError if nothing was collected, or if no table has this name.

        Example:
            `run.table().to_pandas()`, `run.table("APerson")["x"]`

        """
        return pick_table(self.tables, name, self.into)


def pick_table(tables: Mapping[str, DataTable], name: str, into: str = "") -> DataTable:
    """One of some tables; see `Run.table`."""
    if not tables:
        raise MisuseError(
            f"the collected data are in the file {into}"
            if into
            else 'nothing was collected: run(world, collect={"people": count(Person)})'
        )
    if not name and (FRAMES in tables or len(tables) == 1):
        return tables[FRAMES if FRAMES in tables else next(iter(tables))]
    if name in tables:
        return tables[name]
    # An entry of `collect` is a column of some table.
    for table in tables.values():
        if name in table.columns and name not in ("frame", "time", "id"):
            return table
    names = ", ".join(tables)
    raise MisuseError(
        f"there is no table {name!r}{nearest(name, [*tables])}; there are {names}"
        if name
        else f"which table: {names}"
    )


def run(
    world: World | str | Path,
    *,
    frames: int | None = None,
    seed: int | None = None,
    collect: Any = None,
    into: str | Path = "",
    bus: bool = False,
    processes: int | None = None,
    record: str | Path = "",
    until: str | None = None,
    rate: float = 0.0,
    quiet: bool = True,
    **options: Any,
) -> Run:
    """Run a world to its end.

    Args:
        world: a `World`, a world file, or the name of an installed world.
        frames: the number of frames; 0: no limit; default: the world's own.
        seed: of all random numbers; default: the world's own.
        collect: expressions by name, or a list of attributes: `{"sick": count(Person, "days > 0"),
            "x": Person.x}`; default: the world's own [collect].
        into: a .parquet or .csv file for collected data, written while the world runs in bounded
            memory; several tables go into several files, `FILE-TABLE.parquet`.
        bus: start a process for each process of the world, connected by Zenoh. Strings and digests
            are the same. Its code must be in modules that these processes can import.
        processes: the number of processes for each kind of agents; implies `bus`.
        record: record the run in this file, .mcap.
        until: the event type that ends the world, see docs/worlds.md.
        rate: frames per second; 0: as fast as possible.
        quiet: show errors only; otherwise log lines go to standard error.
        options: the world's own options.

    Returns:
        The run, with its last string and collected data.

    Raises:
        WorldStopped: code of the world failed.
        MisuseError, WorldFileError, SceneError: the world or the arguments are wrong.
        KeyboardInterrupt: after Ctrl-C, when the world has ended.

    Example:
        >>> done = run(world, frames=300, collect={"sick": count(Person, "days > 0")})
        >>> done.table().to_pandas().plot(x="time", y="sick")

    """
    request = request_of(
        world_of(world, {}),
        options,
        collect=collect,
        into=into,
        processes=processes,
        record=record,
        seed=seed,
        frames=frames,
        until=until,
        rate=rate,
    )
    # An endless run has to be asked for: a call that never returns is usually a mistake.
    if not request.file.world.frames and not request.file.world.until and frames is None:
        raise MisuseError(f"{request.world.name} has no end: run(world, frames=300); 0: no limit")
    console = Console(quiet=quiet, world=request.file.world.name)
    if bus or processes is not None:
        return _run_on_bus(request, console)
    return run_file(request.file, time.monotonic(), console)


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


class EventCounts:
    """A sink that counts the events of a run by type."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()

    def __call__(self, notice: Notice) -> None:
        if isinstance(notice, s.FrameDone):
            self.add(notice.events)

    def add(self, events: Iterable[AnyEvent]) -> None:
        """Count the events of a frame."""
        for event in events:
            self.counts[event.type] += len(event) if isinstance(event, Events) else 1

    def sorted(self) -> dict[str, int]:
        """The counts by type, sorted."""
        return dict(sorted(self.counts.items()))


def run_file(file: WorldFile, began: float, console: Console | None = None) -> Run:
    """Run a world in this process. Raises WorldStopped and KeyboardInterrupt.

    `began` is the start time of the program on the monotonic clock, seconds.
    """
    counts = EventCounts()
    here = InProcessRun(file, console or Console(quiet=True), began, counts)
    summary = here.run()
    # As an exception, so that a loop around `run` stops as well.
    if summary.ended == "interrupted":
        raise KeyboardInterrupt
    if here.algorithm.failed:
        raise WorldStopped(summary.ended)
    return Run(
        here.algorithm.scene,
        summary.frames,
        summary.digest,
        counts.sorted(),
        summary.ended,
        summary.reached,
        dict(sorted(summary.figures.items())),
        summary.wall_seconds,
        {} if here.collected is None else here.collected.tables,
        file.collect.into,
    )


def _run_on_bus(request: Request, console: Console) -> Run:
    with ExitStack() as stack:
        folder = stack.enter_context(temporary_folder("run"))
        collecting, entries = request.file.collect, request.file.collect.entries
        # The coordinator collects, in another process, and passes its tables on in this file.
        spool = str(folder / "collected.columns") if entries and not collecting.into else ""
        launched = stack.enter_context(
            Launched(request, folder, into=collecting.into or spool, quiet=console.quiet)
        )
        result = launched.result()
        tables = read_spool(Path(spool), entries, request.file) if spool else {}
    if result["summary"]["ended"] in ("interrupted", "terminated"):
        raise KeyboardInterrupt
    if result["failure"]:
        raise WorldStopped(result["failure"])
    summary = result["summary"]
    return Run(
        request.file.world.vocabulary.read(
            result["scene"], f"{request.world.name}: the last string"
        ),
        summary["frames"],
        summary["digest"],
        result["events"],
        summary["ended"],
        summary["reached"],
        result["figures"],
        summary["wall_seconds"],
        tables,
        collecting.into,
    )


def read_spool(
    path: Path, entries: Mapping[str, Expression], file: WorldFile
) -> dict[str, DataTable]:
    """The tables that a coordinator has written to a folder."""
    plans = plans_of(entries, file.world.vocabulary)
    several = len(plans) > 1
    return {
        plan.name: read_columns(path_of(path, plan.name, several), plan.name, plan.columns)
        for plan in plans
    }


def write_result(path: Path, result: Mapping[str, Any]) -> None:
    """Write a result for the process that waits for it."""
    # Renamed when it is complete, so that a reader never finds half a result.
    draft = path.with_suffix(".draft")
    draft.write_text(json.dumps(result), encoding="utf-8")
    draft.replace(path)
