"""`minerva metrics`."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Keys, World, chosen

Named = Annotated[str, typer.Argument(metavar="[WORLD]", help="As --world.")]

EXAMPLES = (
    "minerva metrics",
    "minerva metrics robot --listen 0.0.0.0:9464",
)


def command(
    name: Named = "",
    listen: Annotated[str, typer.Option(help="Serve at HOST:PORT.")] = "127.0.0.1:9464",
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
) -> None:
    """Serve /metrics, /live and /ready of a running world.

    The server is a separate process.
    """
    from minerva_bus.cli.measuring import serve_metrics

    serve_metrics(listen, connect, chosen(name, world))
