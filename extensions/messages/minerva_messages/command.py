"""`minerva conversation` with its options; what it does is imported when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from minerva_bus.cli.options import Force, Json, Record, examples

TOPIC: Final = "Records"


@examples(
    "minerva conversation talk.mcap",
    "minerva conversation talk.mcap --output talk.mmd",
)
def conversation(
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
    from minerva_messages.conversation_diagram import show_conversation

    show_conversation(file, conversation, output, json)
