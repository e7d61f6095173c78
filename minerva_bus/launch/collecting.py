"""Data collected of a run: the table [collect] of a world file, and its sink."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from minerva_bus.errors import MisuseError, WorldFileError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.table import Table
from minerva_bus.runtime.runner import Sink
from minerva_bus.settings.kinds import TEXT
from minerva_bus.settings.tables import CollectSettings
from minerva_bus.world.expressions import Expression, read_expression

if TYPE_CHECKING:
    from minerva_bus.collect.parts import TableParts
    from minerva_bus.collect.plans import TablePlan
    from minerva_bus.collect.table import DataTable
    from minerva_bus.collect.writers import Writer


ENDINGS: Final = (".parquet", ".csv")
SAVE_SECONDS: Final = 5.0
"""Time after which rows are written that still wait for more."""


@dataclass(frozen=True, slots=True)
class Collecting:
    """Data to collect of a run, by name, and their file ("": in memory)."""

    entries: Mapping[str, Expression] = field(default_factory=dict[str, Expression])
    into: str = ""


def read_collecting(top: Table, vocabulary: Vocabulary) -> Collecting:
    """The table [collect], or the expressions of the command line in its place.

    Raises WorldFileError, MisuseError and VocabularyError.
    """
    into = top.read(CollectSettings).into
    entries: Mapping[str, Expression] = _written(top.table("collect"), vocabulary)
    if top.overrides.collect:
        entries = _given(top.overrides.collect, into, vocabulary)
    if into and not entries:
        raise WorldFileError(
            "nothing is collected: name expressions with --collect 'birds=count(ABird)', or under"
            ' [collect], such as birds = "count(ABird)"'
        )
    # Checked here, because the coordinator would only report it after the start of the world.
    if into and Path(into).suffix not in ENDINGS:
        top.wrong_setting(CollectSettings, "into", f"must end with {' or '.join(ENDINGS)}: {into}")
    return Collecting(entries, into)


def _written(table: Table, vocabulary: Vocabulary) -> dict[str, Expression]:
    """The expressions of a world file. Raises VocabularyError."""
    entries: dict[str, Expression] = {}
    for name in [key for key in table.data if key != "into"]:
        source = table.place(name)
        entries[name] = read_expression(table.get(name, TEXT, ""), source)
        entries[name].checked(vocabulary, source)
    return entries


def _given(words: tuple[str, ...], into: str, vocabulary: Vocabulary) -> Mapping[str, Expression]:
    """The expressions of a command line. Raises MisuseError and VocabularyError."""
    from minerva_bus.collect.plans import parse_entries, plans_of

    for word in words:
        if "=" not in word and word.endswith(ENDINGS):
            raise MisuseError(f"--collect takes NAME=EXPRESSION; name the file by --into {word}")
    entries = parse_entries(words)
    # The plans are made for their checks: errors appear here, before any process starts.
    plans_of(entries, vocabulary, "--collect")
    # Without a file, only a program in Python receives the tables.
    if not into:
        raise MisuseError("--collect needs a file for its tables: --into FILE.csv or FILE.parquet")
    return entries


class CollectSink(Sink):
    """Collects the frames of an algorithm, beginning with the string that it has now.

    `say` is called with a line for the user. `again`: this coordinator succeeds one that was
    killed, and is going to repeat the frames of its journal: it continues the tables. Raises
    MisuseError and VocabularyError.
    """

    def __init__(
        self,
        collecting: Collecting,
        algorithm: FrameAlgorithm,
        say: Callable[[str], None],
        *,
        again: bool = False,
    ) -> None:
        from minerva_bus.collect.collector import Collector
        from minerva_bus.collect.history import SeriesHistory
        from minerva_bus.collect.plans import plans_of
        from minerva_bus.collect.table import Gathered

        world = algorithm.world
        plans = plans_of(collecting.entries, world.vocabulary)
        self._gathered: dict[str, Gathered] = {}
        into, frame = collecting.into, algorithm.frame
        self._parts = _parts(Path(into), plans, frame, say, again=again) if into else None

        self.history = SeriesHistory(plans, world.vocabulary)

        def open_table(plan: TablePlan) -> Writer:
            if self._parts is not None:
                return self.history.watched(plan, self._parts.open(plan))
            gathered = self._gathered[plan.name] = Gathered(plan.name, plan.columns)
            return self.history.watched(plan, gathered)

        self._algorithm = algorithm
        self._saved_at = time.monotonic()
        self.collector = Collector(plans, world.vocabulary, world.dt, open_table)
        self.collector.begin(algorithm.frame, algorithm.scene)

    def frame_done(self, notice: s.FrameDone) -> None:
        """Collect the data of a frame that has ended."""
        self.collector.done(notice.frame, notice.events, self._algorithm.scene)
        if time.monotonic() >= self._saved_at + SAVE_SECONDS:
            self.save()

    def save(self) -> None:
        """Write the rows so far, so that they survive this process."""
        if self._parts is not None:
            self._parts.save()
        self._saved_at = time.monotonic()

    def close(self) -> None:
        """Finish all tables."""
        self.collector.close(self._algorithm.closing_events)
        if self._parts is not None:
            self._parts.join()

    @property
    def tables(self) -> dict[str, DataTable]:
        """The tables in memory, by name; empty if they go into a file."""
        return {name: gathered.table for name, gathered in self._gathered.items()}


def _parts(
    path: Path, plans: Sequence[TablePlan], frame: int, say: Callable[[str], None], *, again: bool
) -> TableParts:
    """The parts of a run's tables, or those of the killed coordinator `again`."""
    from minerva_bus.collect.parts import TableParts, has_parts

    tables = {plan.name: plan.columns for plan in plans}
    if again and has_parts(path, tables):
        return TableParts(path, tables, again=True)
    # A world that was stopped and continues has finished its former tables.
    if again and frame:
        path = path.with_name(f"{path.stem}-from-{frame}{path.suffix}")
        say(f"the data collected from frame {frame} on are in {path}")
        return TableParts(path, tables, again=has_parts(path, tables))
    return TableParts(path, tables)


def check_tables(into: str) -> None:
    """Raise MisuseError if there are tables of a killed run, which this one would not continue."""
    from minerva_bus.collect.parts import check_no_parts

    if into:
        check_no_parts(Path(into))


def complete_tables(into: str, say: Callable[[str], None]) -> None:
    """Join the parts that a run has left because its last coordinator was killed or failed."""
    from minerva_bus.collect.parts import has_parts, parts_of, read_parts

    path = Path(into)
    if into and has_parts(path):
        files = read_parts(parts_of(path)).join()
        say(f"the data collected up to the end are in {', '.join(map(str, files.values()))}")


def collect_sink(
    collecting: Collecting,
    algorithm: FrameAlgorithm,
    say: Callable[[str], None],
    *,
    again: bool = False,
) -> CollectSink | None:
    """The sink that collects data; None if there are none to collect."""
    if not collecting.entries:
        return None
    return CollectSink(collecting, algorithm, say, again=again)
