"""`minerva plot` with its options; what it does is imported when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from minerva_bus.cli.options import Collect, Force, Json, examples

TOPIC: Final = "Records"


@examples(
    "minerva plot run.mcap --output run.pdf",
    "minerva plot run.mcap --collect 'mean(APerson.days)' --collect 'count(APerson)'",
    "minerva plot sir.parquet --series sick,immune",
)
def plot(
    file: Annotated[Path, typer.Argument(help="A record, .mcap, or a table, .parquet or .csv.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A .png, .svg or .pdf.")
    ] = None,
    collect: Collect = None,
    series: Annotated[
        str, typer.Option(help="Columns to plot, separated by commas; default: all.")
    ] = "",
    x: Annotated[str, typer.Option(help="Column along the axis; default: time or frame.")] = "",
    bars: Annotated[
        bool, typer.Option("--bars", help="Histograms of the last frame, not over time.")
    ] = False,
    json: Json = False,
    force: Force = False,
) -> None:
    """Plot trajectories of a run, or collected series.

    Of a table, and of a record with --collect, it plots series and histograms over time: the mean
    over seeds or agents, with a band for the middle 80 % of them.
    """
    from minerva_analysis.plot_command import plot_file

    plot_file(file, output, tuple(collect or ()), series, x, bars=bars, as_json=json)
