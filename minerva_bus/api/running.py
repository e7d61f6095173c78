"""Runs of worlds: in this process, or in processes of their own."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from minerva_bus.api.processes import Launched
from minerva_bus.api.requests import Processes, Request, request_of
from minerva_bus.api.run_result import Interrupted, Run
from minerva_bus.api.world import World, world_of
from minerva_bus.api.world_views import views_of
from minerva_bus.arguments import whole_number
from minerva_bus.collect.data_tables import DataTable, read_columns, table_path
from minerva_bus.collect.plans import plans_of
from minerva_bus.errors import MinervaError, MisuseError, WorldStopped
from minerva_bus.frame import stimuli as s
from minerva_bus.grammar.events import AnyEvent, Events
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.console import Console
from minerva_bus.launch.in_process import InProcessRun
from minerva_bus.launch.registry import temporary_folder
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.runtime.runner import Notice
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.world.expressions import Expression


def run(
    world: World | str | Path,
    *,
    frames: int | None = None,
    seed: int | None = None,
    collect: Any = None,
    into: str | Path = "",
    bus: bool = False,
    processes: Processes = None,
    record: str | Path = "",
    until: str | None = None,
    rate: float = 0.0,
    quiet: bool = True,
    film: int = 0,
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
        processes: the number of processes for each kind of agents; implies `bus`. "auto": by the
            number of agents and of cores; a world too small for several runs in this process.
        record: record the run in this file, .mcap.
        until: the event type that ends the world, see docs/worlds.md.
        rate: frames per second; 0: as fast as possible.
        quiet: show errors only; otherwise log lines go to standard error.
        film: keep the strings of every `film`-th frame for `Run.film`; 0: none.
        options: the world's own options.

    Returns:
        The run, with its last string and collected data.

    Raises:
        WorldStopped: code of the world failed.
        MisuseError, WorldFileError, SceneError: the world or the arguments are wrong.
        Interrupted: a KeyboardInterrupt with the run so far, after Ctrl-C.

    Example:
        >>> done = run(world, frames=300, collect={"sick": count(Person, "days > 0")})
        >>> done.table().to_pandas().plot(x="time", y="sick")

    """
    check_film(film)
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
    return run_request(request, bus=request.needs_bus(bus, processes), quiet=quiet, film=film)


def run_request(request: Request, *, bus: bool, quiet: bool, film: int = 0) -> Run:
    """Run a checked world, in processes or in this one; see `run`."""
    console = Console(quiet=quiet, world=request.file.world.name)
    if bus:
        done = _run_on_bus(request, console, film)
    else:
        done = run_file(request.file, time.monotonic(), console, film)
    return replace(
        done, record=request.file.record.path, world=request.world, settings=request.overrides
    )


def check_film(film: int) -> None:
    """Raise MisuseError for an interval of a film that is not a number of frames."""
    whole_number("film", film)


