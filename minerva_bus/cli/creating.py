"""`minerva new`."""

from __future__ import annotations

from pathlib import Path
from string import Template

from minerva_bus.cli.output import Done, print_answer
from minerva_bus.errors import MisuseError
from minerva_bus.launch.skeleton import KINDS, copy_world, scaffold


def create(kind: str, name: str, folder: Path, model: str, as_json: bool) -> None:
    """Create a package in `folder`, or a copy of the installed world `model`.

    Raises MisuseError and WorldFileError.
    """
    if model and kind != "world":
        raise MisuseError(f"--from copies a world: minerva new world {name} --from {model}")
    print_answer(_copied(model, name, folder) if model else _made(kind, name, folder), as_json)


def _copied(model: str, name: str, folder: Path) -> Done:
    file = copy_world(model, name, folder)
    run = f"minerva run {file.name}"
    fields = {"folder": str(file.parent), "run": run, "test": "", "edit": ""}
    return Done(f"{_created(file.parent)}\n  {run}", fields)


def _made(kind: str, name: str, folder: Path) -> Done:
    made = scaffold(kind, name, folder)
    run, edit = [
        Template(text).substitute(name=name) for text in (KINDS[kind].run, KINDS[kind].edit)
    ]
    lines = [
        _created(made),
        f"  {'pytest':40} # run its tests",
        f"  {run:40} # run a small world",
        f"then edit {edit}",
    ]
    fields = {"folder": str(made), "run": run, "test": "pytest", "edit": edit}
    return Done("\n".join(lines), fields)


def _created(folder: Path) -> str:
    return f"created {folder}; next steps:\n  cd {folder}"
