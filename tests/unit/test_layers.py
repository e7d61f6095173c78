"""Imports go in one direction, and each library has one place (ARCHITECTURE.md).

The kernel, `minerva_bus`, imports no extension; an extension imports the kernel, services and the
extensions that it requires. Imports within functions and under TYPE_CHECKING count.
"""

import ast
import re
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ORDER = [
    "portable",
    "grammar",
    "semantics",
    "world",
    "frame",
    "collect",
    "wire",
    "log",
    "security",
    "runtime",
    "settings",
    "launch",
    "api",
    "testing",
    "cli",
]
ONLY = {
    "zenoh": "runtime",
    "typer": "cli",
    "msgpack": "wire",
    "mcap": "log",
}

REQUIRED = {
    "assistants": {"analysis"},
    "determinism": {"analysis"},
    "exporters": {"analysis"},
    "study": {"analysis"},
}
"""Extensions that others require, by the extension that requires them."""


@cache
def imports(path):
    """The modules that a file imports."""
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [name.name for name in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names += [node.module, *(f"{node.module}.{name.name}" for name in node.names)]
    return names


def files(folder):
    return sorted((ROOT / folder).rglob("*.py"))


@pytest.mark.parametrize("package", ORDER)
def test_a_package_imports_only_those_below_it(package):
    above = ORDER[ORDER.index(package) + 1 :]
    for path in files(f"minerva_bus/{package}"):
        for name in imports(path):
            parts = name.split(".")
            assert not (parts[0] == "minerva_bus" and parts[1:2] and parts[1] in above), (
                f"{path.relative_to(ROOT)} imports {name}"
            )


def test_the_document_has_this_order():
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    line = re.search(r"```\n(portable → [^`]*)```", text)[1]
    assert line.split() == " → ".join(ORDER).split()
    folders = {path.parent.name for path in (ROOT / "minerva_bus").glob("*/__init__.py")}
    assert folders == set(ORDER)


@cache
def extensions():
    return {path.name for path in (ROOT / "extensions").glob("*") if path.is_dir()}


@pytest.mark.parametrize("folder", ["minerva_bus", "services", "agents"])
def test_the_kernel_imports_no_extension(folder):
    for path in files(folder):
        for name in imports(path):
            extension = name.split(".")[0].removeprefix("minerva_")
            assert extension not in extensions(), f"{path.relative_to(ROOT)} imports {name}"


@pytest.mark.parametrize("name", sorted(extensions()))
def test_an_extension_imports_only_extensions_that_it_requires(name):
    others = {f"minerva_{each}" for each in extensions() - REQUIRED.get(name, set()) - {name}}
    for path in files(f"extensions/{name}"):
        # Tests run worlds, but an extension does not know them.
        more = () if "tests" in path.parts else ("minerva_agents", "minerva_worlds")
        for imported in imports(path):
            assert imported.split(".")[0] not in {*others, *more}, path


def test_modules_beside_the_packages_import_none_of_them():
    for path in sorted((ROOT / "minerva_bus").glob("*.py")):
        if not path.name.startswith("__"):
            packages = {name.split(".")[1] for name in imports(path) if name.count(".")}
            assert not packages & set(ORDER), path


@pytest.mark.parametrize(("library", "home"), ONLY.items())
def test_a_library_has_one_home(library, home):
    for path in files("minerva_bus"):
        inside = path.relative_to(ROOT / "minerva_bus").parts[0] == home
        for name in imports(path):
            assert inside or name.split(".")[0] != library, f"{path} imports {library}"


def test_only_the_physics_service_imports_pymunk():
    for folder in ("minerva_bus", "services", "agents"):
        for path in files(folder):
            if "physics" not in path.parts:
                assert "pymunk" not in {name.split(".")[0] for name in imports(path)}, path


def test_services_and_agents_do_not_know_each_other():
    for folder, other in (("services", "minerva_agents"), ("agents", "minerva_services")):
        for path in files(f"{folder}/minerva_{folder}"):
            assert other not in {name.split(".")[0] for name in imports(path)}, path


@pytest.mark.parametrize("folder", ["services", "agents"])
def test_modules_import_each_other_in_no_circle(folder):
    of = {path: path.relative_to(ROOT / folder).with_suffix("") for path in files(folder)}
    graph = {".".join(name.parts): imports(path) for path, name in of.items()}
    TopologicalSorter(graph).prepare()


def test_the_bus_knows_no_robots():
    for path in files("minerva_bus"):
        if path.name in ("readings.py", "codec.py"):
            continue  # A scan contains the name of its robot.
        code = "\n".join(
            line
            for line in path.read_text(encoding="utf-8").splitlines()
            if "minerva run" not in line
        )
        for name in imports(path):
            assert not name.startswith(("minerva_agents", "minerva_services")), path
        assert "ARobot(" not in code, path


def modules_after(statement):
    """All modules that a new interpreter has after a statement."""
    code = f"import sys; {statement}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return done.stdout.split()


def test_the_command_line_answers_before_anything_heavy_is_there():
    modules = modules_after("import minerva_bus.cli.main")
    names = {name.split(".")[0] for name in modules}
    assert not names & {"numpy", "zenoh", "msgpack", "mcap", "cryptography"}
    packages = {name.split(".")[1] for name in modules if "minerva_bus." in name}
    assert not packages & (set(ORDER) - {"runtime", "settings", "cli"})
