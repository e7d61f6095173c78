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
    """Show the messages between agents as a sequence diagram (Mermaid)."""
    from minerva_bus.cli.conversing import show_conversation

    show_conversation(file, conversation, output, json)
