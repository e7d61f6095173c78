"""Diagrams of ARCHITECTURE.md generated from the code: frame phases and main types.

    python -m tools.diagrams            # compare; exit code 1 if they differ
    python -m tools.diagrams --write    # write them

In the document each diagram is between `<!-- diagram: NAME -->` and `<!-- end of diagram -->`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.description import World
from minerva_bus.frame.phases import diagram
from minerva_bus.grammar.scene import EMPTY
from minerva_bus.grammar.vocabulary import Vocabulary
from tools import blocks

DOCUMENT = Path(__file__).resolve().parents[1] / "ARCHITECTURE.md"


def owned(owner: object) -> Mapping[str, str]:
    """Attributes of an object with a class from `minerva_bus.frame`, and these classes."""
    parts = {name: type(part) for name, part in vars(owner).items()}
    return {
        name.removeprefix("_"): part.__name__
        for name, part in parts.items()
        if part.__module__.startswith("minerva_bus.frame.")
    }


def types() -> str:
    """A class diagram of `FrameAlgorithm` and the objects that it owns."""
    algorithm = FrameAlgorithm(World("w", EMPTY, Vocabulary.of()))
    owners = [("FrameAlgorithm", algorithm), ("LiveSource", algorithm.source)]
    lines = [
        f"    {name} *-- {part}: {attribute}"
        for name, owner in owners
        for attribute, part in owned(owner).items()
        if part not in ("Phase", "FrameAlgorithm")
    ]
    title = "    accTitle: FrameAlgorithm and the objects that it owns"
    return "\n".join(["classDiagram", "    direction LR", title, *lines])


DIAGRAMS: Mapping[str, Callable[[], str]] = {"phases": diagram, "types": types}


def written(text: str) -> str:
    """The document with its generated diagrams up to date."""
    return blocks.filled(text, "diagram", lambda name: f"```mermaid\n{DIAGRAMS[name]()}\n```\n")


def main() -> int:
    """Compare or write the diagrams."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write the diagrams")
    text = DOCUMENT.read_text(encoding="utf-8")
    if parser.parse_args().write:
        DOCUMENT.write_text(written(text), encoding="utf-8")
        return 0
    if text != written(text):
        print("ARCHITECTURE.md differs from the code; run python -m tools.diagrams --write")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
