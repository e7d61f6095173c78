"""`minerva export`: tables of a record as .csv or .parquet."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

from minerva_bus.api.exporting import Export, export_plans, read_plans
from minerva_bus.cli.output import print_json, print_message, print_result
from minerva_bus.cli.progress import progress_bar
from minerva_bus.collect.drafts import TableFiles
from minerva_bus.collect.plans import TablePlan, parse_entries
from minerva_bus.collect.writers import CsvWriter
from minerva_bus.errors import MisuseError
from minerva_bus.log.reader import Record
from minerva_bus.outputs import note_read
from minerva_bus.wording import counted


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """The options of the command line."""

    collect: tuple[str, ...]
    csv: Path | None
    parquet: Path | None
    begin: int
    end: int | None
    every: int


def export_record(file: Path, options: ExportOptions, as_json: bool, quiet: bool) -> None:
    """Write the tables of a record. Raises RecordError, VocabularyError and MisuseError."""
    if options.csv and options.parquet:
        raise MisuseError("--csv and --parquet exclude each other")
    for path, ending in ((options.csv, ".csv"), (options.parquet, ".parquet")):
        if path is not None and path.suffix != ending:
            raise MisuseError(f"{path}: expected a file name that ends with {ending}")
    if as_json and not (options.csv or options.parquet):
        raise MisuseError("--json needs --csv or --parquet: else standard output has the table")
    entries = parse_entries(options.collect) if options.collect else None
    note_read(file)
    with Record(file) as record:
        plans = read_plans(entries, record.description.world.vocabulary, options.every, "--collect")
        done = _written(record, plans, options, quiet=quiet)
    _report(done, as_json, quiet)


def _written(
    record: Record, plans: list[TablePlan], options: ExportOptions, *, quiet: bool
) -> Export:
    into = options.csv or options.parquet
    if into is None:
        if len(plans) > 1:
            raise MisuseError(
                f"these are several tables ({', '.join(plan.name for plan in plans)}): write them"
                " with --csv FILE or --parquet FILE, or choose one with --collect"
            )
        writer = CsvWriter(sys.stdout, plans[0].columns)
        # The rows may be on the same terminal as a progress bar.
        with progress_bar("export", quiet=quiet or sys.stdout.isatty()) as progress:
            return export_plans(
                record, plans, lambda _: writer, options.begin, options.end, progress
            )
    with (
        TableFiles(into, several=len(plans) > 1, sparse=not options.collect) as files,
        progress_bar("export", quiet=quiet) as progress,
    ):
        done = export_plans(record, plans, files.open, options.begin, options.end, progress)
        return replace(done, files=files.files)


def _report(done: Export, as_json: bool, quiet: bool) -> None:
    if not quiet:
        if not done.complete:
            print_message(f"{done.record} ends before its run did; the last row is of its end")
        if done.missing:
            gaps = ", ".join(f"{gap.start} to {gap.stop - 1}" for gap in done.missing[:5])
            print_message(f"{done.record} lacks the frames {gaps}; their rows are missing")
    if as_json:
        print_json(done.plain())
    elif not quiet:
        for name, path in done.files.items():
            print_result(f"{path}  {name}  {counted(done.rows[name], 'row')}")
