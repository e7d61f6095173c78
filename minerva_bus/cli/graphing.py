"""`minerva graph`."""

from __future__ import annotations

from pathlib import Path

from minerva_bus.api.graphs import check_writable, graph_of
from minerva_bus.cli.output import print_json, print_result
from minerva_bus.cli.running import read_world
from minerva_bus.settings.overrides import Overrides


def show_graph(world: str, overrides: Overrides, output: Path | None, as_json: bool) -> None:
    """Print the graph of a world as Mermaid or JSON, or write it to a file.

    Raises WorldFileError and SceneError, and MisuseError for a file that cannot be written.
    """
    if output is not None:
        check_writable(output)
    made = graph_of(read_world(world, overrides))
    if output is not None:
        made.save(output)
    if as_json:
        print_json(made.plain())
    else:
        print_result(made.mermaid().rstrip() if output is None else str(output))
