"""Scaffold a new package from templates: `minerva new`.

`templates` has a folder for each kind. Its files contain `$name` and `$Class`; a file `x.txt`
becomes `x`, and `NAME` in a path becomes the name of the new package.
"""

from __future__ import annotations

import keyword
import re
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from string import Template
from typing import Final

from minerva_bus.cli.output import Done, print_answer
from minerva_bus.entry_points import OWN, entries
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.launch.installed import AGENTS, SERVICES, WORLDS, find_world

TEMPLATES: Final = Path(__file__).with_name("templates")
MAX_NAME_LENGTH: Final = 40

_NAME = re.compile(rf"[a-z][a-z0-9_]{{0,{MAX_NAME_LENGTH - 1}}}")


@dataclass(frozen=True, slots=True)
class Scaffold:
    """A kind of package that can be created: its files to edit and to run, with `$name`."""

    edit: str
    run: str = "minerva run yard.toml --in-process"


KINDS: Final = {
    "world": Scaffold("$name.py and $name.toml", "minerva run $name.toml --view svg"),
    "agent": Scaffold("$name/agent.py"),
    "service": Scaffold("$name/service.py"),
    "geometry": Scaffold("$name/geometry.py"),
    "bridge": Scaffold("$name/bridge.py"),
}


def scaffold(kind: str, name: str, folder: Path) -> Path:
    """Write a package of the kind to a new folder of its name, and return the folder.

    The folder is complete or absent. Raises MisuseError if the kind is unknown, or the name is not
    valid for a Python package and a service, or already taken.
    """
    if kind not in KINDS:
        hint = nearest(kind, list(KINDS), f"expected {', '.join(KINDS)}")
        raise MisuseError(f"cannot create the kind {kind!r}{hint}")
    _check_name(name)
    return _create(folder / name, lambda root: _fill(TEMPLATES / kind, root, name))


def copy_world(world: str, name: str, folder: Path) -> Path:
    """Copy an installed world to a new folder, and return the copy of its file.

    What is beside its file is copied, too, unless that is a package, which is imported by its name.
    Raises WorldFileError if there is no such world, and MisuseError if the name is invalid or
    taken.
    """
    file = find_world(world)
    _check_name(name)
    alone = file.with_name("__init__.py").is_file()

    def copy(root: Path) -> None:
        root.mkdir()
        for source in [file] if alone else file.parent.iterdir():
            if source.is_file() and not source.name.startswith("__"):
                shutil.copy(source, root)

    return _create(folder / name, copy) / file.name


def _create(goal: Path, write: Callable[[Path], None]) -> Path:
    """Create a folder, complete or not at all. Raises MisuseError."""
    if goal.exists() or goal.is_symlink():
        raise MisuseError(f"{goal} already exists; nothing was written. Choose another name")
    try:
        # Beside the goal, because a folder can only be renamed within one file system.
        with tempfile.TemporaryDirectory(dir=goal.parent, prefix=f".{goal.name}-") as temporary:
            root = Path(temporary) / goal.name
            write(root)
            root.rename(goal)
    except OSError as error:
        raise MisuseError(f"{goal} cannot be written: {error.strerror}") from None
    return goal


def _check_name(name: str) -> None:
    if not _NAME.fullmatch(name):
        close = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_0123456789")[:MAX_NAME_LENGTH]
        hint = f", such as {close}" if close else ""
        raise MisuseError(
            f"invalid name {name!r}: expected a lower-case letter followed by at most"
            f" {MAX_NAME_LENGTH - 1} lower-case letters, digits and _{hint}"
        )
    if keyword.iskeyword(name) or keyword.issoftkeyword(name):
        raise MisuseError(f"{name!r} is a keyword of Python; choose another name")
    if name in sys.stdlib_module_names or name in _TAKEN or name.startswith(OWN):
        raise MisuseError(f"{name!r} is the name of another module; choose another name")
    for group in (SERVICES, AGENTS, WORLDS):
        if name in entries(group):
            raise MisuseError(f"{name!r} is already installed ({group}); choose another name")


# The templates have a module `yard` and a folder `tests`.
_TAKEN: Final = frozenset(("numpy", "zenoh", "tests", "yard"))


def _fill(template: Path, goal: Path, name: str) -> None:
    """Write a folder of templates with the name inserted."""
    words = {"name": name, "Class": "".join(map(str.capitalize, name.split("_")))}
    for path in sorted(template.rglob("*.txt")):
        place = path.relative_to(template).with_suffix("")
        parts = [part.replace("NAME", name) for part in place.parts]
        target = goal.joinpath(*parts)
        target.parent.mkdir(parents=True, exist_ok=True)
        text = Template(path.read_text(encoding="utf-8")).substitute(words)
        target.write_text(text, encoding="utf-8")
    shutil.copymode(template, goal)


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
    missing = [] if find_spec("pytest") else [f"  {'pip install pytest':40} # for its tests"]
    lines = [
        _created(made),
        *missing,
        f"  {'pytest':40} # run its tests",
        f"  {run:40} # run a small world",
        f"then edit {edit}",
    ]
    fields = {"folder": str(made), "run": run, "test": "pytest", "edit": edit}
    return Done("\n".join(lines), fields)


def _created(folder: Path) -> str:
    return f"created {folder}; next steps:\n  cd {folder}"
