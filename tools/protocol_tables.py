"""Tables of the protocol that are generated from the declarations of messages and limits.

    python -m tools.protocol_tables            # compare; exit code 1 if they differ
    python -m tools.protocol_tables --write    # write them

In a page each table is between `<!-- table: NAME -->` and `<!-- end of table -->`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from pathlib import Path

from minerva_bus.frame import messages as m
from minerva_bus.frame.messages import Mark
from minerva_bus.wire.codec import FOR_ALL, FROM_MEMBER, TO_MEMBER, MessageCodec, message_codec
from minerva_bus.wire.field_codecs import DeclaredField, field_codec
from minerva_bus.wire.plain import DEFAULT, configurable_limits, limit_notes
from tools import blocks
from tools.protocol_vectors import FILES

ROOT = Path(__file__).resolve().parents[1]
PAGES = (ROOT / "PROTOCOL.md", *sorted((ROOT / "docs" / "reference" / "protocol").glob("*.md")))
"""The core of the protocol, and the pages that are parts of it."""


def protocol() -> str:
    """The whole text of the protocol."""
    return "\n".join(page.read_text(encoding="utf-8") for page in PAGES)


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    head = list(head)
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def type_of(of: DeclaredField) -> str:
    """The type of a field in the document's terms."""
    text = field_codec(of).text
    return text if of.least in (None, 0) and of.type is int else text + _bound(of)


def _bound(of: DeclaredField) -> str:
    return (
        f" from {str(of.least).replace('-', '−')}"
        if of.least is not None and of.least > -(1 << 63)
        else ""
    )


def item(of: DeclaredField) -> str:
    """An item of a message: name, type and note."""
    text = f"`{of.name}` {type_of(of)}"
    return f"{text} ({of.note})" if of.note else text


def messages(codecs: Mapping[str, MessageCodec], column: str) -> str:
    """A table of messages; `column` is the header of the column after the number of items."""
    return table(
        ["message", "items", column, "what they are, in order", "meaning"],
        [
            [
                f"`{name}`",
                str(codec.size),
                _asked_by(codec) if column == "answers" else _keys(codec),
                "a map" if codec.wire.keyed else ", ".join(map(item, codec.items)),
                codec.wire.meaning,
            ]
            for name, codec in codecs.items()
        ],
    )


def _asked_by(codec: MessageCodec) -> str:
    return f"`{codec.wire.answers}`" if codec.wire.answers else ""


def _keys(codec: MessageCodec) -> str:
    return ", ".join(f"`{key}`" for key in codec.wire.on)


def hello() -> str:
    """The keys of a hello."""
    codec = message_codec(m.Hello)
    return table(
        ["key", "type", "meaning"],
        [[f"`{of.name}`", type_of(of), of.note + _if_missing(of)] for of in codec.items],
    )


def _if_missing(of: DeclaredField) -> str:
    default = str(of.default).lower().removesuffix(".0")
    return f"; {default} if missing" if of.has(Mark.OPTIONAL) else ""


def limits() -> str:
    """The limits; those that a world file may set are in bold."""
    notes, bold = limit_notes(), configurable_limits()
    return table(
        ["limit", "most", "of what"],
        [
            [
                f"**`{name}`**" if name in bold else f"`{name}`",
                f"{most:,}".replace(",", " "),
                notes[name],
            ]
            for name, most in asdict(DEFAULT).items()
        ],
    )


def vectors() -> str:
    """The files of test vectors, with the requirements that they show."""
    return table(
        ["file", "requirements", "cases"],
        [
            [
                f"[`{name}.json`](../../../protocol/vectors/{name}.json)",
                ", ".join(file.requirements),
                file.description,
            ]
            for name, file in FILES.items()
        ],
    )


TABLES: Mapping[str, Callable[[], str]] = {
    "messages of a member": lambda: messages(FROM_MEMBER, "answers"),
    "keys of a hello": hello,
    "messages of the coordinator": lambda: messages(TO_MEMBER, "on"),
    "messages for everyone": lambda: messages(FOR_ALL, "on"),
    "limits": limits,
    "vectors": vectors,
}


def with_tables(document: str) -> str:
    """A page with its tables up to date."""
    return blocks.filled(document, "table", lambda name: TABLES[name]())


def main() -> int:
    parser = argparse.ArgumentParser(description="the tables of the protocol")
    parser.add_argument("--write", action="store_true", help="write them")
    write, outdated = parser.parse_args().write, False
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        wanted = with_tables(text)
        if write:
            page.write_text(wanted, encoding="utf-8")
        outdated |= text != wanted
    if write:
        return 0
    print("run with --write" if outdated else "the tables are up to date")
    return int(outdated)


if __name__ == "__main__":
    sys.exit(main())
