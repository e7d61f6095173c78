"""Calibration: search for the option and parameter values that give the best runs, by Optuna."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from minerva_analysis.tables import typed_column
from minerva_bus.api.world import World, request_of, world_of
from minerva_bus.collect.data_tables import SEED, DataTable, needed
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.toml_tables import option_text
from minerva_bus.launch.world_files import Collecting
from minerva_bus.settings.world_settings import Overrides
from minerva_study.branching import Branches
from minerva_study.executor_pool import ExecutorSource, Workers
from minerva_study.grid import Combination, Grid, ListedGrid
from minerva_study.results import option_value
from minerva_study.search_space import Ranges, distributions, sampler_named
from minerva_study.studies import sent_world, sweep_of, table_of_study
from minerva_study.study_tables import collected_of
from minerva_study.sweep_runs import Sweep

if TYPE_CHECKING:
    import optuna

Objective: TypeAlias = "str | Callable[[DataTable], float]"
"""A column of the table, of which the mean counts, or a function of the rows of one trial."""

BATCH: Final = 8
"""Trials that are chosen together. It is constant, so that workers do not influence the search."""


@dataclass(frozen=True)
class Calibration:
    """The result of a search.

    Attributes:
        best: the best values by option, and their `value`.
        trials: a table with a row for each trial: the options and the value, nan for a failure.

    """

    best: Mapping[str, Any]
    value: float
    trials: DataTable


def calibrate(
    world: World | str | Path,
    objective: Objective,
    ranges: Ranges,
    *,
    trials: int = 40,
    seeds: int = 1,
    minimise: bool = True,
    sampler: str = "tpe",
    seed: int = 0,
    frame: int | None = None,
    frames: int | None = None,
    collect: Any = None,
    table: str = "",
    folder: str | Path = "",
    workers: int = 0,
    limit: float = 0.0,
    executor: ExecutorSource | None = None,
    quiet: bool = False,
) -> Calibration:
    """Search for the values that give the best runs; needs the extra `optuna`.

    A sampler of Optuna proposes the values of each trial, which then runs with each seed, as in a
    sweep or in branches.

    Args:
        world: a `World`, a world file, or the name of an installed world; with `frame`, a record,
            .mcap, from which each trial branches.
        objective: a column of the table of `sweep`, of which the mean over the rows of a trial
            counts, or a function of these rows that returns a number.
        ranges: the bounds of a number, `{"speed": (0.1, 2.0)}`, whole numbers if both bounds are
            ints, or a list of values, `{"planner": ["astar", "random"]}`. A key is an option of the
            world, PROCESS.KEY, or a parameter of its string: `"AFox.speed"` of every AFox,
            `"#anna.water"` of one agent; its bounds may be a text with units, `"-90deg:1rad"`.
        trials: the number of trials.
        seeds: runs of each trial, with the seeds 0, 1, ...; in branches from that of the record.
        minimise: whether a lower objective is better.
        sampler: the sampler of Optuna: "tpe", "cma-es", "nsga-ii" or "random".
        seed: seed of the sampler.
        frame: the frame of the record with which branches begin; None: whole runs.
        frames: per run; default: the world's own, or the end of the record.
        collect: as for `sweep`; without it, the rows are outcomes.
        table: as for `sweep`.
        folder: as for `sweep`: the same call continues after a kill.
        workers: parallel runs; 0: one per core. The result does not depend on it.
        limit: seconds that a run may take; 0: no limit.
        executor: as for `sweep`.
        quiet: show no progress, only failures.

    Raises:
        MisuseError: an argument is wrong, Optuna is missing, or all runs failed.
        MinervaError: the workers of the executor cannot run the world.
        KeyboardInterrupt: after Ctrl-C; finished runs are in the folder.

    Example:
        >>> result = calibrate("meadow", "rabbits", {"weather.amount": (0.005, 0.05)}, seeds=3,
        ...                    frames=200, collect={"rabbits": "count(ARabbit)"}, minimise=False)
        >>> result.best, result.value

    """
    if trials < 1 or seeds < 1:
        raise MisuseError(f"trials={trials}, seeds={seeds}; expected at least 1 of each")
    sent = executor is not None
    runs = _runs(world, frames, sent) if frame is None else _branches(world, frame, frames, sent)
    space = distributions(ranges, runs.scene, runs.world.vocabulary)
    search = _TrialSearch(_study(minimise, sampler, seed), space, runs.seeds(seeds))
    entries, plans = collected_of(runs.world, collect)
    for begin in range(0, trials, BATCH):
        grid = search.ask(min(BATCH, trials - begin))
        rows = table_of_study(
            partial(runs.make, grid), entries, plans, table, folder,
            Workers(workers, limit, executor), quiet,
        )  # fmt: skip
        search.tell(rows, objective)
    return search.result()


@dataclass(frozen=True)
class _Runs:
    """How the runs of a trial are made: of a world, with seeds that begin with `first`.

    `scene` is the string with which they begin.
    """

    world: World
    scene: Scene
    first: int
    make: Callable[[Grid, Collecting], Sweep]

    def seeds(self, count: int) -> range:
        """The seeds of as many runs."""
        return range(self.first, self.first + count)


def _runs(world: World | str | Path, frames: int | None, sent: bool) -> _Runs:
    """Whole runs. Raises MinervaError."""
    own = world_of(world, {})
    # Also for its checks: an error appears here, not once in each run.
    file = request_of(own, {}, frames=frames).file

    def make(grid: Grid, collecting: Collecting) -> Sweep:
        runs = sweep_of(own, grid, Overrides(frames=frames, rate=0.0), own.read, collecting)
        runs.sent = sent_world(own) if sent else None
        return runs

    return _Runs(own, file.world.scene, 0, make)


def _branches(record: World | str | Path, frame: int, frames: int | None, sent: bool) -> _Runs:
    """Branches of a record. Raises MinervaError."""
    if isinstance(record, World):
        raise MisuseError(f"frame={frame}: expected a record, .mcap, not the world {record.name}")
    branches = Branches.read(record, frame)

    def make(grid: Grid, collecting: Collecting) -> Sweep:
        return branches.sweep(grid, Overrides(frames=frames), collect=collecting, sent=sent)

    return _Runs(branches.world, branches.point.state.scene, branches.seeds(1)[0], make)


class _TrialSearch:
    """Trials of a study of Optuna, in batches."""

    def __init__(
        self,
        study: optuna.Study,
        distributions: dict[str, optuna.distributions.BaseDistribution],
        seeds: range,
    ) -> None:
        self._study, self._distributions = study, distributions
        self._seeds = tuple(map(str, seeds))
        self._asked: list[optuna.Trial] = []
        self._done: list[tuple[Mapping[str, Any], float]] = []

    def ask(self, count: int) -> ListedGrid:
        """The runs of the next trials."""
        self._asked = [self._study.ask(self._distributions) for _ in range(count)]
        listed: list[Combination] = []
        for trial in self._asked:
            texts = tuple(option_text(trial.params[key]) for key in self._distributions)
            listed += [(*texts, seed) for seed in self._seeds]
        # Two trials of one batch may have the same values.
        unique = tuple(dict.fromkeys(listed))
        keys = (*self._distributions, SEED)
        columns = {key: tuple([row[at] for row in unique]) for at, key in enumerate(keys)}
        return ListedGrid(columns, unique)

    def tell(self, table: DataTable, objective: Objective) -> None:
        """Evaluate the trials of a batch. Raises MisuseError."""
        import optuna

        for trial in self._asked:
            value = _value(_rows_of(table, trial.params), objective)
            self._done.append((trial.params, value))
            if math.isfinite(value):
                self._study.tell(trial, value)
            else:
                self._study.tell(trial, state=optuna.trial.TrialState.FAIL)

    def result(self) -> Calibration:
        """The best trial, and all. Raises MisuseError if all have failed."""
        if not any(math.isfinite(value) for _, value in self._done):
            raise MisuseError("calibrate: no trial has a value; see the errors of the runs")
        columns: dict[str, list[Any]] = {
            key: [params[key] for params, _ in self._done] for key in self._distributions
        }
        columns["value"] = [value for _, value in self._done]
        typed = {key: typed_column(values, option_text) for key, values in columns.items()}
        types = {key: kind for key, (kind, _) in typed.items()}
        arrays = {key: array for key, (_, array) in typed.items()}
        best = self._study.best_trial
        return Calibration(
            best.params, float(best.value or 0.0), DataTable("trials", types, arrays)
        )


def _study(minimise: bool, sampler: str, seed: int) -> optuna.Study:
    optuna = needed("optuna", "optuna")
    # Its lines would mix with those of the runs.
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    direction = "minimize" if minimise else "maximize"
    return optuna.create_study(direction=direction, sampler=sampler_named(sampler, seed))


def _rows_of(table: DataTable, params: Mapping[str, Any]) -> DataTable:
    """The rows of one trial."""
    chosen = np.ones(len(table), np.bool_)
    for key, value in params.items():
        column, wanted = table[key], option_text(value)
        # A text such as "10" is a number in a column of numbers.
        chosen &= column == (wanted if column.dtype == object else option_value(wanted))
    columns = {name: column[chosen] for name, column in table.to_dict().items()}
    return DataTable(table.name, table.types, columns)


def _value(rows: DataTable, objective: Objective) -> float:
    """The value of a trial; nan if a run failed. Raises MisuseError."""
    if not len(rows) or ("error" in rows.columns and any(rows["error"])):
        return math.nan
    try:
        value = np.mean(rows[objective]) if isinstance(objective, str) else objective(rows)
        return float(value)
    except (TypeError, ValueError) as error:
        raise MisuseError(f"objective: {error}; expected a number of each trial") from None
