"""`minerva new`."""

from __future__ import annotations

from pathlib import Path
from string import Template

from minerva_bus.cli.answers import FolderCreated
from minerva_bus.cli.output import print_answer
from minerva_bus.errors import MisuseError
from minerva_bus.launch.skeleton import KINDS, copy_world, scaffold


def create(kind: str, name: str, folder: Path, model: str, as_json: bool) -> None:
    """Create a package in `folder`, or a copy of the installed world `model`.

    Raises MisuseError and WorldFileError.
    """
    if model and kind != "world":
        raise MisuseError(f"--from copies a world: minerva new world {name} --from {model}")
    print_answer(_copied(model, name, folder) if model else _made(kind, name, folder), as_json)


def _copied(model: str, name: str, folder: Path) -> FolderCreated:
    file = copy_world(model, name, folder)
    return FolderCreated(str(file.parent), f"minerva run {file.name}")


def _made(kind: str, name: str, folder: Path) -> FolderCreated:
    made = scaffold(kind, name, folder)
    run, edit = [
        Template(text).substitute(name=name) for text in (KINDS[kind].run, KINDS[kind].edit)
    ]
    return FolderCreated(str(made), run, "pytest", edit)
