"""The options of installed services, read from their source: importing them may take a second."""

from __future__ import annotations

import ast
import importlib.util
import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

from minerva_bus.entry_points import entries
from minerva_bus.launch.installed import SERVICES


class Signature(NamedTuple):
    """An option of a service: its annotation and documentation, as its source has them."""

    annotation: str
    text: str


def options_of_service(name: str) -> dict[str, Signature]:
    """The options of an installed service; empty for none."""
    entry = entries(SERVICES).get(name)
    if entry is None:
        return {}
    module, _, attribute = entry.value.partition(":")
    documentation, arguments = "", None
    # The constructor may be that of a base class.
    while arguments is None:
        definition = _class(module, attribute)
        if definition is None:
            return {}
        module, cls = definition
        documentation = documentation or ast.get_docstring(cls) or ""
        arguments = next(
            (
                each.args
                for each in cls.body
                if isinstance(each, ast.FunctionDef) and each.name == "__init__"
            ),
            None,
        )
        base = next((each.id for each in cls.bases if isinstance(each, ast.Name)), None)
        if arguments is None and base is None:
            return {}
        attribute = base or ""
    texts = dict(re.findall(r"^ *(\w+): (.*)$", documentation, flags=re.MULTILINE))
    names = [*arguments.args[1:], *arguments.kwonlyargs]
    return {
        each.arg: Signature(_annotated(each), texts.get(each.arg, _annotated(each)))
        for each in names
    }


def _annotated(argument: ast.arg) -> str:
    return "" if argument.annotation is None else ast.unparse(argument.annotation)


def _class(module: str, name: str) -> tuple[str, ast.ClassDef] | None:
    """A class with its module, which may import it from another one."""
    tree = _tree(module)
    for node in tree.body if tree is not None else ():
        if isinstance(node, ast.ClassDef) and node.name == name:
            return module, node
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return _class(node.module, alias.name)
    return None


@cache
def _tree(module: str) -> ast.Module | None:
    top, *parts = module.split(".")
    package = importlib.util.find_spec(top)
    for folder in (package.submodule_search_locations or ()) if package is not None else ():
        path = Path(folder, *parts)
        for file in (path / "__init__.py", path.with_suffix(".py")):
            if file.is_file():
                return ast.parse(file.read_text(encoding="utf-8"))
    return None
