"""PAPER.md names existing modules, functions and tests, and its tests import the engine."""

import ast
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from tests.quick import left_out

ROOT = Path(__file__).parents[2]
DOCUMENT = (ROOT / "PAPER.md").read_text()
CODE = ("minerva_bus", "agents/minerva_agents", "services/minerva_services")
PROJECT = tuple(Path(__file__).parents[2] / path for path in CODE)
ROBOT = ("agents/minerva_agents/robot", "services/minerva_services", "minerva_bus")
PACKAGES = (
    *("minerva_bus", "minerva_agents", "minerva_services", "minerva_messages", "minerva_fast"),
    *("tests", "extensions", "running"),
)
"""Imports of these packages mean that a test runs the engine; `running` starts worlds."""
NAME = re.compile(r"@?\.?[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*")
PATH = re.compile(r"[\w/.]+(\.py|\.toml|\.md|/)")


@dataclass(frozen=True)
class Row:
    """One row of a table, with the heading and the text before the table."""

    line: int
    cells: tuple[str, ...]
    heading: str
    intro: str


def rows():
    heading, intro, table = "", "", False
    for number, line in enumerate(DOCUMENT.splitlines(), 1):
        if line.startswith("#"):
            heading, intro = line, ""
        elif line.startswith("|"):
            cells = tuple(cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1])
            if table and not set(cells[0]) <= {"-"}:
                yield Row(number, cells, heading, intro)
            table = True
        else:
            table = False
            intro += line


ROWS = list(rows())


def quoted(text):
    return re.findall(r"`([^`]+)`", text)


def found(path, row):
    """The file or folder for a path in a row, or None."""
    roots = ROBOT if "## 4" in row.heading or "Rulings" in row.heading else ("minerva_bus",)
    places = [ROOT / root / path for root in (*roots, "tests", "")]
    return next((place for place in places if place.exists()), None)


@cache
def names(path):
    """All definitions in a file, or in the files of a folder: `name` and `Class.name`."""
    files = [path] if path.is_file() else sorted(path.rglob("*.py"))
    made = set()
    for file in files:
        if file.suffix == ".py":
            defined = _defined(ast.parse(file.read_text()), "")
            made |= {file.stem, *defined, *(f"{file.stem}.{name}" for name in defined)}
    return frozenset(made)


def _defined(tree, prefix):
    made = set()
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            made.add(prefix + node.name)
            inner = f"{node.name}." if isinstance(node, ast.ClassDef) else prefix
            made |= _defined(node, inner)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for target in targets:
                if isinstance(target, ast.Name):
                    made.add(prefix + target.id)
                elif isinstance(target, ast.Attribute):
                    made.add(prefix + target.attr)
        elif isinstance(node, ast.If | ast.Try | ast.With | ast.For | ast.Match | ast.While):
            made |= _defined(node, prefix)
    return made


def has(path, name):
    defined = names(path)
    plain = name.lstrip("@")
    return plain in defined or any(name.endswith(f".{plain.lstrip('.')}") for name in defined)


def test_every_path_of_a_row_exists():
    assert len(ROWS) > 100
    missing = [
        f"line {row.line}: there is no {token}"
        for row in ROWS
        for token in quoted(" ".join((*row.cells, row.intro)))
        if PATH.fullmatch(token) and found(token, row) is None and not left_out(token)
    ]
    assert missing == []


def tokens():
    """The text in backquotes in cells of rows, each with the module named before it.

    What an extension has that is left out is passed over.
    """
    for row in ROWS:
        paths = [found(path, row) for path in quoted(row.intro) if PATH.fullmatch(path)]
        tested = next((path for path in paths if path is not None and "tests" in path.parts), None)
        for cell in row.cells[1:]:
            module = absent = None
            for token in quoted(cell):
                if PATH.fullmatch(token):
                    module, absent = found(token, row), left_out(token)
                elif not absent:
                    yield row, token, module, tested


def test_every_name_of_a_row_is_in_the_module_before_it():
    """A name without a preceding module can be anywhere in the project."""
    missing = []
    for row, token, module, _ in tokens():
        if NAME.fullmatch(token) and not token.startswith("test_"):
            here = [module] if module is not None and "tests" not in module.parts else PROJECT
            if not any(has(place, token) for place in here):
                missing.append(f"line {row.line}: there is no {token} in {here[0]}")
    assert missing == []


def test_every_test_of_a_row_is_in_the_file_before_it():
    missing = []
    for row, token, module, tested in tokens():
        file = module if module is not None else tested
        if token.startswith("test_") and (file is None or token not in names(file)):
            missing.append(f"line {row.line}: there is no {token} in {file}")
    assert missing == []


@cache
def imported(file):
    """The full names of a file's imports."""
    result = []
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            result += [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            result += [alias.name for alias in node.names]
    return result


def runs_the_engine(file):
    return any(
        module.startswith(PACKAGES) and not module.startswith("minerva_bus.testing")
        for module in imported(file)
    )


def test_every_test_of_a_row_imports_the_engine():
    """The transcription alone is not enough: a test must fail if the code of its row is wrong."""
    missing = []
    for row in ROWS:
        for token in quoted(" ".join((*row.cells[1:], row.intro))):
            path = found(token, row) if PATH.fullmatch(token) else None
            if path is None or "tests" not in path.parts:
                continue
            files = [path] if path.is_file() else sorted(path.glob("test_*.py"))
            wrong = [file.name for file in files if not runs_the_engine(file)]
            if wrong or not files:
                missing.append(f"line {row.line}: {token}: {wrong or 'no test'}")
    assert missing == []
