"""`minerva export`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.options import Collect, Force, Json, Quiet, examples, grouped

TOPIC: Final = "Records"


@dataclass(frozen=True, slots=True)
class ExportTargets:
    """What `minerva export` writes, and where: a file or folder, or standard output."""

    csv: Annotated[
        Path | None, typer.Option(help="Write .csv files; default: standard output.")
    ] = None
    parquet: Annotated[Path | None, typer.Option(help="Write .parquet files.")] = None
    rosbag: Annotated[Path | None, typer.Option(help="Write a bag of ROS 2 into a folder.")] = None
    rerun: Annotated[Path | None, typer.Option(help="Write an .rrd file for Rerun.")] = None
    lerobot: Annotated[
        Path | None, typer.Option(help="Write a data set of LeRobot into a folder.")
    ] = None
    agents: Annotated[
        list[str] | None,
        typer.Option(help="With --lerobot: a kind or an id; each life is an episode."),
    ] = None
    act: Annotated[
        list[str] | None,
        typer.Option(help="With --lerobot: an event type or attribute that is the action."),
    ] = None


@examples(
    "minerva export run.mcap --collect 'sick=count(APerson, sick == true)' > sick.csv",
    "minerva export run.mcap --parquet run.parquet --every 10",
    "minerva export run.mcap --rosbag run_bag",
    "minerva export a.mcap b.mcap --lerobot drives --agents ARobot --act action",
)
@grouped
def export(
    files: Annotated[
        list[Path], typer.Argument(help="Records, .mcap.", autocompletion=completing.records)
    ],
    targets: ExportTargets,
    collect: Collect = None,
    begin: Annotated[int, typer.Option("--from", help="First frame.", min=0)] = 0,
    to: Annotated[int | None, typer.Option(help="Last frame; default: the end.", min=0)] = None,
    every: Annotated[
        int, typer.Option(help="Frames per row, if an expression does not set it.", min=1)
    ] = 1,
    json: Json = False,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Export a record as tables, or in the format of another tool.

    Tables: without --collect, all attributes of agents, a table for each kind, and all events.
    Expressions are those of [collect] in world files. Several tables go into several files,
    FILE-TABLE.csv. --rosbag, --rerun and --lerobot write poses, sensor data and events. No code of
    the world is run.
    """
    from minerva_exporters.export_command import ExportOptions, export_records

    options = ExportOptions(tuple(collect or ()), begin, to, every, json, quiet)
    export_records(tuple(files), targets, options)