class EventCounts:
    """A sink that counts the events of a run by type."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()

    def __call__(self, notice: Notice) -> None:
        if isinstance(notice, s.FrameDone | s.Stopping):
            self.add(notice.events)

    def add(self, events: Iterable[AnyEvent]) -> None:
        """Count the events of a frame."""
        for event in events:
            self.counts[event.type] += len(event) if isinstance(event, Events) else 1

    def sorted(self) -> dict[str, int]:
        """The counts by type, sorted."""
        return dict(sorted(self.counts.items()))


class FilmStrings:
    """The strings of every `every`-th frame and of the last one; 0: none."""

    def __init__(self, every: int) -> None:
        self._every = every
        self._kept: list[tuple[int, Scene]] = []
        self._last: tuple[tuple[int, Scene], ...] = ()

    def add(self, frame: int, scene: Scene) -> None:
        """Add the string with which a frame begins; in order."""
        if not self._every:
            return
        if frame % self._every:
            self._last = ((frame, scene),)
        else:
            self._kept.append((frame, scene))
            self._last = ()

    @property
    def kept(self) -> tuple[tuple[int, Scene], ...]:
        """Numbers of frames, and their strings."""
        return (*self._kept, *self._last)


def run_file(file: WorldFile, began: float, console: Console | None = None, film: int = 0) -> Run:
    """Run a world in this process. Raises WorldStopped and Interrupted.

    `began` is the start time of the program on the monotonic clock, seconds; `film` is as for
    `run`.
    """
    counts, strings = EventCounts(), FilmStrings(film)

    def keep(notice: Notice) -> None:
        if isinstance(notice, s.FrameDone):
            strings.add(here.algorithm.frame, here.algorithm.scene)

    here = InProcessRun(file, console or Console(quiet=True), began, counts, keep)
    strings.add(here.algorithm.frame, here.algorithm.scene)
    summary = here.run()
    if here.failed:
        raise WorldStopped(summary.ended)
    done = Run(
        here.algorithm.scene,
        summary.frames,
        summary.digest,
        views_of(file),
        counts.sorted(),
        summary.ended,
        summary.reached,
        dict(sorted(summary.figures.items())),
        summary.wall_seconds,
        {} if here.collected is None else here.collected.tables,
        file.collect.into,
        strings.kept,
    )
    # As an exception, so that a loop around `run` stops as well.
    if summary.ended == "interrupted":
        raise Interrupted(done)
    return done


def _run_on_bus(request: Request, console: Console, film: int) -> Run:
    file = request.file
    with ExitStack() as stack:
        folder = stack.enter_context(temporary_folder("run"))
        record = Path(file.record.path or folder / "film.mcap")
        if film and not file.record.path:
            overrides = Overrides(record=str(record)).over(request.overrides)
            request = replace(request, overrides=overrides)
        collecting, entries = file.collect, file.collect.entries
        # The coordinator collects, in another process, and passes its tables on in this file.
        spool = str(folder / "collected.columns") if entries and not collecting.into else ""
        launched = Launched(request, folder, into=collecting.into or spool, quiet=console.quiet)
        result = _result(launched)
        tables = read_spool(Path(spool), entries, file) if spool else {}
        strings = _recorded_strings(record, film, file.world.past.frame) if film else ()
    return _ended(request, result, tables, strings)


def _ended(
    request: Request,
    result: Mapping[str, Any],
    tables: Mapping[str, DataTable],
    strings: tuple[tuple[int, Scene], ...],
) -> Run:
    """The run of a launcher's result. Raises WorldStopped and Interrupted."""
    file, summary = request.file, result["summary"]
    interrupted = summary["ended"] in ("interrupted", "terminated")
    if result["failure"] and not interrupted:
        raise WorldStopped(result["failure"])
    done = Run(
        file.world.vocabulary.read(result["scene"], f"{request.world.name}: the last string"),
        summary["frames"],
        summary["digest"],
        views_of(file),
        result["events"],
        # This process ends the others by a signal.
        "interrupted" if interrupted else summary["ended"],
        summary["reached"],
        result["figures"],
        summary["wall_seconds"],
        tables,
        file.collect.into,
        strings,
    )
    if interrupted:
        raise Interrupted(done)
    return done


def _result(launched: Launched) -> Mapping[str, Any]:
    """The result of a launcher, also after Ctrl-C, which ends its world."""
    try:
        with launched:
            return launched.result()
    except KeyboardInterrupt as interrupt:
        try:
            return launched.result()
        except MinervaError:
            # After a second Ctrl-C there is none.
            raise interrupt from None


def _recorded_strings(path: Path, film: int, first: int) -> tuple[tuple[int, Scene], ...]:
    """The strings of a film from frame `first` on, as after a resumed run."""
    from minerva_bus.log.record import Record

    strings = FilmStrings(film)
    with Record(path) as record:
        if record.initial.number >= first:
            strings.add(record.initial.number, record.initial.scene)
        for frame, scene in record.strings():
            if frame.number + 1 >= first:
                strings.add(frame.number + 1, scene)
    return strings.kept


def read_spool(
    path: Path, entries: Mapping[str, Expression], file: WorldFile
) -> dict[str, DataTable]:
    """The tables that a coordinator has written to a folder."""
    plans = plans_of(entries, file.world.vocabulary)
    several = len(plans) > 1
    return {
        plan.name: read_columns(table_path(path, plan.name, several), plan.name, plan.columns)
        for plan in plans
    }


def write_result(path: Path, result: Mapping[str, Any]) -> None:
    """Write a result for the process that waits for it."""
    # Renamed when it is complete, so that a reader never finds half a result.
    draft = path.with_suffix(".draft")
    draft.write_text(json.dumps(result), encoding="utf-8")
    draft.replace(path)
