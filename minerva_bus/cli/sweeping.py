"""What `minerva sweep` does: it runs all combinations, and tells how they went."""

from __future__ import annotations

import json as json_
from pathlib import Path

from minerva_bus.cli.exit_codes import FAILED, INTERRUPTED
from minerva_bus.cli.saying import say
from minerva_bus.errors import MisuseError
from minerva_bus.launch.console import Console
from minerva_bus.study.comparison import draw_comparison, shown
from minerva_bus.study.crew import Crew
from minerva_bus.study.journal import Journal
from minerva_bus.study.results import Row, check_table, write
from minerva_bus.study.style import check_picture
from minerva_bus.study.sweep import Sweep

SHOWN = 10


def sweep_world(
    found: Sweep,
    table: Path,
    plot: Path | None,
    workers: int,
    limit: float,
    console: Console,
    json_too: bool,
) -> int:
    """Run what is left of a sweep, write its table and tell; the exit code.

    Raises MisuseError for places that nothing can be written to, and MinervaError where the world
    cannot be run.
    """
    check_table(table)
    if plot is not None:
        check_picture(plot)
    found.check()
    code = _sweep(found, table, workers, limit, console)
    if plot is not None:
        _draw(found, plot, console)
    if json_too:
        say(json_.dumps(_plain(found, table, code)))
    else:
        say("\n".join(_lines(found, table, code)))
    return code


def _sweep(found: Sweep, table: Path, workers: int, limit: float, console: Console) -> int:
    """Run what is left and write the table; the exit code."""
    beside = table.with_name(f"{table.name}.journal")
    if table.exists() and not beside.exists():
        raise MisuseError(
            f"{table} is there already, without its journal {beside.name}: name another file with"
            " -o, or take it away"
        )
    interrupted = False
    with Journal(beside, found.description) as journal, Crew(workers, limit) as crew:
        found.recall(journal)
        done, total = len(found.grid) - len(found.left), len(found.grid)
        if done:
            console.note(f"{found.path.stem}: {done} of {total} runs are in {beside.name} already")
        progress = _Progress(console, found.path.stem, done, total)
        try:
            found.run(crew, journal, progress)
        except KeyboardInterrupt:
            interrupted = True
        console.end()
        write(found.table, table)
    return INTERRUPTED if interrupted else FAILED if found.failures else 0


class _Progress:
    """The line at the bottom: how many runs are done; those that fail are named at once."""

    def __init__(self, console: Console, name: str, done: int, total: int) -> None:
        self._console = console
        self._name = name
        self._done = done
        self._total = total

    def __call__(self, row: Row) -> None:
        self._done += 1
        if row.error:
            self._console.log(self._name, f"{' '.join(row.combination)}: {row.error}")
        rest = "runs  Ctrl-C ends it; the same command goes on"
        self._console.progress(self._name, self._done, self._total, rest)


def _draw(found: Sweep, plot: Path, console: Console) -> None:
    if found.table.measures:
        draw_comparison(found.table, found.path.stem, plot)
        console.note(f"{plot} is drawn")


def _lines(found: Sweep, table: Path, code: int) -> list[str]:
    lines = shown(found.table) if found.table.rows else []
    failures, done = found.failures, len(found.table.rows)
    if failures:
        lines += [f"{len(failures)} of {done} runs failed:"]
        lines += [f"  {_named(found, row)}: {row.error}" for row in failures[:SHOWN]]
    if len(failures) > SHOWN:
        lines.append(f"  and {len(failures) - SHOWN} more")
    if code == INTERRUPTED:
        left = len(found.grid) - done
        lines.append(f"interrupted; {left} runs are left, and the same command goes on with them")
    return [*lines, f"{done} runs are in {table}"]


def _named(found: Sweep, row: Row) -> str:
    pairs = zip(found.grid.keys, row.combination, strict=True)
    return ", ".join(f"{key}={value}" for key, value in pairs)


def _plain(found: Sweep, table: Path, code: int) -> dict[str, object]:
    done = len(found.table.rows)  # There may be more in the journal, of values not named now.
    return {
        "world": found.path.stem,
        "table": str(table),
        "runs": done,
        "left": len(found.grid) - done,
        "failed": [
            {"set": dict(zip(found.grid.keys, row.combination, strict=True)), "error": row.error}
            for row in found.failures
        ],
        "interrupted": code == INTERRUPTED,
    }
