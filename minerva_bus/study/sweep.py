"""A sweep: runs of a world with all combinations of options, one run each.

Finished runs are in the journal beside the table, so a sweep that was killed continues where it
stopped. Runs that failed are repeated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import blake2b
from pathlib import Path
from typing import Any

from minerva_bus.launch.collecting import Collecting
from minerva_bus.launch.reading import read_world_file
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.settings.overrides import Overrides
from minerva_bus.study.grid import Combination, Grid
from minerva_bus.study.journal import StudyJournal, invalid_line
from minerva_bus.study.results import OWN, ResultTable, Row
from minerva_bus.study.trial import prepared, run_trial
from minerva_bus.study.worker_pool import Result, Task, WorkerPool


@dataclass(slots=True)
class Sweep:
    """Runs of the world in a file, or of one that `read` makes under the name of `path`.

    `rows` are those that are done. `collect` is collected of each run, into a file `part` in the
    folder `collect.into`.
    """

    path: Path
    grid: Grid
    given: Overrides
    in_process: bool = False
    read: Callable[[Overrides], WorldFile] | None = None
    collect: Collecting = field(default_factory=Collecting)
    rows: dict[Combination, Row] = field(default_factory=dict[Combination, Row])

    @property
    def description(self) -> Mapping[str, Any]:
        """What makes two sweeps one study: the same world, options and end."""
        collected = {name: str(entry) for name, entry in self.collect.entries.items()}
        return {
            "world": str(self.path),
            "digest of the world file": blake2b(self._content(), digest_size=8).hexdigest(),
            "keys": list(self.grid.keys),
            "options": dict(self.given.options),
            "settings": list(self.given.settings),
            "seed": self.given.values.get("seed"),
            "frames": self.given.values.get("frames"),
            **({"collect": collected} if collected else {}),
        }

    def _content(self) -> bytes:
        """What identifies the world: its file, or the digest of its initial string."""
        if self.read is None:
            return self.path.read_bytes()
        return self.read(self.given).world.scene.digest

    def world(self, overrides: Overrides) -> WorldFile:
        """The world of one run. Raises MinervaError."""
        read = self.read or partial(read_world_file, self.path)
        return prepared(read(overrides))

    def part(self, combination: Combination) -> Path:
        """The file of what was collected of one run."""
        # Values may have characters that a file name must not have. No value has a NUL, so no two
        # combinations give the same text.
        name = blake2b("\0".join(combination).encode(), digest_size=12).hexdigest()
        return Path(self.collect.into) / f"{name}.columns"

    @property
    def left(self) -> list[Combination]:
        """The combinations that have not run yet, or have failed."""
        return [c for c in self.grid if c not in self.rows or self.rows[c].error]

    def recall(self, journal: StudyJournal) -> None:
        """Take over the rows of a journal. Raises MisuseError for an invalid line."""
        # Line 1 describes the study.
        for number, line in enumerate(journal.lines, 2):
            try:
                row = _row(line)
                self.rows[row.combination] = row
            except (KeyError, TypeError, ValueError):
                raise invalid_line(journal.path, number) from None

    def check(self) -> None:
        """Read the world with the first combination. Raises MinervaError."""
        for combination in list(self.grid)[:1]:
            self.world(self.grid.overrides(combination, self.given))

    def run(self, pool: WorkerPool, journal: StudyJournal, on_row: Callable[[Row], None]) -> None:
        """Run the combinations that are left; `on_row` receives each result."""
        left = self.left

        def on_result(number: int, result: Result) -> None:
            seconds = round(result.seconds, 3)
            own = {"error": result.error, "seconds": seconds}
            line = {"set": list(left[number]), **result.values, **own}
            # The journal first: a run that it has is not repeated after a crash.
            journal.add(line)
            row = self.rows[left[number]] = _row(line)
            on_row(row)

        pool.run([self._task(combination) for combination in left], on_result)

    def _task(self, combination: Combination) -> Task:
        overrides = self.grid.overrides(combination, self.given)
        into = str(self.part(combination)) if self.collect.entries else ""

        def run() -> Mapping[str, Any]:
            file = replace(self.world(overrides), collect=replace(self.collect, into=into))
            return _run(file, self.in_process)

        return run

    @property
    def table(self) -> ResultTable:
        """The finished runs, in the order of the combinations."""
        return ResultTable.of(self.grid.keys, self._done)

    @property
    def failures(self) -> list[Row]:
        """The runs that failed."""
        return [row for row in self._done if row.error]

    @property
    def _done(self) -> list[Row]:
        return [self.rows[combination] for combination in self.grid if combination in self.rows]


def _run(file: WorldFile, in_process: bool) -> Mapping[str, Any]:
    """One run, as plain data. Raises MinervaError."""
    outcome = run_trial(file, in_process)
    own = {name: getattr(outcome, name) for name in OWN}
    return {"outcome": own, "figures": dict(outcome.figures)}


def _row(line: Mapping[str, Any]) -> Row:
    return Row(
        tuple(line["set"]),
        line.get("outcome", {}),
        line.get("figures", {}),
        str(line["error"]),
        float(line["seconds"]),
    )
