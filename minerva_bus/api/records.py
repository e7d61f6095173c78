"""Records as functions, which `minerva run` and `replay` call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from minerva_analysis.comparing import Difference
from minerva_analysis.replays import recomputed
from minerva_bus.api.running import Run, check_film, run_request
from minerva_bus.api.world import ContinuedRecord, World, request_of, world_of
from minerva_bus.arguments import path_of, text_list
from minerva_bus.launch.past import WorldSource, find_file
from minerva_bus.launch.world_files import Collecting
from minerva_bus.log.record import Record


def replay(
    record: str | Path,
    world: World | str | Path = "",
    progress: Callable[[int, int], None] | None = None,
) -> Difference:
    """Run the agents of a record again and compare each frame; `same` if all are equal.

    Args:
        record: the file, .mcap.
        world: the world with the agents' code; "": the world file that the record names.
        progress: called with the number of completed frames and the total.

    Raises RecordError, WorldFileError and MinervaError, also if the record is of another world.

    Example:
        `assert replay("run.mcap").same`

    """
    return recomputed(path_of("record", record), _source(world), progress or _no_progress)


def replay_views(
    record: str | Path,
    views: str | Sequence[str],
    world: World | str | Path = "",
    *,
    begin: int = 0,
    speed: float = 1.0,
    quiet: bool = False,
) -> Run:
    """Show a record in views, also in those that did not take part in its run.

    The strings are those of the record; only the code of agents that draws them runs. The views
    run in processes of their own, so classes of agents must be in modules.

    Args:
        record: the file, .mcap.
        views: as for `minerva replay --view`: "sprites", "svg:path=run.svg,every=10",
            "module:Class", or several of them.
        world: the world with the agents' code; "": the world file that the record names.
        begin: the first frame.
        speed: 1: real time; 2: twice as fast; 0: as fast as possible.
        quiet: show errors only; otherwise log lines, such as the address of a page, go to
            standard error.

    Returns:
        The replayed run, with its last string. With a window or a page, it ends when the view is
        closed.

    Raises:
        RecordError: the record cannot be read.
        MisuseError: there is no such frame, or an argument is wrong.
        WorldFileError: there is no such view, or the world's file is missing.
        MinervaError: the record is of another world.
        Interrupted: a KeyboardInterrupt with the run so far, after Ctrl-C.

    Example:
        `replay_views("run.mcap", "svg:path=run.svg", speed=0)`

    """
    shown = (views,) if isinstance(views, str) else text_list("views", views)
    past = ContinuedRecord(str(record), plays=True, begin=begin, speed=speed)
    request = request_of(world_of_record(record, world), {}, views=shown, past=past)
    # The record is replayed, not the collected data of its world file.
    request = replace(request, file=replace(request.file, collect=Collecting()))
    return run_request(request, bus=True, quiet=quiet)


def record(world: World | str | Path, path: str | Path, **settings: Any) -> Run:
    """Run a world and record it in a file, .mcap; the settings are those of `run`."""
    from minerva_bus.api.running import run

    return run(world, record=path, **settings)


def resume(
    record: str | Path,
    world: World | str | Path = "",
    *,
    frames: int | None = None,
    until: str | None = None,
    collect: Any = None,
    into: str | Path = "",
    bus: bool = False,
    processes: int | None = None,
    output: str | Path = "",
    rate: float = 0.0,
    quiet: bool = True,
    film: int = 0,
    **options: Any,
) -> Run:
    """Continue a recorded run after its last complete frame, as `minerva run --resume` does.

    Each string is that of a run that was not interrupted, in this process or in others.

    Args:
        record: the file, .mcap; new frames are appended.
        world: the world with the agents' code; "": the world file that the record names.
        frames: the last frame; default: as recorded.
        until: the event type that ends the world; default: as recorded; "": none.
        collect: expressions by name, of the new frames, as for `run`.
        into: a .parquet or .csv file for collected data, as for `run`.
        bus: start a process for each process of the world, as for `run`.
        processes: the number of processes for each kind of agents; implies `bus`.
        output: records the whole run in this file instead; `record` remains unchanged.
        rate: frames per second; 0: as fast as possible.
        quiet: show errors only; otherwise log lines go to standard error.
        film: keep the strings of every `film`-th new frame for `Run.film`; 0: none.
        options: the world's own options; default: as recorded.

    Raises:
        RecordError: the record cannot be read.
        MinervaError: the run is over, or the record is of another world.
        WorldStopped: code of the world failed.
        Interrupted: a KeyboardInterrupt with the run so far, after Ctrl-C.

    Example:
        `resume("run.mcap", frames=600)`

    """
    check_film(film)
    request = request_of(
        world_of_record(record, world),
        options,
        collect=collect,
        into=into,
        processes=processes,
        record=output,
        past=ContinuedRecord(str(record)),
        frames=frames,
        until=until,
        rate=rate,
    )
    return run_request(request, bus=bus or processes is not None, quiet=quiet, film=film)


def world_of_record(record: str | Path, world: World | str | Path) -> World:
    """The world with the code of a record: a given one, or that of the file that it names."""
    if world != "":
        return world_of(world, {})
    with Record(path_of("record", record)) as opened:
        return World.load(find_file("", opened.description, "world=..."))


def _source(world: World | str | Path) -> WorldSource:
    return world.read if isinstance(world, World) else str(world)


def _no_progress(done: int, total: int) -> None:
    """Report no progress."""
