"""`minerva branch`: continue a record from one of its frames in many ways, and report the runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from minerva_analysis.plotting import check_picture
from minerva_bus.cli.output import FAILED, print_json, print_result
from minerva_bus.collect.data_tables import SEED
from minerva_bus.errors import MisuseError
from minerva_bus.launch.console import Console
from minerva_study.branch_plot import draw_branches
from minerva_study.branching import Branches
from minerva_study.executor_pool import Workers
from minerva_study.grid import Grid, parse_grid
from minerva_study.results import Row
from minerva_study.sweep_command import lines_of_sweep, plain_sweep, run_to_table
from minerva_study.sweep_runs import Sweep


@dataclass(frozen=True, slots=True)
class BranchFiles:
    """The files that `minerva branch` writes: the table, and pictures if they are wanted."""

    table: Path
    plot: Path | None
    tree: Path | None


def grid_of_branches(
    branches: Branches, settings: Sequence[str], seeds: int | None, runs: int | None
) -> Grid:
    """The combinations of `--set`, `--seeds` and `--runs`. Raises MisuseError."""
    grid = parse_grid(settings)
    if SEED in grid.keys:
        if seeds is not None or runs is not None:
            raise MisuseError("--set seed=... cannot be combined with --seeds or --runs")
        return grid
    count = len(grid)
    wanted = seeds if seeds is not None else max(1, runs // count) if runs is not None else 1
    if runs is not None and count * wanted > runs:
        raise MisuseError(
            f"--runs {runs}: there are {count} combinations of --set with {wanted} seeds each,"
            f" {count * wanted} runs; allow more, or give fewer values"
        )
    return Grid({**grid.values, SEED: tuple(map(str, branches.seeds(wanted)))})


def branch_record(
    branches: Branches,
    sweep: Sweep,
    files: BranchFiles,
    workers: Workers,
    console: Console,
    as_json: bool,
) -> int:
    """Run the branches, write table and pictures, and print the result; returns the exit code.

    Raises MisuseError for files that cannot be written, and MinervaError if the world cannot run.
    """
    if files.tree is not None:
        check_picture(files.tree)
    code = run_to_table(sweep, files.table, files.plot, workers, console)
    point, row = branches.point, branches.unchanged(sweep)
    if files.tree is not None:
        unchanged = None if row is None else row.combination
        draw_branches(sweep, point.path.name, point.state.number, unchanged, files.tree)
        console.note(f"tree saved to {files.tree}")
    continues = None if row is None else branches.continues(row)
    if as_json:
        own = {"frame": point.state.number, "recorded": point.end, "continues": continues}
        print_json({**plain_sweep(sweep, files.table, code), **own})
    else:
        lines = lines_of_sweep(sweep, files.table, code)
        shown = [] if row is None or continues is None else [_checked(sweep, row, continues)]
        print_result("\n".join([*lines[:-1], *shown, lines[-1]]))
    return code or (FAILED if continues is False else 0)


def _checked(sweep: Sweep, row: Row, continues: bool) -> str:
    """The line about the run without a change, which was compared with the record."""
    digest, name = row.outcome["digest"], sweep.named(row)
    if continues:
        return f"{name}: as recorded, digest {digest}"
    return (
        f"{name}: differs from the record, digest {digest}: the world's code has changed, or it had"
        " free-running members or orders of people"
    )
