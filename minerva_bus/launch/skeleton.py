"""Scaffold a new package from templates: `minerva new`.

A template is a text with `$name` and `$Class` in the folder `templates` here: a file
`x.txt` becomes `x`, and a folder `package` gets the name of the new package.
"""

from __future__ import annotations

import keyword
import re
import shutil
import sys
import tempfile
from pathlib import Path
from string import Template
from typing import Final

from minerva_bus.errors import MisuseError
from minerva_bus.launch.specs import SERVICES, entries

TEMPLATES: Final = Path(__file__).with_name("templates")
LONGEST: Final = 40

_NAME = re.compile(rf"[a-z][a-z0-9_]{{0,{LONGEST - 1}}}")


def write_bridge(name: str, folder: Path) -> Path:
    """Write a package with a bridge to a new folder of its name, and return the folder.

    The folder is complete or absent. Raises MisuseError if the name is not valid for a Python
    package and a service, or already taken.
    """
    _check_name(name)
    goal = folder / name
    if goal.exists() or goal.is_symlink():
        raise MisuseError(f"{goal} is there already; nothing was written. Choose another name")
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=f".{name}-") as made:
            root = Path(made) / name
            _fill(TEMPLATES / "bridge", root, name)
            root.rename(goal)
    except OSError as error:
        raise MisuseError(f"{goal} cannot be written: {error.strerror}") from None
    return goal


def _check_name(name: str) -> None:
    if not _NAME.fullmatch(name):
        close = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_0123456789")[:LONGEST]
        hint = f", such as {close}" if close else ""
        raise MisuseError(
            f"{name!r} cannot name a bridge: it begins with a small letter, and has up to {LONGEST}"
            f" small letters, digits and _{hint}"
        )
    if keyword.iskeyword(name) or keyword.issoftkeyword(name):
        raise MisuseError(f"{name!r} is a word of Python's own; choose another name")
    if name in sys.stdlib_module_names or name in _TAKEN:
        raise MisuseError(f"{name!r} is a module that others import; choose another name")
    if name in entries(SERVICES):
        raise MisuseError(f"a service {name!r} is installed already; choose another name")


_TAKEN: Final = frozenset(
    ("minerva_bus", "minerva_services", "minerva_agents", "numpy", "zenoh", "tests", "yard")
)


def _fill(template: Path, goal: Path, name: str) -> None:
    """Write a folder of templates with the name filled in."""
    words = {"name": name, "Class": "".join(map(str.capitalize, name.split("_")))}
    for path in sorted(template.rglob("*.txt")):
        place = path.relative_to(template).with_suffix("")
        parts = [name if part == "package" else part for part in place.parts]
        target = goal.joinpath(*parts)
        target.parent.mkdir(parents=True, exist_ok=True)
        text = Template(path.read_text(encoding="utf-8")).substitute(words)
        target.write_text(text, encoding="utf-8")
    shutil.copymode(template, goal)
