"""A sweep: runs of a world with all combinations of options, one run each.

Finished runs are in the journal beside the table, so a sweep that was killed continues where it
stopped. Runs that failed are repeated.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final, cast
from zlib import crc32

from minerva_bus.files import replacing
from minerva_bus.launch.in_process import never
from minerva_bus.launch.world_files import Collecting, WorldFile, read_world_file
from minerva_bus.settings.world_settings import Overrides
from minerva_study.grid import Combination, Grid
from minerva_study.journal import StudyJournal, invalid_line
from minerva_study.results import OWN, ResultTable, Row
from minerva_study.sent_branch import SentBranch
from minerva_study.sent_world import SentWorld
from minerva_study.trial import prepared, run_trial
from minerva_study.worker_pool import Result, TaskPool

COLLECTED: Final = "collected"
"""The key under which a trial returns the files of what it has collected."""


@dataclass(frozen=True, slots=True)
class SweepTrial:
    """The run of a combination; it collects into a file, or returns what it has collected."""

    read: Callable[[Overrides], WorldFile]
    overrides: Overrides
    collect: Collecting
    in_process: bool
    label: str = ""

    def __call__(self, interrupted: Callable[[], bool] = never) -> Mapping[str, Any]:
        """Run; returns plain data. Raises MinervaError."""
        if self.collect.into or not self.collect.entries:
            return self._run(self.collect, interrupted)
        with tempfile.TemporaryDirectory(prefix="minerva-trial-") as folder:
            values = self._run(replace(self.collect, into=f"{folder}/part.columns"), interrupted)
            parts = {path.name: path.read_bytes() for path in Path(folder).iterdir()}
        return {**values, COLLECTED: parts}

    def _run(self, collect: Collecting, interrupted: Callable[[], bool]) -> Mapping[str, Any]:
        file = replace(prepared(self.read(self.overrides)), collect=collect)
        outcome = run_trial(file, self.in_process, interrupted)
        own = {name: getattr(outcome, name) for name in OWN}
        return {"outcome": own, "figures": dict(outcome.figures)}


@dataclass(slots=True)
class Sweep:
    """Runs of the world in a file, or of one that `read` makes under the name of `path`.

    `rows` are those that are done. `collect` is collected of each run, into a file `part` in the
    folder `collect.into`. `identity` is that of the world (code_digests.py). With `sent`, runs read
    that world instead, in the workers of an executor.
    """

    path: Path
    grid: Grid
    given: Overrides
    in_process: bool = False
    read: Callable[[Overrides], WorldFile] | None = None
    collect: Collecting = field(default_factory=Collecting)
    identity: Mapping[str, Any] = field(default_factory=dict[str, Any])
    sent: SentWorld | SentBranch | None = None
    rows: dict[Combination, Row] = field(default_factory=dict[Combination, Row])

    @property
    def description(self) -> Mapping[str, Any]:
        """What makes two sweeps one study: the same world, options and end."""
        collected = {name: str(entry) for name, entry in self.collect.entries.items()}
        return {
            "world": self.path.stem,
            **self.identity,
            "keys": list(self.grid.keys),
            "options": dict(self.given.options),
            "settings": list(self.given.settings),
            "seed": self.given.values.get("seed"),
            "frames": self.given.values.get("frames"),
            **({"collect": collected} if collected else {}),
        }

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
        """Take over the rows of a journal. Raises MisuseError for an invalid line.

        A run whose files are missing or damaged, as after a power cut, is left to be repeated.
        """
        wanted = set(self.grid)  # The journal of a search has those of its earlier grids, too.
        # Line 1 describes the study.
        for number, line in enumerate(journal.lines, 2):
            try:
                row = _row(line, len(self.grid.keys))
                is_wanted = row.combination in wanted
                if is_wanted and line.get("parts", {}) == self._checksums(row.combination):
                    self.rows[row.combination] = row
            except (KeyError, TypeError, ValueError, OverflowError):
                raise invalid_line(journal.path, number) from None

    def check(self) -> None:
        """Read the world with the first combination. Raises MinervaError."""
        for combination in list(self.grid)[:1]:
            self.world(self.grid.overrides(combination, self.given))

    def run(self, pool: TaskPool, journal: StudyJournal, on_row: Callable[[Row], None]) -> None:
        """Run the combinations that are left; `on_row` receives each result."""
        left = self.left

        def on_result(number: int, result: Result) -> None:
            seconds, values = round(result.seconds, 3), dict(result.values)
            for name, content in values.pop(COLLECTED, {}).items():
                self._keep(left[number], name, content)
            own: dict[str, Any] = {"error": result.error, "seconds": seconds}
            if parts := self._checksums(left[number]):
                own["parts"] = parts
            line = {"set": list(left[number]), **values, **own}
            # The journal first: a run that it has is not repeated after a crash.
            journal.add(line)
            row = self.rows[left[number]] = _row(line, len(self.grid.keys))
            on_row(row)

        self._remove_parts(left)
        pool.run([self._trial(combination) for combination in left], on_result)

    def _checksums(self, combination: Combination) -> dict[str, int]:
        """The checksums of the files of what was collected of a run, by their names."""
        if not self.collect.entries:
            return {}
        part = self.part(combination)
        paths = part.parent.glob(f"{part.stem}*{part.suffix}")
        return {path.name: crc32(path.read_bytes()) for path in paths if path.is_file()}

    def _remove_parts(self, combinations: Sequence[Combination]) -> None:
        """Remove what runs of these combinations have collected before they were killed."""
        if self.collect.entries:
            stems = {self.part(combination).stem for combination in combinations}
            for path in Path(self.collect.into).iterdir():
                # Each table has a file of its own.
                if path.stem.partition("-")[0] in stems and not path.is_dir():
                    path.unlink()

    def _trial(self, combination: Combination) -> SweepTrial:
        overrides = self.grid.overrides(combination, self.given)
        into = str(self.part(combination)) if self.collect.entries and self.sent is None else ""
        collect = replace(self.collect, into=into)
        if self.sent is not None:
            name = self._name(combination)
            return SweepTrial(self.sent, overrides, collect, in_process=True, label=name)
        read = self.read or partial(read_world_file, self.path)
        return SweepTrial(read, overrides, collect, self.in_process)

    def _keep(self, combination: Combination, name: str, content: bytes) -> None:
        """Write what a worker has collected, under the name that a local run gives it."""
        part = self.part(combination)
        path = part.with_name(part.stem + Path(name).name.removeprefix("part"))
        with replacing(path, durable=True) as file:
            file.write(content)

    def named(self, row: Row) -> str:
        """The parameters of a run: `birds=100, seed=3`."""
        return self._name(row.combination)

    def _name(self, combination: Combination) -> str:
        pairs = zip(self.grid.keys, combination, strict=True)
        return ", ".join(f"{key}={value}" for key, value in pairs)

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


_TYPES: Final = {"frames": int, "digest": str, "ended": str, "reached": bool}
"""Types of the values in an outcome; a run that failed has none."""


def _row(line: Mapping[str, Any], keys: int) -> Row:
    """The row of a line in a journal. Raises KeyError, TypeError, ValueError and OverflowError."""
    combination, figures = (
        cast("list[str]", line["set"]),
        cast("dict[str, Any]", line.get("figures", {})),
    )
    outcome: dict[str, object] = dict(line.get("outcome", {}))
    error, seconds = line["error"], line["seconds"]
    texts = all(isinstance(value, str) for value in (*combination, error))
    kinds = {name: type(value) for name, value in outcome.items()}
    whole = kinds == ({} if error else _TYPES)
    listed = type(combination) is list and len(combination) == keys
    if not (texts and whole and listed and type(figures) is dict):
        raise TypeError("not a row")
    return Row(tuple(combination), outcome, figures, error, float(seconds))
