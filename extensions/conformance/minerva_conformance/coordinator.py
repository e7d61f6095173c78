"""The coordinator of Minerva Bus, as the conformance suite starts one.

    minerva conformance --role coordinator -- python -m minerva_conformance.coordinator

Name and endpoint of its world come from MINERVA_WORLD and MINERVA_LISTEN.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

WORLD = Path(__file__).with_name("world.toml")


def main() -> None:
    """Run the world of the suite until it is stopped."""
    given = {name: os.environ.get(name, "") for name in ("MINERVA_WORLD", "MINERVA_LISTEN")}
    for name, value in given.items():
        if not value:
            sys.exit(f"{name} is not set; start this program by `minerva conformance`")
    named = ["--name", given["MINERVA_WORLD"], "--listen", given["MINERVA_LISTEN"]]
    words = [sys.executable, "-m", "minerva_bus.cli.main", "run", str(WORLD), *named]
    os.execv(sys.executable, words)  # noqa: S606 - this interpreter


if __name__ == "__main__":
    main()
