"""`minerva new`."""

from __future__ import annotations

from pathlib import Path
from string import Template

from minerva_bus.cli.saying import say
from minerva_bus.launch.skeleton import KINDS, scaffold


def make_new(kind: str, name: str, folder: Path) -> None:
    """Scaffold a package and print the next steps. Raises MisuseError."""
    created = scaffold(kind, name, folder)
    say(f"created {created}; next steps:")
    say(f"  cd {created}")
    say("  pytest                                   # run its tests")
    say(f"  {Template(KINDS[kind].run).substitute(name=name):40} # run a small world")
    say(f"then edit {Template(KINDS[kind].edit).substitute(name=name)}")
