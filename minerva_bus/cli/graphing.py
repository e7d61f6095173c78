"""`minerva graph`."""

from __future__ import annotations

from pathlib import Path

from minerva_bus.api.graphs import check_drawable, graph_of
from minerva_bus.cli.output import print_json, print_result
from minerva_bus.cli.running import read_world
from minerva_bus.settings.overrides import Overrides


def show_graph(world: str, overrides: Overrides, outputs: list[Path], as_json: bool) -> None:
    """Print the graph of a world as Mermaid or JSON, or draw it into files.

    Raises WorldFileError and SceneError, and MisuseError for a file that cannot be written.
    """
    for output in outputs:
        check_drawable(output)
    made = graph_of(read_world(world, overrides))
    for output in outputs:
        made.save(output)
    if as_json:
        print_json(made.plain())
    else:
        print_result("\n".join(map(str, outputs)) if outputs else made.mermaid().rstrip())
