"""`minerva mcp` with its options; what it does is imported when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.options import Json, NamedTarget, by_comma, examples, grouped

TOPIC: Final = "Observe"


@examples(
    "minerva mcp robot",
    "minerva mcp robot --allow control,publish --listen 127.0.0.1:8765",
)
@grouped
def mcp(
    allow: Annotated[
        list[str] | None,
        typer.Option(
            help="Permit tools that change something: control, publish, run; separated by commas.",
        ),
    ] = None,
    listen: Annotated[
        str, typer.Option(help="Serve HTTP at HOST:PORT, not standard input and output.")
    ] = "",
    folder: Annotated[
        Path, typer.Option(help="Folder of the records, tables and world files for tools.")
    ] = Path(),
    code: Annotated[
        str,
        typer.Option(
            help="World file or installed world with the agents' code, for pictures; default: the"
            " installed world of this name.",
            autocompletion=completing.worlds,
        ),
    ] = "",
    json: Json = False,
    *,
    target: NamedTarget,
) -> None:
    """Serve a running world to assistants.

    The protocol is MCP, the Model Context Protocol. Nothing is changed without --allow.
    """
    from minerva_assistants.mcp.assistant_server import serve_assistants

    serve_assistants(target, by_comma(allow), listen, folder, code, json)
