"""`minerva export`: tables of a record, or data sets of records for other tools."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from minerva_analysis.record_tables import Export, export_plans, read_plans
from minerva_analysis.table_files import TableFiles
from minerva_bus.cli.output import (
    print_answer,
    print_json,
    print_message,
    print_result,
)
from minerva_bus.collect.data_tables import CsvWriter
from minerva_bus.collect.plans import TablePlan, parse_entries
from minerva_bus.errors import MisuseError
from minerva_bus.files import check_ending, note_read
from minerva_bus.launch.console import progress_bar
from minerva_bus.log.record import Record
from minerva_bus.wording import counted
from minerva_exporters.datasets import export_dataset

if TYPE_CHECKING:
    from minerva_exporters.command import ExportTargets


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """The options of the command line, besides where to write."""

    collect: tuple[str, ...]
    begin: int
    end: int | None
    every: int
    as_json: bool = False
    quiet: bool = False


def export_records(files: Sequence[Path], targets: ExportTargets, options: ExportOptions) -> None:
    """Write tables or a data set. Raises RecordError, VocabularyError and MisuseError."""
    chosen = [
        each.name for each in fields(targets) if isinstance(getattr(targets, each.name), Path)
    ]
    if len(chosen) > 1:
        raise MisuseError(f"{' and '.join(f'--{name}' for name in chosen)} exclude each other")
    form = chosen[0] if chosen else ""
    if (targets.agents or targets.act) and form != "lerobot":
        raise MisuseError("--agents and --act require --lerobot")
    if form in _TABLES or not form:
        if len(files) > 1:
            raise MisuseError(
                f"tables are of one record, not {len(files)}; export each record, and name its"
                " table: --csv FILE.csv"
            )
        _export_tables(files[0], getattr(targets, form) if form else None, form, options)
    else:
        _export_dataset(files, targets, form, options)


def _export_dataset(
    files: Sequence[Path], targets: ExportTargets, form: str, options: ExportOptions
) -> None:
    if options.collect:
        raise MisuseError(f"--collect is for tables; --{form} has all data of the record")
    with progress_bar("export", quiet=options.quiet) as progress:
        done = export_dataset(
            files, getattr(targets, form), form, begin=options.begin, end=options.end,
            every=options.every, agents=targets.agents or (), act=targets.act or (),
            progress=progress,
        )  # fmt: skip
    if options.as_json or not options.quiet:
        print_answer(done, options.as_json)


_TABLES: Final = ("csv", "parquet")


def _export_tables(file: Path, into: Path | None, form: str, options: ExportOptions) -> None:
    if into is not None:
        check_ending(into, (f".{form}",), "table")
    if options.as_json and into is None:
        raise MisuseError("--json needs --csv or --parquet: else standard output has the table")
    entries = parse_entries(options.collect) if options.collect else None
    note_read(file)
    with Record(file) as record:
        plans = read_plans(entries, record.description.world.vocabulary, options.every, "--collect")
        done = _written(record, plans, into, options)
    _report(done, options)


def _written(
    record: Record, plans: list[TablePlan], into: Path | None, options: ExportOptions
) -> Export:
    if into is None:
        if len(plans) > 1:
            raise MisuseError(
                f"these are several tables ({', '.join(plan.name for plan in plans)}): write them"
                " with --csv FILE or --parquet FILE, or choose one with --collect"
            )
        writer = CsvWriter(sys.stdout, plans[0].columns)
        # The rows may be on the same terminal as a progress bar.
        with progress_bar("export", quiet=options.quiet or sys.stdout.isatty()) as progress:
            return export_plans(
                record, plans, lambda _: writer, options.begin, options.end, progress
            )
    with (
        TableFiles(into, several=len(plans) > 1, sparse=not options.collect) as files,
        progress_bar("export", quiet=options.quiet) as progress,
    ):
        done = export_plans(record, plans, files.open, options.begin, options.end, progress)
        return replace(done, files=files.files)


def _report(done: Export, options: ExportOptions) -> None:
    if not options.quiet:
        if not done.complete:
            print_message(f"{done.record} ends before its run did; the last row is of its end")
        if done.missing:
            gaps = ", ".join(f"{gap.start} to {gap.stop - 1}" for gap in done.missing[:5])
            print_message(f"{done.record} lacks the frames {gaps}; their rows are missing")
    if options.as_json:
        print_json(done.plain())
    elif not options.quiet:
        for name, path in done.files.items():
            print_result(f"{path}  {name}  {counted(done.rows[name], 'row')}")
