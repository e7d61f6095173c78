"""`minerva new`."""

from __future__ import annotations

from pathlib import Path

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.launch.skeleton import write_bridge

KINDS = {"bridge": write_bridge}


def make_new(kind: str, name: str, folder: Path) -> None:
    """Write the beginnings of something, and say what to do next. Raises MisuseError."""
    if kind not in KINDS:
        raise MisuseError(
            f"there is nothing new of the kind {kind!r}{nearest(kind, list(KINDS))}; expected"
            f" {', '.join(KINDS)}"
        )
    made = KINDS[kind](name, folder)
    _print(f"{made} is written; it works as it is:")
    _print(f"  cd {made}")
    _print("  pytest                                  # its tests")
    _print("  minerva run yard.toml --in-process      # a small world that hears it")
    _print(f"then change {name}/bridge.py, where it reads what your device says")


def _print(line: str) -> None:
    print(line)  # noqa: T201
