"""`minerva map`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.options import Force, Json, examples

TOPIC: Final = "Records"


@examples(
    "minerva map run.log",
    "minerva map scans.mcap --output house.pgm --cell 0.1",
)
def map(
    file: Annotated[
        Path,
        typer.Argument(
            help="A CARMEN log or a bag: .log, .bag, .db3, .mcap.",
            autocompletion=completing.recordings,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="The .pgm file; default: named after FILE."),
    ] = None,
    cell: Annotated[float, typer.Option(help="Side of a cell, metres.")] = 0.05,
    range_: Annotated[
        float,
        typer.Option("--range", help="Ignore hits beyond this range, metres; 0: as recorded."),
    ] = 0.0,
    from_: Annotated[
        float, typer.Option("--from", help="Start, seconds after the beginning.")
    ] = 0.0,
    to: Annotated[float | None, typer.Option(help="End, seconds after the beginning.")] = None,
    poses: Annotated[
        str, typer.Option(help="Source of the robot's poses: published, odometry or matched.")
    ] = "published",
    time_offset: Annotated[
        float,
        typer.Option(help="Seconds to add to scan times, if the lidar's clock differs."),
    ] = 0.0,
    json: Json = False,
    force: Force = False,
) -> None:
    """Draw the occupancy map of a recording.

    It writes a .pgm, a .yaml and a picture.
    """
    from minerva_agents.robot.map_recording import map_recording

    map_recording(file, output, cell, range_, from_, to, poses, time_offset, as_json=json)
