"""Records as functions: `record` and `resume`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from minerva_bus.api.running import Run, check_film, run, run_request
from minerva_bus.api.world import ContinuedRecord, World, request_of, world_of
from minerva_bus.arguments import path_of
from minerva_bus.launch.past import find_file
from minerva_bus.log.record import Record


def record(world: World | str | Path, path: str | Path, **settings: Any) -> Run:
    """Run a world and record it in a file, .mcap; the settings are those of `run`."""
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
