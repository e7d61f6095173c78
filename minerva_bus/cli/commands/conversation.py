"""`minerva conversation`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minerva_bus.cli.options import (
    Force,
    Json,
)

Record = Annotated[Path, typer.Argument(help="A record, .mcap.")]

EXAMPLES = (
    "minerva conversation talk.mcap",
    "minerva conversation talk.mcap --output talk.mmd",
)


def command(
    file: Record,
    conversation: Annotated[
        str, typer.Option(help="Show only the conversation with this id.")
    ] = "",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A .svg, or a .mmd for Mermaid.")
    ] = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Draw the messages between agents as a sequence diagram.

    Without --output it prints the diagram as Mermaid text.
    """
    from minerva_bus.cli.conversing import show_conversation

    show_conversation(file, conversation, output, json)
