"""`minerva plot`: pictures of records and of tables."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from minerva_analysis.plotting import check_picture
from minerva_analysis.record_plot import plot
from minerva_analysis.record_tables import export, read_plans
from minerva_analysis.series_plot import plot_table
from minerva_analysis.tables import read_table
from minerva_bus.cli.output import Done, print_answer
from minerva_bus.collect.data_tables import DataTable
from minerva_bus.collect.plans import parse_entries, series_of
from minerva_bus.errors import MisuseError
from minerva_bus.files import ending_of
from minerva_bus.launch.console import progress_bar
from minerva_bus.log.record import Record

_TABLES: Final = (".csv", ".parquet")


def plot_file(
    file: Path,
    output: Path | None,
    collect: tuple[str, ...],
    series: str,
    x: str,
    *,
    bars: bool,
    as_json: bool,
) -> None:
    """Plot a record or a table to a file. Raises RecordError, MisuseError and VocabularyError."""
    into = output or file.with_suffix(".png")
    names = tuple(name.strip() for name in series.split(",") if name.strip())
    # Before the file is read, which may take long.
    check_picture(into)
    if ending_of(file) in _TABLES:
        if collect:
            raise MisuseError(f"--collect is of records; {file} is a table: choose with --series")
        plot_table(read_table(file), names, x, bars=bars).save(into)
    elif collect:
        table, units = _collected(file, collect)
        plot_table(table, names, x, units, bars=bars).save(into)
    elif names or x or bars:
        raise MisuseError("--series, --x and --bars need a table, or a record with --collect")
    else:
        with Record(file) as record:
            plot(record, into)
    print_answer(Done(str(into), {"picture": str(into)}), as_json)


def _collected(file: Path, collect: tuple[str, ...]) -> tuple[DataTable, dict[str, str]]:
    """The table of expressions about a record, and the units of its columns."""
    entries = parse_entries(collect)
    with Record(file) as record:
        vocabulary = record.description.world.vocabulary
    plans = read_plans(entries, vocabulary, option="--collect")
    if len(plans) > 1:
        raise MisuseError(
            f"these are several tables ({', '.join(plan.name for plan in plans)}); plot one at a"
            " time"
        )
    with progress_bar("plot") as progress:
        table = export(file, collect=entries, progress=progress).table(plans[0].name)
    units = series_of(plans[0], vocabulary)
    if plans[0].symbol:
        every = [*vocabulary.kinds.values(), *vocabulary.events.values()]
        fields = next(each.fields for each in every if each.name == plans[0].symbol)
        own = {field.name: field.type.unit for field in fields.all}
        units |= {column: own[name] for column, name in plans[0].names.items()}
    return table, units
