"""Studies of many runs: `sweep` as a function, which `minerva sweep` calls."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final, cast

from minerva_bus.api.running import pick_table
from minerva_bus.api.world import World, request_of, world_of
from minerva_bus.collect.data_tables import SEED, DataTable
from minerva_bus.collect.plans import Entries, TablePlan
from minerva_bus.errors import MisuseError
from minerva_bus.launch.console import Console
from minerva_bus.launch.registry import temporary_folder
from minerva_bus.launch.toml_tables import option_text
from minerva_bus.launch.world_files import Collecting, WorldFile
from minerva_bus.settings.world_settings import AS_WRITTEN, Overrides
from minerva_bus.values import named, path_of, whole_number
from minerva_study.code_digests import identity, named_objects
from minerva_study.executor_pool import ExecutorSource, Workers, open_pool
from minerva_study.grid import Grid
from minerva_study.journal import StudyJournal
from minerva_study.results import Row
from minerva_study.sent_world import SentWorld
from minerva_study.study_tables import (
    collected_of,
    collected_tables,
    outcome_table,
    with_keys,
)
from minerva_study.sweep_runs import Sweep

MAX_SEEDS: Final = 1_000_000
"""Runs for each combination of a sweep, which keeps the seeds of all in memory."""
_LEAST_SEED: Final = -(1 << 63)


class SweepProgress:
    """The status line of a sweep: the number of finished runs; failures are reported at once."""

    def __init__(self, console: Console, sweep: Sweep) -> None:
        self._console = console
        self._name = sweep.path.stem
        self._named = sweep.named
        self._total = len(sweep.grid)
        self._done = self._total - len(sweep.left)

    def __call__(self, row: Row) -> None:
        self._done += 1
        if row.error:
            self._console.log(self._name, f"{self._named(row)}: {row.error}")
        rest = "runs  Ctrl-C stops; the same command continues"
        self._console.progress(self._name, self._done, self._total, rest)
        if not self._console.terminal:
            line = f"{self._name}: {self._done} of {self._total} runs"
            self._console.periodic(line, time.monotonic())


def run_sweep(sweep: Sweep, journal: Path, workers: Workers, console: Console) -> bool:
    """Run the remaining runs of a sweep, according to its journal; returns whether interrupted.

    Args:
        sweep: the runs.
        journal: the file with the finished runs, to which each further run is added.
        workers: where they run.
        console: shows the progress.

    Raises MisuseError if the journal is of another sweep, and MinervaError if an executor fails.

    """
    interrupted = False
    name = sweep.path.stem

    def note(line: str) -> None:
        console.log(name, line, "warning")

    with StudyJournal(journal, sweep.description) as lines, open_pool(workers, note) as pool:
        sweep.recall(lines)
        done, total = len(sweep.grid) - len(sweep.left), len(sweep.grid)
        if done:
            console.note(f"{name}: {done} of {total} runs are in {journal.name} already")
        try:
            sweep.run(pool, lines, SweepProgress(console, sweep))
        except KeyboardInterrupt:
            interrupted = True
        finally:
            console.end()
    return interrupted


def sweep(
    world: World | str | Path,
    grid: Mapping[str, Iterable[Any]] | None = None,
    *,
    seeds: int | Iterable[int] = (),
    frames: int | None = None,
    collect: Any = None,
    table: str = "",
    folder: str | Path = "",
    workers: int = 0,
    limit: float = 0.0,
    executor: ExecutorSource | None = None,
    quiet: bool = False,
) -> DataTable:
    """Run a world with all combinations of options, in parallel, and return one table.

    Args:
        world: a `World`, a world file, or the name of an installed world.
        grid: values by option of the world, or by PROCESS.KEY: `{"birds": [100, 1000]}`.
        seeds: the number of seeds, from 0, or the seeds.
        frames: per run; default: the world's own.
        collect: as for `run`; without it, the table has the outcome of each run.
        table: which table of collected data; "": that of frames, or the only one.
        folder: stores finished runs, so that the same call continues after a kill. "": none.
        workers: parallel runs; 0: one per core.
        limit: seconds that a run may take; 0: no limit. A run that takes longer fails.
        executor: runs the worlds instead of processes of this machine: a pool of
            concurrent.futures, `Client(...).get_executor()` of Dask, an `MPIPoolExecutor`, ... The
            code of the world has to be in modules that its workers can import. With a function
            that opens an executor, such as `lambda: ProcessPoolExecutor(8)`, the sweep continues
            in a new one after the loss of a worker.
        quiet: show no progress, only failures.

    Returns:
        A table with a column for each option and for the seed, and then those collected, or
        `frames`, `digest`, `ended`, the figures, `error` and `seconds`. Runs that failed have no
        rows of collected data.

    Raises:
        MisuseError: an argument is wrong, the folder is of another study, or all runs failed.
        MinervaError: the workers of the executor cannot run the world.
        KeyboardInterrupt: after Ctrl-C; finished runs are in the folder.

    Each run is in a process forked from this one, so the world need not be in a module. The table
    is the same with any number of workers and any executor.

    Example:
        >>> curves = sweep(world, {"people": [100, 200]}, seeds=20, frames=300,
        ...                collect={"sick": count(Person, "days > 0")})
        >>> curves.to_pandas().groupby(["people", "frame"])["sick"].mean()

    """
    own = world_of(world, {})
    combinations = grid_of(grid or {}, seeds)
    # For its checks only: an error appears here, not once in each run.
    request_of(own, {}, frames=frames)
    entries, plans = collected_of(own, collect)

    def make(collecting: Collecting) -> Sweep:
        given = Overrides(frames=frames, rate=0.0)
        runs = sweep_of(own, combinations, given, own.read, collecting)
        if executor is not None:
            runs.sent = sent_world(own)
        return runs

    return table_of_study(
        make, entries, plans, table, folder, Workers(workers, limit, executor), quiet
    )


def table_of_study(
    make: Callable[[Collecting], Sweep],
    entries: Entries,
    plans: Sequence[TablePlan],
    table: str,
    folder: str | Path,
    workers: Workers,
    quiet: bool,
) -> DataTable:
    """Run a study; see `sweep`. `make` returns its runs, which collect `entries` into a folder."""
    with ExitStack() as stack:
        if folder:
            kept = path_of("folder", folder)
            kept.mkdir(parents=True, exist_ok=True)
        else:
            kept = stack.enter_context(temporary_folder("sweep"))
        runs = make(Collecting(entries, str(kept)))
        runs.check()
        if run_sweep(runs, kept / "runs.journal", workers, Console(quiet=quiet)):
            raise KeyboardInterrupt
        _check_any_succeeded(runs)
        if not entries:
            return outcome_table(runs)
        collected, keys = collected_tables(runs, runs.grid, plans)
    wanted = pick_table(collected, table)
    return with_keys(runs.grid.keys, keys[wanted.name], wanted)


def sweep_of(
    world: World,
    grid: Grid,
    given: Overrides,
    read: Callable[[Overrides], WorldFile],
    collect: Collecting,
) -> Sweep:
    """The runs of a world in Python, with the identity that their journal needs.

    `read` reads the world of a run; `given` are settings of all runs.
    """
    path, tables = world.path or Path(f"{world.name}.toml"), world.tables()
    return Sweep(
        path,
        grid,
        given,
        in_process=True,
        read=read,
        collect=collect,
        identity=identity(tables, read(given), named_objects(tables, path.parent)),
    )


def _check_any_succeeded(runs: Sweep) -> None:
    """Raise MisuseError if all runs of a sweep have failed."""
    if runs.failures and len(runs.failures) == len(runs.rows):
        first = runs.failures[0]
        raise MisuseError(f"all runs failed; the first: {runs.named(first)}: {first.error}")


def sent_world(world: World, given: Overrides = AS_WRITTEN, *more: object) -> SentWorld:
    """A world for the workers of an executor. Raises MisuseError if its code is not in modules."""
    path = world.path or Path.cwd() / f"{world.name}.toml"
    return SentWorld.of(world.toml(), path, given.over(world.given), *more)


def grid_of(grid: Mapping[str, Iterable[Any]], seeds: int | Iterable[int]) -> Grid:
    """All combinations of values and seeds. Raises MisuseError."""
    values: dict[str, tuple[str, ...]] = {}
    for key, given in named("values", grid).items():
        if isinstance(given, str) or not isinstance(given, Iterable):
            raise MisuseError(f"{key}: expected a list of values, not {given!r:.60}")
        texts = tuple(map(option_text, cast("Iterable[Any]", given)))
        # The texts identify runs in the journal.
        if len(set(texts)) < len(texts):
            raise MisuseError(f"{key}: a value is given twice: {', '.join(texts)}")
        values[key] = texts
    listed = tuple(map(str, _seeds(seeds)))
    if listed:
        values[SEED] = listed
    if not values or not all(values.values()):
        raise MisuseError("nothing to sweep: give values of an option, or seeds=20")
    return Grid(values)


def _seeds(seeds: int | Iterable[int]) -> Iterable[int]:
    """The seeds that a number or a list of them gives. Raises MisuseError."""
    if isinstance(seeds, str | bytes) or not isinstance(seeds, Iterable):
        return range(whole_number("seeds", seeds, most=MAX_SEEDS))
    return [whole_number("each of seeds", seed, _LEAST_SEED) for seed in seeds]
