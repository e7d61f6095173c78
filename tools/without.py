"""Shows that the project works without an extension.

    python -m tools.without NAME... [--imports]

A copy of the project without these extensions, and without what imports them outside of the kernel
(worlds, examples, benchmarks, tests), is installed in an environment of its own. There all modules
are imported, all commands and worlds are listed, and the quick tests run, unless --imports is
given. `all` stands for each extension after another.
"""

from __future__ import annotations

import argparse
import ast
import os
import shutil
import subprocess
import sys
import tempfile
import venv
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
IMPORTS = """
import importlib, pkgutil, sys, warnings
warnings.simplefilter("ignore")
for name in sys.argv[1:]:
    package = importlib.import_module(name)
    for module in pkgutil.walk_packages(package.__path__, f"{name}."):
        if not module.name.endswith("__main__"):
            try:
                importlib.import_module(module.name)
            except ImportError as error:
                if (error.name or "").startswith("minerva"):
                    raise
            except Exception as error:
                # An extra that is not installed raises an error of the project with its remedy.
                if not type(error).__module__.startswith("minerva_bus"):
                    raise
"""


def extensions() -> list[str]:
    """The names of all extensions."""
    return sorted(path.name for path in (ROOT / "extensions").iterdir() if path.is_dir())


def imported(path: Path) -> Iterator[str]:
    """The top-level packages that a file imports."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (each.name.partition(".")[0] for each in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0]


def unit(path: Path) -> Path:
    """What is left out with a file that imports an extension: a world with its folder, or the file.

    Raises SystemExit for a file of the kernel.
    """
    match path.parts:
        case ("minerva_bus", *_):
            raise SystemExit(f"{path} of the kernel imports an extension")
        case ("worlds", "minerva_worlds", folder, _, *_):
            return Path("worlds/minerva_worlds", folder)
        case ("extensions" | "examples", folder, *_):
            return Path(path.parts[0], folder)
    return path


def copy(names: Iterable[str], to: Path) -> list[Path]:
    """Copy the project without extensions; returns what else is left out."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.splitlines()  # fmt: skip
    folders = tuple(f"extensions/{name}/" for name in names)
    files = [Path(name) for name in listed if not name.startswith(folders)]
    files = [path for path in files if (ROOT / path).is_file()]
    needs = {path: {*imported(ROOT / path)} for path in files if path.suffix == ".py"}
    absent, left_out = {f"minerva_{name}" for name in names}, list[Path]()
    # What imports an extension that is left out with another one is left out, too.
    while more := {unit(path) for path, needed in needs.items() if absent & needed} - {*left_out}:
        left_out = sorted({*left_out, *more})
        absent |= {f"minerva_{each.name}" for each in more if each.parts[0] == "extensions"}
    for path in files:
        if not any(path.is_relative_to(each) for each in left_out):
            (to / path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / path, to / path)
    settings = to / "pyproject.toml"
    gone = tuple(f'"{".".join(each.parts[1:])}:' for each in left_out)
    lines = settings.read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [line for line in lines if not any(entry in line for entry in gone)]
    settings.write_text("".join(kept), encoding="utf-8")
    return left_out


def install(project: Path) -> Path:
    """Install a copy in a new environment with the libraries of this one; returns its Python."""
    folder = project / ".venv"
    venv.create(folder, symlinks=True)
    packages = next(folder.glob("lib/*/site-packages"))
    # Path files within these folders are not read, so this project is not among the libraries.
    libraries = [path for path in sys.path if path.endswith("site-packages")]
    (packages / "libraries.pth").write_text("\n".join(libraries), encoding="utf-8")
    python = folder / "bin" / "python"
    pip = [python, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--disable-pip-version-check", "--editable", project], check=True)
    return python


def run(names: list[str], *, tests: bool) -> int:
    """Check the project without these extensions; returns the exit code."""
    print(f"without {', '.join(names)}", flush=True)
    with tempfile.TemporaryDirectory(prefix="minerva-without-") as folder:
        project = Path(folder)
        left_out = copy(names, project)
        if left_out:
            print(f"  also left out: {', '.join(map(str, left_out))}", flush=True)
        environment = {key: os.environ[key] for key in os.environ if key != "PYTHONPATH"}
        python = install(project)

        def passes(*words: object) -> bool:
            done = subprocess.run([python, *words], cwd=project, env=environment, check=False)
            return done.returncode == 0

        kept = [
            f"minerva_{name}" for name in extensions() if (project / "extensions" / name).is_dir()
        ]
        packages = ["minerva_bus", "minerva_services", "minerva_agents", "minerva_worlds", *kept]
        checks = [
            ("-c", IMPORTS, *packages),
            ("-m", "minerva_bus", "--help"),
            ("-m", "minerva_bus", "worlds"),
        ]
        if tests:
            checks.append(("-m", "pytest", "-q", "-m", "quick", "-p", "no:cacheprovider"))
        return 0 if all(passes(*words) for words in checks) else 1


def main(words: list[str] | None = None) -> int:
    """Run the program with these arguments; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="+", choices=[*extensions(), "all"], metavar="NAME")
    parser.add_argument("--imports", action="store_true", help="run no tests")
    given = parser.parse_args(words)
    every = [[name] for name in extensions()] if "all" in given.names else [given.names]
    return max(run(names, tests=not given.imports) for names in every)


if __name__ == "__main__":
    sys.exit(main())
