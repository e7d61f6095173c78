"""`minerva calibrate`: search for values and report the best."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from minerva_bus.api.running import world_of_record
from minerva_bus.api.world import World
from minerva_bus.cli.output import FAILED, INTERRUPTED, print_json, print_result
from minerva_bus.collect.data_tables import needed
from minerva_bus.collect.plans import parse_entries
from minerva_bus.errors import MisuseError
from minerva_bus.launch.assignment import names_nodes
from minerva_bus.launch.console import Console
from minerva_bus.launch.specs import folder_of, load
from minerva_bus.launch.toml_tables import option_text
from minerva_study.calibrating import Calibration, Objective, calibrate
from minerva_study.executor_pool import Workers
from minerva_study.grid import key_and_values, parts_of
from minerva_study.results import ResultTable, check_table, option_value, write
from minerva_study.sweep_command import check_journal


@dataclass(frozen=True, slots=True)
class Search:
    """What `minerva calibrate` searches for; `given` are options of all runs."""

    world: str
    objective: str
    ranges: Mapping[str, Any]
    maximise: bool
    trials: int
    seeds: int
    sampler: str
    seed: int
    collect: tuple[str, ...]
    frame: int | None
    frames: int | None
    given: Mapping[str, str] = field(default_factory=dict[str, str])


def read_ranges(settings: Sequence[str]) -> dict[str, Any]:
    """Ranges from `KEY=LOW:HIGH` and `KEY=A,B,...`. Raises MisuseError."""
    ranges: dict[str, Any] = {}
    for setting in settings:
        key, text = key_and_values(setting)
        if not key or not text:
            raise MisuseError(f"--range {setting}: expected KEY=LOW:HIGH or KEY=A,B,...")
        if key in ranges:
            raise MisuseError(f"--range {setting}: {key} has a range already")
        if names_nodes(key):
            # The declared type of the parameter decides what the text represents.
            ranges[key] = text
            continue
        low, colon, high = text.partition(":")
        bounds = option_value(low.strip()), option_value(high.strip())
        numbers = all(isinstance(bound, int | float) for bound in bounds)
        ranges[key] = (
            bounds if colon and numbers else [option_value(part.strip()) for part in parts_of(text)]
        )
    return ranges


def calibrate_world(
    search: Search, table: Path, workers: Workers, console: Console, as_json: bool
) -> int:
    """Search, write the table of trials, and print the best; returns the exit code.

    Raises MisuseError for wrong options and files, and MinervaError if the world cannot run.
    """
    needed("optuna", "optuna")
    check_table(table)
    folder = check_journal(table, "runs")
    try:
        result = _calibrated(search, folder, workers, console)
    except KeyboardInterrupt:
        console.note(f"interrupted; the same command continues with the runs in {folder}")
        if as_json:
            print_json({"world": search.world, "table": str(table), "interrupted": True})
        return INTERRUPTED
    columns = result.trials.columns
    write(ResultTable(columns[:-1], columns, tuple(result.trials.rows())), table)
    failed = sum(math.isnan(value) for value in result.trials["value"])
    if as_json:
        print_json(
            {
                "world": search.world,
                "table": str(table),
                "trials": len(result.trials),
                "failed": failed,
                "best": dict(result.best),
                "value": result.value,
                "interrupted": False,
            }
        )
    else:
        print_result("\n".join(_lines(result, table, failed)))
    return FAILED if failed else 0


def _calibrated(search: Search, folder: Path, workers: Workers, console: Console) -> Calibration:
    if search.frame is not None and search.given:
        raise MisuseError(
            f"--{min(search.given)}: branches have the options of the record; search for another"
            " value with --range"
        )
    if search.frame is None:
        world = World.load(search.world, **search.given)
        path = world.path
    else:
        world, path = search.world, world_of_record(search.world, "").path
    return calibrate(
        world,
        _objective(search.objective, (path or Path()).parent),
        search.ranges,
        trials=search.trials,
        seeds=search.seeds,
        minimise=not search.maximise,
        sampler=search.sampler,
        seed=search.seed,
        frame=search.frame,
        frames=search.frames,
        collect=parse_entries(search.collect) if search.collect else None,
        folder=folder,
        workers=workers.count,
        limit=workers.limit,
        executor=workers.executor,
        quiet=console.quiet,
    )


def _objective(spec: str, folder: Path) -> Objective:
    """The objective of a column or of `module:function`. Raises WorldFileError and MisuseError."""
    if ":" not in spec:
        return spec
    objective = load(spec, folder_of(spec, folder))
    if not callable(objective):
        raise MisuseError(f"--objective {spec} is not a function")
    return cast("Objective", objective)


def _lines(result: Calibration, table: Path, failed: int) -> list[str]:
    best = ", ".join(f"{key}={option_text(value)}" for key, value in result.best.items())
    lines = [f"best: {best}", f"value: {result.value:.6g}"]
    if failed:
        lines.append(f"{failed} of {len(result.trials)} trials have no value: a run of each failed")
    return [*lines, f"{len(result.trials)} trials are in {table}"]
