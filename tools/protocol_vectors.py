"""Test vectors of the protocol for implementations in any language: protocol/vectors/*.json.

    python -m tools.protocol_vectors            # compare; exit code 1 if they differ
    python -m tools.protocol_vectors --write    # write them

docs/reference/protocol/test-vectors.md describes the notation. The cases of strings, columns and
messages use the vocabulary of the golden messages, and `PTally`.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from minerva_bus.wire.vocabulary_codec import plain_vocabulary
from tools.vectors import messages, numbers, streams, strings
from tools.vectors.notation import Cases, Json, tagged

FOLDER: Final = Path(__file__).resolve().parents[1] / "protocol" / "vectors"


@dataclass(frozen=True, slots=True)
class Vectors:
    """One file: what it is about, the requirements that it shows, and its cases.

    `cases` yields the name, input and expected output of each case. `vocabulary`: whether the file
    contains the vocabulary, without which the cases cannot be read.
    """

    description: str
    requirements: tuple[str, ...]
    cases: Callable[[], Cases]
    vocabulary: bool = False

    def document(self) -> Json:
        """The content of the file."""
        head: dict[str, Json] = {
            "description": self.description,
            "requirements": list(self.requirements),
        }
        if self.vocabulary:
            head["vocabulary"] = tagged(plain_vocabulary(strings.VOCABULARY))
        cases = [{"name": n, "input": given, "expected": e} for n, given, e in self.cases()]
        return {**head, "cases": cases}


FILES: Final[Mapping[str, Vectors]] = {
    "floats": Vectors(
        "Reals. Input: the bits of a float64. Expected: its text and its MessagePack.",
        ("P5.4",), numbers.floats,
    ),
    "integers": Vectors(
        "64-bit integers. Expected: text, shortest MessagePack, a longer form that is accepted.",
        ("P3.1", "P5.4"), numbers.integers,
    ),
    "texts": Vectors(
        "Unicode. Input: code points. Expected: quoted text, as in digests, and MessagePack.",
        ("P3.2", "P5.4"), numbers.texts,
    ),
    "values": Vectors(
        "Lists, matrices and strings as values. Input: text. Expected: MessagePack.",
        ("P3.4", "P3.5"), numbers.values, vocabulary=True,
    ),
    "strings": Vectors(
        "Strings. Input: text. Expected: MessagePack of single nodes, and the digest.",
        ("P3.6", "P3.7", "P3.8", "P5.1", "P5.2", "P5.3"), strings.strings, vocabulary=True,
    ),
    "digests": Vectors(
        "Digests of strings in columns. Input: MessagePack of the string. Expected: the digest.",
        ("P5.1", "P5.2"), strings.digests, vocabulary=True,
    ),
    "columns": Vectors(
        "Columns. Input: MessagePack. Expected: the same string of single nodes.",
        ("P3.15", "P3.16", "P3.17"), strings.columns, vocabulary=True,
    ),
    "ids": Vectors(
        "Columns of ids. Input: MessagePack. Expected: the ids.", ("P3.18",), strings.ids
    ),
    "patches": Vectors(
        "Patches. Input: columns and a patch. Expected: the string after it, of single nodes.",
        ("P3.20", "P3.21"), strings.patches, vocabulary=True,
    ),
    "events": Vectors(
        "Events. Input: MessagePack of an event or a batch. Expected: a list of single events.",
        ("P3.13", "P3.14", "P3.19"), strings.events, vocabulary=True,
    ),
    "conditions": Vectors(
        "Conditions of events. Input: text, and an agent's attributes. Expected: whether it holds.",
        ("P3.10",), strings.conditions,
    ),
    "philox": Vectors(
        "Philox streams. Expected: key, lower word first; the first words and numbers.",
        ("P9.24", "P9.28"), streams.philox,
    ),
    "splitmix64": Vectors(
        "SplitMix64 streams of agents. Expected: hash of the id, first state, first numbers.",
        ("P9.25", "P9.26", "P9.27"), streams.splitmix64,
    ),
    "responses": Vectors(
        "Streams that decide about events with a probability. Expected: first state and numbers.",
        ("P9.30",), streams.responses,
    ),
    "distributions": Vectors(
        "Distributions. Input: state of a SplitMix64 stream. Expected: the first number of each;"
        " uniform from -1 to 3, integer from -5 to 99.",
        ("P9.29",), streams.distributions,
    ),
    "copies": Vectors("Ids of copies under the literal policy.", ("P9.14",), streams.copies),
    "messages": Vectors(
        "Messages. Input: MessagePack without the epoch. Expected: the message.",
        ("P3.1", "P8.1", "P8.2"), messages.messages, vocabulary=True,
    ),
    "readings": Vectors(
        "Readings. Input: MessagePack of one reading. Expected: the reading.",
        ("P11.1",), messages.readings,
    ),
    "epochs": Vectors(
        "Epochs. Input: epoch and message. Expected: the payload.", ("P2.5",), messages.epochs
    ),
    "refused": Vectors(
        "Messages of members that a reader refuses.", ("P14.2",), messages.refused, vocabulary=True
    ),
    "names": Vectors(
        "Names of worlds, members and topics: valid or not.", ("P2.1",), messages.names
    ),
}  # fmt: skip


def contents() -> dict[str, str]:
    """The content of each file, by its name."""
    return {f"{name}.json": _lines(vectors.document()) for name, vectors in sorted(FILES.items())}


def _lines(document: Json) -> str:
    """JSON with one case per line, so that a difference shows the case."""
    head = [f" {json.dumps(k)}: {json.dumps(v)}" for k, v in document.items() if k != "cases"]
    cases = ",\n".join(f"  {json.dumps(case)}" for case in document["cases"])
    return "{\n" + ",\n".join([*head, f' "cases": [\n{cases}\n ]']) + "\n}\n"


def main() -> int:
    parser = argparse.ArgumentParser(description="test vectors of the protocol")
    parser.add_argument("--write", action="store_true", help="write protocol/vectors")
    wanted = contents()
    if parser.parse_args().write:
        FOLDER.mkdir(parents=True, exist_ok=True)
        for name, content in wanted.items():
            (FOLDER / name).write_text(content, encoding="utf-8")
        return 0
    known = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.json")}
    names = sorted(wanted.keys() | known.keys())
    differing = [name for name in names if wanted.get(name) != known.get(name)]
    print("\n".join(differing) or "the vectors are up to date")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
