"""A sweep: a world with all combinations of some options, each run once.

What is finished is in the journal beside the table, on the disk, before it counts: a sweep that
was killed goes on where it was. Runs that failed are tried again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from hashlib import blake2b
from pathlib import Path
from typing import Any

from minerva_bus.launch.reading import read_world_file
from minerva_bus.settings.overrides import Overrides
from minerva_bus.study.crew import Result, Task, WorkerPool
from minerva_bus.study.grid import Combination, Grid
from minerva_bus.study.journal import Journal, no_line
from minerva_bus.study.results import OWN, Row, Table
from minerva_bus.study.trial import prepared, run_trial


@dataclass(slots=True)
class Sweep:
    """Runs of a world; `rows` are those that are done, `told` hears of each that is."""

    path: Path
    grid: Grid
    given: Overrides
    in_process: bool = False
    rows: dict[Combination, Row] = field(default_factory=dict[Combination, Row])

    @property
    def description(self) -> Mapping[str, Any]:
        """What makes two sweeps one study: the same world, options and end."""
        return {
            "world": str(self.path),
            "digest of the world file": blake2b(self.path.read_bytes(), digest_size=8).hexdigest(),
            "keys": list(self.grid.keys),
            "options": dict(self.given.options),
            "settings": list(self.given.settings),
            "seed": self.given.values.get("seed"),
            "frames": self.given.values.get("frames"),
        }

    @property
    def left(self) -> list[Combination]:
        """The combinations that are still to be run, or to be tried again."""
        return [one for one in self.grid if one not in self.rows or self.rows[one].error]

    def recall(self, journal: Journal) -> None:
        """Take over what is in a journal. Raises MisuseError for lines that are none of one."""
        for number, line in enumerate(journal.lines, 2):
            try:
                row = _row(line)
                self.rows[row.combination] = row
            except (KeyError, TypeError, ValueError):
                raise no_line(journal.path, number) from None

    def check(self) -> None:
        """Read the world as the first combination has it. Raises MinervaError."""
        for combination in list(self.grid)[:1]:
            prepared(read_world_file(self.path, self.grid.overrides(combination, self.given)))

    def run(self, crew: WorkerPool, journal: Journal, told: Callable[[Row], None]) -> None:
        """Run what is left."""
        left = self.left

        def heard(number: int, result: Result) -> None:
            line = {"set": list(left[number]), **_told(result)}
            journal.add(line)
            row = self.rows[left[number]] = _row(line)
            told(row)

        crew.run([self._task(one) for one in left], heard)

    def _task(self, combination: Combination) -> Task:
        overrides = self.grid.overrides(combination, self.given)
        return lambda: _run(self.path, overrides, self.in_process)

    @property
    def table(self) -> Table:
        """What is done, in the order of the combinations."""
        done = [self.rows[one] for one in self.grid if one in self.rows]
        return Table.of(self.grid.keys, done)

    @property
    def failures(self) -> list[Row]:
        """The runs that failed."""
        return [self.rows[one] for one in self.grid if one in self.rows and self.rows[one].error]


def _run(path: Path, overrides: Overrides, in_process: bool) -> Mapping[str, Any]:
    """One run, as plain data. Raises MinervaError."""
    outcome = run_trial(prepared(read_world_file(path, overrides)), in_process)
    own = {name: getattr(outcome, name) for name in OWN}
    return {"outcome": own, "figures": dict(outcome.figures)}


def _told(result: Result) -> Mapping[str, Any]:
    return {**result.told, "error": result.error, "seconds": round(result.seconds, 3)}


def _row(line: Mapping[str, Any]) -> Row:
    return Row(
        tuple(line["set"]),
        line.get("outcome", {}),
        line.get("figures", {}),
        str(line["error"]),
        float(line["seconds"]),
    )
