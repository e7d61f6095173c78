"""`minerva conversation`: the messages between agents in a record, as a sequence diagram."""

from __future__ import annotations

from pathlib import Path

from minerva_bus.cli.output import print_json, print_result
from minerva_bus.files import check_ending, check_output, ending_of, write_output
from minerva_bus.log.record import Record
from minerva_messages.exchanges import Exchange, check_drawable, exchange_of


def show_conversation(file: Path, conversation: str, output: Path | None, as_json: bool) -> None:
    """Print a record's messages as Mermaid or JSON, or draw them into a file.

    Raises RecordError, and MinervaError for a file that cannot be written.
    """
    if output is not None:
        check_ending(output, (".svg", ".mmd"), "conversation")
        check_output(output, "conversation")
    with Record(file) as record:
        exchange = exchange_of(record, conversation)
        if output is not None or not as_json:
            check_drawable(record, exchange)
    if output is not None:
        _write(output, exchange)
    if as_json:
        print_json(exchange.plain())
    else:
        print_result(exchange.mermaid().rstrip() if output is None else str(output))


def _write(output: Path, exchange: Exchange) -> None:
    from minerva_messages.sequence import draw

    text = draw(exchange) if ending_of(output) == ".svg" else exchange.mermaid()
    write_output(output, text.encode(), "conversation")
