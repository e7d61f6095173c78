"""`minerva new`."""

from __future__ import annotations

from pathlib import Path

from minerva_bus.cli.saying import say
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.launch.skeleton import write_bridge

KINDS = {"bridge": write_bridge}


def make_new(kind: str, name: str, folder: Path) -> None:
    """Scaffold a package and print the next steps. Raises MisuseError."""
    if kind not in KINDS:
        raise MisuseError(
            f"cannot create the kind {kind!r}{nearest(kind, list(KINDS))};"
            f" expected {', '.join(KINDS)}"
        )
    made = KINDS[kind](name, folder)
    say(f"{made} is written; it works as it is:")
    say(f"  cd {made}")
    say("  pytest                                  # its tests")
    say("  minerva run yard.toml --in-process      # a small world that hears it")
    say(f"then change {name}/bridge.py, where it reads what your device says")
