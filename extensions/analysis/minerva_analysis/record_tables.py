"""Tables of a record: what was not collected while its world ran. `minerva export` calls this."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from minerva_analysis.frame_texts import missing_frame
from minerva_analysis.table_files import TableFiles
from minerva_bus.api.running import pick_table
from minerva_bus.collect.collector import Collector
from minerva_bus.collect.data_tables import Data, DataTable, Gathered, Writer
from minerva_bus.collect.plans import (
    COLUMN_TYPES,
    TablePlan,
    fields_of,
    own_columns,
    plans_of,
    read_entries,
)
from minerva_bus.errors import MisuseError, RecordError
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.log.record import Cursor, Record
from minerva_bus.values import path_of, whole_number

Progress = Callable[[int, int], None]
_END: Final = 1 << 62


@dataclass(frozen=True)
class Export:
    """Tables of a record.

    Attributes:
        record: the file.
        first, last: the first and last frame of which there may be rows.
        complete: whether the recorded run ended normally.
        missing: ranges of frames in between that are not in the record.
        rows: the number of rows, by table.
        files: the files, by table; empty without `into`.
        tables: the tables in memory, by name; empty with `into`.

    """

    record: Path
    first: int
    last: int
    complete: bool
    missing: tuple[range, ...]
    rows: Mapping[str, int]
    files: Mapping[str, Path] = field(default_factory=dict[str, Path])
    tables: Mapping[str, DataTable] = field(default_factory=dict[str, DataTable], repr=False)

    def table(self, name: str = "") -> DataTable:
        """A table in memory; `name` as for `Run.table`. Raises MisuseError."""
        return pick_table(self.tables, name, ", ".join(map(str, self.files.values())))

    def plain(self) -> dict[str, Any]:
        """A summary as a JSON object."""
        return {
            "record": str(self.record),
            "frames": [self.first, self.last],
            "complete": self.complete,
            "missing": [[frames.start, frames.stop - 1] for frames in self.missing],
            "tables": {
                name: {"rows": rows, "file": str(self.files.get(name, ""))}
                for name, rows in self.rows.items()
            },
        }


def export(
    record: str | Path,
    *,
    collect: Any = None,
    into: str | Path = "",
    begin: int = 0,
    end: int | None = None,
    every: int = 1,
    progress: Progress | None = None,
) -> Export:
    """Make tables of a record, equal to those that `run` collects with the same expressions.

    It runs none of the world's code, and reads frame by frame in bounded memory.

    Args:
        record: the file, .mcap.
        collect: expressions by name, as for `run`, in Python or as texts:
            `{"sick": "count(APerson, sick == true)"}`. Default: a table for each agent kind with
            all its attributes, and one for each event type.
        into: a .parquet or .csv file; several tables go into several files, `FILE-TABLE.parquet`.
            Default: in memory.
        begin: the first frame.
        end: the last frame; default: the end of the record.
        every: frames from one row to the next, for expressions that do not say so.
        progress: called with the number of frames done and the total.

    Raises:
        RecordError: the record cannot be read, or has no such frame.
        VocabularyError: an expression names what the world does not have, with a caret.
        MisuseError: the file cannot be written.

    Example:
        >>> export("run.mcap", collect={"x": Person.x}).table("x").to_pandas()

    """
    begin = whole_number("begin", begin)
    end = None if end is None else whole_number("end", end)
    with Record(path_of("record", record)) as opened, ExitStack() as stack:
        plans = read_plans(collect, opened.description.world.vocabulary, every)
        if into:
            files = stack.enter_context(
                TableFiles(path_of("into", into), several=len(plans) > 1, sparse=collect is None)
            )
            return replace(
                export_plans(opened, plans, files.open, begin, end, progress), files=files.files
            )
        gathered = {plan.name: Gathered(plan.name, plan.columns) for plan in plans}
        done = export_plans(opened, plans, lambda plan: gathered[plan.name], begin, end, progress)
        tables = {name: rows.table for name, rows in gathered.items()}
        # Of a vocabulary, most event types may never have occurred.
        kept = {name: table for name, table in tables.items() if collect is not None or len(table)}
        return replace(done, tables=kept)


def read_plans(
    collect: Any, vocabulary: Vocabulary, every: int = 1, option: str = "collect:"
) -> list[TablePlan]:
    """The tables for `collect`, as `export` takes it. Raises MisuseError and VocabularyError."""
    whole_number("every", every, 1)
    if collect is None:
        return _whole_plans(vocabulary, every)
    entries = {
        name: entry if entry.interval > 1 else entry.every(every)
        for name, entry in read_entries(collect).items()
    }
    if not entries:
        raise MisuseError("nothing to collect: give at least one expression")
    return plans_of(entries, vocabulary, option)


def export_plans(
    record: Record,
    plans: list[TablePlan],
    open_table: Callable[[TablePlan], Writer],
    begin: int = 0,
    end: int | None = None,
    progress: Progress | None = None,
) -> Export:
    """Write the rows of these tables; see `export`. Raises RecordError and MisuseError."""
    length = record.last()[0]
    last = length if end is None else min(end, length)
    if not 0 <= begin <= last:
        raise RecordError(missing_frame(record.path, length, begin))
    counts: dict[str, _Counting] = {}

    def open_counted(plan: TablePlan) -> Writer:
        counts[plan.name] = _Counting(open_table(plan))
        return counts[plan.name]

    world, missing = record.description.world, list[range]()
    collector = Collector(plans, world.vocabulary, world.dt, open_counted)
    cursor = Cursor(record)
    cursor.skip_to(begin)
    if cursor.number >= begin:
        collector.begin(cursor.number, cursor.scene)
    while (frame := cursor.ahead) is not None and frame.number <= last:
        if frame.number > cursor.number:
            missing.append(range(max(begin, cursor.number), frame.number))
            collector.drop_unfinished()
            if cursor.settle():
                collector.begin(cursor.number, cursor.scene)
        collector.end(frame.number, frame.events)
        cursor.advance()
        if cursor.number <= last:
            collector.begin(cursor.number, cursor.scene)
        if progress is not None:
            progress(frame.number - begin, last - begin)
    # The events of the last frame are lost with it, if there are later ones.
    if frame is not None and cursor.number <= last:
        missing.append(range(cursor.number, last + 1))
        collector.drop_unfinished()
    collector.close(cursor.closing_events() if frame is None and cursor.number <= last else ())
    rows = {name: counting.count for name, counting in counts.items()}
    return Export(record.path, begin, last, record.complete, tuple(missing), rows)


class _Counting:
    """Passes rows on and counts them."""

    def __init__(self, writer: Writer) -> None:
        self.count = 0
        self._writer = writer

    def row(self, values: Mapping[str, Any]) -> None:
        self.count += 1
        self._writer.row(values)

    def rows(self, columns: Mapping[str, Data]) -> None:
        self.count += len(next(iter(columns.values())))
        self._writer.rows(columns)

    def close(self) -> None:
        self._writer.close()


def _whole_plans(vocabulary: Vocabulary, interval: int) -> list[TablePlan]:
    """A table for each agent kind and event type, with all data that fit into columns.

    Attributes that are not a number, bool or text, such as grids, have no column.
    """
    plans: list[TablePlan] = []
    for symbol in sorted({*vocabulary.kinds, *vocabulary.events}):
        types = {
            field.name: COLUMN_TYPES[field.type.kind]
            for field in fields_of(vocabulary, symbol).all
            if field.type.kind in COLUMN_TYPES
        }
        own = own_columns(symbol)
        # An attribute may have the name of a column such as `id`.
        names = {f"{name}_" if name in own else name: name for name in types}
        columns = own | {column: types[name] for column, name in names.items()}
        plans.append(TablePlan(symbol, interval, columns, symbol, names=names))
    return plans
