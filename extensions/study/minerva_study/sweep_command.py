"""`minerva sweep`: run all combinations of options and report the results."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from minerva_analysis.plotting import check_picture
from minerva_bus.cli.output import FAILED, INTERRUPTED, print_json, print_result
from minerva_bus.errors import MisuseError
from minerva_bus.launch.console import Console
from minerva_study.comparison import draw_comparison, shown
from minerva_study.executor_pool import Workers
from minerva_study.results import check_table, write
from minerva_study.studies import run_sweep
from minerva_study.sweep_runs import Sweep

MAX_FAILURES: Final = 10


def sweep_world(
    sweep: Sweep,
    table: Path,
    plot: Path | None,
    workers: Workers,
    console: Console,
    as_json: bool,
) -> int:
    """Run the remaining combinations, write the table and print it; returns the exit code.

    Raises MisuseError for files that cannot be written, and MinervaError if the world cannot run.
    """
    code = run_to_table(sweep, table, plot, workers, console)
    if as_json:
        print_json(plain_sweep(sweep, table, code))
    else:
        print_result("\n".join(lines_of_sweep(sweep, table, code)))
    return code


def run_to_table(
    sweep: Sweep, table: Path, plot: Path | None, workers: Workers, console: Console
) -> int:
    """Run the remaining combinations, write table and plot; returns the exit code."""
    check_table(table)
    if plot is not None:
        check_picture(plot)
    sweep.check()
    code = _sweep(sweep, table, workers, console)
    if plot is not None:
        _draw(sweep, plot, console)
    return code


def _sweep(sweep: Sweep, table: Path, workers: Workers, console: Console) -> int:
    """Run the remaining combinations and write the table; returns the exit code."""
    beside = check_journal(table, "journal")
    interrupted = run_sweep(sweep, beside, workers, console)
    write(sweep.table, table)
    return INTERRUPTED if interrupted else FAILED if sweep.failures else 0


def check_journal(table: Path, ending: str) -> Path:
    """The journal of a table, beside it. Raises MisuseError if only the table exists."""
    beside = table.with_name(f"{table.name}.{ending}")
    # The table is written from the journal, so its rows would be lost without one.
    if table.exists() and not beside.exists():
        raise MisuseError(
            f"{table} exists without its journal {beside.name}; remove it, or name another file"
            " with -o"
        )
    return beside


def _draw(sweep: Sweep, plot: Path, console: Console) -> None:
    if sweep.table.measures:
        draw_comparison(sweep.table, sweep.path.stem, plot)
        console.note(f"plot saved to {plot}")


def lines_of_sweep(sweep: Sweep, table: Path, code: int) -> list[str]:
    """The results as text: a row for each combination, failures, and where the table is."""
    lines = shown(sweep.table) if sweep.table.rows else []
    failures, done = sweep.failures, len(sweep.table.rows)
    if failures:
        lines += [f"{len(failures)} of {done} runs failed:"]
        lines += [f"  {sweep.named(row)}: {row.error}" for row in failures[:MAX_FAILURES]]
    if len(failures) > MAX_FAILURES:
        lines.append(f"  and {len(failures) - MAX_FAILURES} more")
    if code == INTERRUPTED:
        left = len(sweep.grid) - done
        lines.append(f"interrupted with {left} runs left; the same command continues with them")
    return [*lines, f"{done} runs are in {table}"]


def plain_sweep(sweep: Sweep, table: Path, code: int) -> dict[str, object]:
    """The results as JSON."""
    done = len(sweep.table.rows)  # The journal may have more, of values not given now.
    return {
        "world": sweep.path.stem,
        "table": str(table),
        "runs": done,
        "left": len(sweep.grid) - done,
        "failed": [
            {"set": dict(zip(sweep.grid.keys, row.combination, strict=True)), "error": row.error}
            for row in sweep.failures
        ],
        "interrupted": code == INTERRUPTED,
    }
