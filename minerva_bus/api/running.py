"""Runs of worlds in this process or in processes of their own, and their results."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from minerva_bus.api.on_bus import Launched
from minerva_bus.api.pictures import (
    PICTURE,
    WIDTH,
    Displayed,
    Film,
    Still,
    Visual,
    WorldViews,
    views_of,
)
from minerva_bus.api.world import ContinuedRecord, Processes, Request, World, request_of, world_of
from minerva_bus.collect.collector import agents_now
from minerva_bus.collect.data_tables import DataTable, read_columns, table_path
from minerva_bus.collect.plans import plans_of
from minerva_bus.errors import MinervaError, MisuseError, WorldStopped, nearest
from minerva_bus.frame import stimuli as s
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.console import Console
from minerva_bus.launch.in_process import InProcessRun
from minerva_bus.launch.registry import temporary_folder
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.runtime.runner import Notice
from minerva_bus.settings.world_settings import AS_WRITTEN, Overrides
from minerva_bus.values import path_of, text, whole_number
from minerva_bus.wording import counted
from minerva_bus.world.agent import Agent
from minerva_bus.world.expressions import Expression

FRAMES = "frames"
SHOWN_DIGITS = 8


@dataclass(frozen=True, repr=False)
class Run(Displayed):
    """A run that has ended. Notebooks display its film, or a picture of its last string.

    Attributes:
        scene: the last string.
        frames: the number of frames; `digest` is that of the string after them, in hexadecimal.
        events: the number of events, by type.
        ended: why it ended; `reached`: whether every agent has sent the event `until`.
        figures: metrics that its members reported, by name.
        seconds: from the end of the first frame to the end of the last one, wall time.
        tables: collected data, by the names of tables; see `table`.
        into: the file for collected data; "": they are in `tables`.
        views: draws strings of its world.
        kept: numbers of frames, and the strings with which they begin, for `film`.
        record: the file in which it was recorded; "": none.
        world: what ran, with its code; None: it is not known.
        settings: with which it ran.

    """

    scene: Scene
    frames: int
    digest: str
    views: WorldViews
    events: Mapping[str, int]
    ended: str = ""
    reached: bool = False
    figures: Mapping[str, Any] = field(default_factory=dict[str, Any])
    seconds: float = 0.0
    tables: Mapping[str, DataTable] = field(default_factory=dict[str, DataTable])
    into: str = ""
    kept: tuple[tuple[int, Scene], ...] = ()
    record: str = ""
    world: World | None = None
    settings: Overrides = AS_WRITTEN

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

    def agents(self, kind: type[Agent] | str, where: str = "") -> DataTable:
        """A table of the agents of a kind in the last string, as `Live.agents` makes it."""
        return agents_now(self.scene, self.views.vocabulary, kind, where, self.frames)

    def plot(self, path: str | Path, *series: str, x: str = "") -> None:
        """Save a plot of the table with a row for each frame, as `minerva plot` does.

        Args:
            path: of the picture, .png, .svg or .pdf.
            series: columns, or names of histograms; none: all.
            x: the column along the axis; "": `frame`, or `time` in a world with a `dt` of its own.

        Raises MisuseError, also without matplotlib.

        """
        self.table().plot(*series, x=x).save(path)

    def picture(self, event: Visual = PICTURE, width: int = WIDTH) -> Still:
        """A picture of the last string, drawn by the view `svg`.

        Args:
            event: the visual event type to draw.
            width: in pixels.

        Raises MisuseError if the world has no such view, or no primitive with a form.

        """
        return self.views.picture(self.scene, self.frames, event, width)

    def film(self, event: Visual = PICTURE, width: int = WIDTH) -> Film:
        """A film of `run(..., film=every)`; see `picture`.

        Raises MisuseError also if no strings were kept.
        """
        if not self.kept:
            raise MisuseError("no film was kept: run(world, film=10) keeps every 10th frame")
        return self.views.film(self.kept, event, width)

    @property
    def facts(self) -> list[str]:
        """What notebooks and terminals show of it."""
        tables = f"tables: {', '.join(self.tables)}" if self.tables else ""
        into = f"data in {self.into}" if self.into else ""
        frames = f"{counted(self.frames, 'frame')} in {self.seconds:.1f} s"
        digest = f"digest {self.digest[:SHOWN_DIGITS]}…"
        return [fact for fact in (frames, self.ended, digest, tables, into) if fact]

    def __repr__(self) -> str:
        return f"<Run of {self.views.name}: {'; '.join(self.facts)}>"


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, or the interruption of a notebook's kernel, has ended a run.

    `run` is the run up to its last complete frame, with its tables.
    """

    def __init__(self, run: Run) -> None:
        self.run = run
        super().__init__(
            f"{run.views.name} was interrupted after {counted(run.frames, 'frame')};"
            " its result is the attribute `run` of this exception: sys.last_value.run"
        )

    def _render_traceback_(self) -> list[str]:
        """The lines that a notebook shows: an interruption is not an error in its code."""
        return [str(self)]


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
    if text("table", name) in tables:
        return tables[name]
    # An entry of `collect` is a column of some table.
    for table in tables.values():
        if name in table.columns and name not in ("frame", "time", "id"):
            return table
    names = ", ".join(tables)
    raise MisuseError(
        f"there is no table {name!r}{nearest(name, [*tables], f'there are {names}')}"
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
    whole_number("film", film)
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


class EventCounts:
    """A sink that counts the events of a run by type."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def __call__(self, notice: Notice) -> None:
        for event in notice.events if isinstance(notice, s.FrameDone | s.Stopping) else ():
            self._counts[event.type] += len(event)

    def sorted(self) -> dict[str, int]:
        """The counts by type, sorted."""
        return dict(sorted(self._counts.items()))


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
    if summary.incomplete:
        raise MinervaError("; ".join(summary.incomplete))
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
        here.tables,
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
    if summary["incomplete"]:
        raise MinervaError("; ".join(summary["incomplete"]))
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
    whole_number("film", film)
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
    # Only here: the library of records is an extra.
    from minerva_bus.launch.past import find_file
    from minerva_bus.log.record import Record

    with Record(path_of("record", record)) as opened:
        return World.load(find_file("", opened.description, "world=..."))
