"""Branches of a recorded run: `branch` as a function, which `minerva branch` calls."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from minerva_analysis.past_frames import wait_for_frame
from minerva_bus.api.live import Live
from minerva_bus.api.running import Run, run_file, world_of_record
from minerva_bus.api.world import World
from minerva_bus.collect.data_tables import SEED, DataTable
from minerva_bus.errors import MisuseError
from minerva_bus.launch.registry import temporary_folder
from minerva_bus.launch.world_files import Collecting
from minerva_bus.settings.world_settings import AS_WRITTEN, Overrides
from minerva_bus.values import path_of, whole_number
from minerva_bus.world.operator import WorldStatus
from minerva_study.branch_point import BranchPoint, read_branch_point, recorded_digest
from minerva_study.executor_pool import ExecutorSource, Workers
from minerva_study.grid import Grid
from minerva_study.results import Row
from minerva_study.sent_branch import SentBranch
from minerva_study.studies import grid_of, sent_world, sweep_of, table_of_study
from minerva_study.study_tables import collected_of
from minerva_study.sweep_runs import Sweep

RECORD: Final = "record"


@dataclass(frozen=True, slots=True)
class Branches:
    """A frame of a record with the code of its world: runs that continue from there."""

    point: BranchPoint
    world: World

    @staticmethod
    def read(record: str | Path, frame: int | None, world: World | str | Path = "") -> Branches:
        """Read a frame; see `branch`. Raises MinervaError."""
        own, frame = world_of_record(record, world), whole_number("frame", frame)
        return Branches(read_branch_point(path_of("record", record), frame, own.read), own)

    def seeds(self, count: int) -> range:
        """The seeds of as many runs; the first is that of the record."""
        first = self.point.description.world.seed
        return range(first, first + count)

    def sweep(
        self,
        grid: Grid,
        given: Overrides = AS_WRITTEN,
        *,
        in_process: bool = True,
        collect: Collecting | None = None,
        sent: bool = False,
    ) -> Sweep:
        """The runs for all combinations; `given` are settings of all of them.

        `sent`: they run in the workers of an executor. Raises MisuseError if the world's code is
        not in modules then.
        """
        given, point = Overrides(rate=0.0).over(given), self.point
        runs = sweep_of(self.world, grid, given, point, collect or Collecting())
        own = {**runs.identity, "branch": point.state.number}
        to = SentBranch.of(sent_world(self.world), point) if sent else None
        return replace(runs, path=point.path, in_process=in_process, identity=own, sent=to)

    def unchanged(self, runs: Sweep) -> Row | None:
        """The finished run in which seed and options are those of the record, if there is one."""
        recorded = {**self.point.description.options, SEED: str(self._seed)}
        for row in runs.rows.values():
            pairs = zip(runs.grid.keys, row.combination, strict=True)
            same = all(recorded.get(key) == value for key, value in pairs)
            if same and not row.error and not runs.given.options and not runs.given.settings:
                return row
        return None

    def continues(self, row: Row) -> bool | None:
        """Whether an unchanged run has the string of the record; None: the record ends earlier."""
        frames = int(row.outcome["frames"])
        if frames > self.point.end:
            return None
        return row.outcome["digest"] == recorded_digest(self.point.path, frames)

    @property
    def _seed(self) -> int:
        return self.point.description.world.seed


def branch(
    source: str | Path | Run | Live,
    frame: int | None = None,
    grid: Mapping[str, Iterable[Any]] | None = None,
    *,
    seeds: int | Iterable[int] = 1,
    world: World | str | Path = "",
    frames: int | None = None,
    collect: Any = None,
    table: str = "",
    folder: str | Path = "",
    workers: int = 0,
    limit: float = 0.0,
    executor: ExecutorSource | None = None,
    quiet: bool = False,
) -> DataTable:
    """Continue a recorded run from one of its frames in many ways, in parallel.

    The record is read once, up to that frame. With the seed and the options of the record, a
    branch has its strings.

    Args:
        source: a record, .mcap; a run, which is repeated once in this process if it has no record;
            or a running world with a record on this machine, which stays as it is.
        frame: branches begin with the string of this frame; None: the current one of a running
            world.
        grid: values by option of the world, or by PROCESS.KEY, as for `sweep`. They apply from
            that frame on.
        seeds: the number of seeds, of which the first is that of the record, or the seeds.
        world: the world with the agents' code; "": that of the run or the running world, or the
            world file that the record names.
        frames: the last frame; default: that of the record. A running world needs it.
        collect: as for `run`, from that frame on; without it, the table has the outcomes.
        table: which table of collected data; "": that of frames, or the only one.
        folder: stores finished runs, so that the same call continues after a kill. "": none.
        workers: parallel runs; 0: one per core.
        limit: seconds that a run may take; 0: no limit.
        executor: as for `sweep`; its workers receive the frame, and need no record.
        quiet: show no progress, only failures.

    Returns:
        The table of `sweep`: a column for each option and for the seed, and the results.

    Raises:
        RecordError: the record cannot be read, or has no checkpoints.
        MisuseError: there is no such frame, an argument is wrong, all runs failed, or the run or
            the running world has no record and cannot be repeated.
        MinervaError: the record is of another world, or the run is over at that frame.
        KeyboardInterrupt: after Ctrl-C; finished runs are in the folder.

    Example:
        >>> branch("run.mcap", 400, {"weather.amount": [0.005, 0.02]}, seeds=5,
        ...        collect={"rabbits": "count(ARabbit)"})

    """
    branches = _branches_of(source, frame, world, frames)
    numbers = tuple(branches.seeds(seeds) if isinstance(seeds, int) else seeds)
    if not numbers:
        raise MisuseError(f"seeds={seeds!r:.40}: expected at least one seed")
    combinations = grid_of(grid or {}, numbers)
    entries, plans = collected_of(branches.world, collect)
    given = Overrides(frames=frames)

    def make(collecting: Collecting) -> Sweep:
        return branches.sweep(combinations, given, collect=collecting, sent=executor is not None)

    return table_of_study(
        make, entries, plans, table, folder, Workers(workers, limit, executor), quiet
    )


def _branches_of(
    source: str | Path | Run | Live,
    frame: int | None,
    world: World | str | Path,
    frames: int | None,
) -> Branches:
    """The frame of a source from which runs branch. Raises MinervaError."""
    if not isinstance(source, Run | Live):
        return Branches.read(source, frame, world)
    code = source.world if world == "" and source.world is not None else world
    if isinstance(source, Live):
        return Branches.read(*_recorded(source.status, frame, frames), code)
    if source.record:
        return Branches.read(source.record, frame, code)
    if source.world is None:
        raise MisuseError('the run has no record: run(world, record="run.mcap")')
    with temporary_folder("branch") as folder:
        record = folder / "run.mcap"
        _repeat(source, source.world, record)
        return Branches.read(record, frame, code)


def _recorded(status: WorldStatus, frame: int | None, frames: int | None) -> tuple[Path, int]:
    """The record of a running world, and the frame with which branches begin.

    Raises MisuseError if they cannot.
    """
    files = [file for file in status.files if file.name == RECORD and not file.problem]
    if not files or not Path(files[0].path).exists():
        raise MisuseError(
            f"{status.world} has no record on this machine, which its branches need: start it with"
            ' record="run.mcap", or by minerva run --record run.mcap'
        )
    path, begin = Path(files[0].path), status.frame if frame is None else frame
    if frames is None:
        raise MisuseError(f"{status.world}: branches of a running world need frames=N, the last")
    if begin >= frames:
        raise MisuseError(
            f"{status.world}: branches that begin with frame {begin} cannot end with frame"
            f" {frames}; expected a later one, or frame=N, an earlier beginning"
        )
    wait_for_frame(path, min(begin, status.frame))
    return path, begin


def _repeat(run: Run, world: World, record: Path) -> None:
    """Run a world again and record it. Raises MisuseError if its last string is another one."""
    given = Overrides(record=str(record), frames=run.frames).over(run.settings)
    # What was collected is not collected again: it would replace the file.
    file = replace(world.read(given), collect=Collecting())
    again = run_file(file, time.monotonic())
    if again.digest != run.digest:
        raise MisuseError(
            f"the run of {world.name} cannot be repeated: it had free-running members, orders of"
            ' people, or has changed code; record it: run(world, record="run.mcap")'
        )
